"""One hand per autopilot link on this machine: a lock file that the kernel releases when its process ends.

Helm takes it, and so does a desk tool that commands a vehicle.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import socket
import tempfile
from pathlib import Path
from typing import IO

from common.config import ConfigError
from common.runner import AlreadyRunning


class HelmTaken(AlreadyRunning):
    """Another program on this machine holds the link to this autopilot (exit code 3, as for any second process)."""


def runtime_dir() -> Path:
    """The user's folder for lock files, made if need be: XDG_RUNTIME_DIR, else one of the user's own in the temporary
    folder."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    path = Path(base) / "outrider" if base else Path(tempfile.gettempdir()) / f"outrider-{os.getuid()}"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    return path


class HelmLock:
    """Holds the lock of an autopilot URL until closed or until the process ends, however it ends.

    Two clients on one UDP port both seem to work and one starves, so this is refused before a port is opened.

    Args:
        url: the autopilot's URL.
        vehicle: name of the vehicle, for the text that a second helm shows.
        folder: where lock files live.
        holder: who holds it, for that text; `helm of vehicle …` when empty.

    Raises:
        HelmTaken: another process holds it; the text names the process.
        ConfigError: the folder cannot be written.
    """

    def __init__(self, url: str, vehicle: str, folder: Path | None = None, holder: str = ""):
        name = re.sub(r"[^A-Za-z0-9.]+", "-", url).strip("-")[:60]
        digest = hashlib.sha256(url.encode()).hexdigest()[:8]
        try:
            self.path = (folder or runtime_dir()) / f"helm-{name}-{digest}.lock"
            self._file: IO[str] | None = self.path.open("a+", encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"helm's lock file: {error}; set XDG_RUNTIME_DIR to a folder that you may write"
            ) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.seek(0)
            present = self._file.read().strip() or "another process"
            self._file.close()
            raise HelmTaken(
                f"helm: {url} is held by {present}; one helm commands a vehicle. Stop that one first, or "
                f"set helm.autopilot_url to another vehicle's link"
            ) from None
        self._file.truncate(0)
        self._file.write(f"{holder or f'helm of vehicle {vehicle!r}'}, process {os.getpid()}")
        self._file.flush()

    def close(self) -> None:
        """Release the lock."""
        if self._file is not None:
            self._file.close()
            self._file = None


def require_free_port(port: int, url: str) -> None:
    """Check that no other program listens on a UDP port that helm is about to open.

    Raises:
        ConfigError: the port is in use.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise ConfigError(
                f"helm.autopilot_url: {url}: UDP port {port} cannot be opened ({error.strerror}); stop "
                f"the program that listens there, or choose another port"
            ) from None
