"""Other media for the autopilot's UDP link: a TCP stream or a serial line in front of it, as a radio or a cable is."""

from __future__ import annotations

import os
import pty
import select
import socket
import threading
import tty
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink


class Bridge:
    """Carries whole MAVLink messages between a stream and the autopilot's UDP link.

    Args:
        stream: descriptor of the stream's end, non-blocking or a terminal.
        local_port: where the autopilot sends to.
        autopilot_port: where the autopilot listens.
    """

    def __init__(self, stream: int, local_port: int, autopilot_port: int):
        self._stream = stream
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", local_port))
        self._autopilot = ("127.0.0.1", autopilot_port)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="bridge", daemon=True)
        self._undo: list[Callable[[], None]] = [self._udp.close]
        self._thread.start()

    @classmethod
    def serial(cls, local_port: int, autopilot_port: int) -> tuple[Bridge, str]:
        """A bridge behind a pseudo-terminal; returns it and the path of the device."""
        ours, theirs = pty.openpty()
        for end in (ours, theirs):
            tty.setraw(end)
        bridge = cls(ours, local_port, autopilot_port)
        bridge._undo += [lambda: os.close(ours), lambda: os.close(theirs)]
        return bridge, os.ttyname(theirs)

    @classmethod
    def tcp_to(cls, port: int, local_port: int, autopilot_port: int) -> Bridge:
        """A bridge that connects to a listening client (its `tcpin`).

        Raises:
            OSError: nobody listens there yet.
        """
        return cls._of_socket(socket.create_connection(("127.0.0.1", port)), local_port, autopilot_port)

    @classmethod
    def tcp_from(cls, listener: socket.socket, local_port: int, autopilot_port: int) -> Bridge:
        """A bridge for the next client that connects (its `tcpout`)."""
        return cls._of_socket(listener.accept()[0], local_port, autopilot_port)

    @classmethod
    def _of_socket(cls, stream: socket.socket, local_port: int, autopilot_port: int) -> Bridge:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        bridge = cls(stream.fileno(), local_port, autopilot_port)
        bridge._undo.append(stream.close)
        return bridge

    def close(self) -> None:
        """End the bridge."""
        self._closed.set()
        self._thread.join(2.0)
        for undo in self._undo:
            undo()

    def _carry(self) -> None:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        try:
            while not self._closed.is_set():
                readable, _, _ = select.select([self._stream, self._udp], [], [], 0.1)
                if self._udp in readable:
                    data = self._udp.recv(2048)
                    while data:
                        data = data[os.write(self._stream, data) :]
                if self._stream in readable:
                    data = os.read(self._stream, 4096)
                    if not data:
                        return
                    for message in parser.parse_buffer(data) or ():  # a datagram holds whole messages, a read need not
                        self._udp.sendto(bytes(message.get_msgbuf()), self._autopilot)
        except OSError:
            return  # the client hung up
