"""A radio between ground and vehicle that a test can cut."""

from __future__ import annotations

import socket
import threading


class Link:
    """A radio between ground and vehicle: a TCP relay that can be cut and joined again.

    Args:
        target: port of the vehicle's router.
    """

    def __init__(self, target: int):
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._joined = threading.Event()
        self._joined.set()
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Stop carrying anything: bytes are held back, as when a radio loses the other side."""
        self._joined.clear()

    def join(self) -> None:
        """Carry again."""
        self._joined.set()

    def close(self) -> None:
        """End the relay."""
        self._joined.set()
        self._listener.close()
        for s in self._sockets:
            s.close()

    def _accept(self) -> None:
        while True:
            try:
                inner, _ = self._listener.accept()
            except OSError:
                return  # closed
            try:
                outer = socket.create_connection(("127.0.0.1", self._target)) if self._joined.is_set() else None
            except OSError:
                outer = None  # the vehicle's router is not there yet
            if outer is None:
                inner.close()
                continue
            self._sockets += [inner, outer]
            for source, sink in ((inner, outer), (outer, inner)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                self._joined.wait()
                sink.sendall(data)
        except OSError:
            pass
        finally:
            source.close()
            sink.close()
