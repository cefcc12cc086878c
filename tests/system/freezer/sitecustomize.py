"""Put on PYTHONPATH by a system test: SIGUSR1 freezes a process's Python, and only its Python, for three seconds.

The handler sleeps in C while it holds the interpreter lock, so every Python thread stands still and native threads
(MAVSDK's, Zenoh's) go on: what a hung callback or a runaway extension does to a real helm.
"""

import ctypes
import signal


def _freeze(signum: int, frame: object) -> None:
    ctypes.PyDLL(None).usleep(3_000_000)


signal.signal(signal.SIGUSR1, _freeze)
