"""Bytes to and from an autopilot: UDP, TCP and serial links by the URL forms that helm takes, on real time."""

from __future__ import annotations

import os
import re
import select
import socket
import termios
import time
import tty
from typing import Protocol

from common.config import ConfigError

_URL = re.compile(r"^(udpin|udpout|tcpin|tcpout)://([^:/\s]+):(\d{1,5})$")
_SERIAL = re.compile(r"^serial(?:_flowcontrol)?://(/dev/[^:\s]+):(\d+)$")
_CHUNK = 65536
_CONNECT_S = 10.0


class Wire(Protocol):
    """A link, and the clock that its reader lives by."""

    def now_s(self) -> float:
        """Time, s, from an arbitrary zero."""
        ...

    def send(self, frame: bytes) -> None:
        """Send one frame; a link that is down loses it."""
        ...

    def receive(self, until_s: float) -> list[bytes]:
        """Chunks that have arrived, at the latest at `until_s`; returns early with the first."""
        ...

    def close(self) -> None:
        """Free the port."""
        ...


def is_loopback(url: str) -> bool:
    """Whether the URL leads to this machine alone, so that what flies there is a simulation."""
    match = _URL.match(url)
    return bool(match) and (match[2] == "localhost" or match[2].startswith("127."))


def open_wire(url: str) -> Wire:
    """Open the link of a URL.

    Raises:
        ConfigError: not a URL of this kind, or the port cannot be opened.
    """
    match, serial = _URL.match(url), _SERIAL.match(url)
    if not serial and not (match and 0 < int(match[3]) < 65536):
        raise ConfigError(
            f"conformance: got {url!r}, expected udpin://HOST:PORT (or udpout, tcpin, tcpout) or "
            f"serial:///dev/NAME:BAUD, for example udpin://127.0.0.1:14540"
        )
    try:
        if serial:
            return SerialWire(serial[1], int(serial[2]))
        scheme, host, port = match.groups()  # type: ignore[union-attr]
        kind = UdpWire if scheme.startswith("udp") else TcpWire
        return kind(host, int(port), listen=scheme.endswith("in"))
    except OSError as error:
        raise ConfigError(
            f"conformance: {url} cannot be opened ({error.strerror or error}); stop the program that holds it, or "
            f"correct the URL"
        ) from None


class _Live:
    """Real time, and waiting for a file descriptor."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        return time.monotonic()

    def _wait(self, source: socket.socket | int | None, until_s: float) -> bool:
        left_s = max(until_s - time.monotonic(), 0.0)
        if source is None:
            time.sleep(min(left_s, 0.05))
            return False
        return bool(select.select([source], [], [], left_s)[0])


class UdpWire(_Live):
    """A UDP socket: it answers whoever spoke last (`udpin`), or speaks first (`udpout`)."""

    def __init__(self, host: str, port: int, listen: bool):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._peer: tuple[str, int] | None = None
        self._listen = listen
        try:
            if listen:
                self._socket.bind((host, port))
            else:
                self._peer = (socket.gethostbyname(host), port)
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)

    def send(self, frame: bytes) -> None:
        """Send a datagram to the peer, if one is known."""
        if self._peer is not None:
            try:
                self._socket.sendto(frame, self._peer)
            except OSError:
                return  # a peer that is not there: its datagram is lost, as on a radio

    def receive(self, until_s: float) -> list[bytes]:
        """Datagrams that have arrived."""
        self._wait(self._socket, until_s)
        out: list[bytes] = []
        while True:
            try:
                data, sender = self._socket.recvfrom(_CHUNK)
            except BlockingIOError:
                return out
            except OSError:
                continue  # a refused datagram, reported late
            if self._listen:
                self._peer = sender
            out.append(data)

    def close(self) -> None:
        """Free the port."""
        self._socket.close()


class TcpWire(_Live):
    """A TCP connection, made again when the other side ends it (an autopilot that reboots)."""

    def __init__(self, host: str, port: int, listen: bool):
        self._address = (host, port)
        self._listener = socket.create_server(self._address) if listen else None
        self._socket: socket.socket | None = None
        if not listen:
            self._socket = socket.create_connection(self._address, timeout=_CONNECT_S)
            self._socket.setblocking(True)

    def send(self, frame: bytes) -> None:
        """Send bytes while connected."""
        if self._socket is not None:
            try:
                self._socket.sendall(frame)
            except OSError:
                self._drop()

    def receive(self, until_s: float) -> list[bytes]:
        """Bytes that have arrived."""
        if self._socket is None:
            self._connect(until_s)
        elif self._wait(self._socket, until_s):
            try:
                data = self._socket.recv(_CHUNK)
            except OSError:
                data = b""
            if data:
                return [data]
            self._drop()
        return []

    def close(self) -> None:
        """End the connection and free the port."""
        self._drop()
        if self._listener is not None:
            self._listener.close()

    def _connect(self, until_s: float) -> None:
        try:
            if self._listener is not None:
                if self._wait(self._listener, until_s):
                    self._socket = self._listener.accept()[0]
                return
            self._socket = socket.create_connection(self._address, timeout=0.5)
            self._socket.setblocking(True)
        except OSError:
            self._wait(None, until_s)  # not there yet: tried again at the next call

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class SerialWire(_Live):
    """A serial device, 8N1, raw."""

    def __init__(self, device: str, baud: int):
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise ConfigError(f"conformance: got {baud} baud, expected a standard rate such as 57600 or 921600")
        self._fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(self._fd)
            settings = termios.tcgetattr(self._fd)
        except termios.error as error:
            os.close(self._fd)
            raise OSError(0, f"not a serial device: {error.args[-1]}") from None
        settings[2] |= termios.CLOCAL | termios.CREAD
        settings[4] = settings[5] = speed
        termios.tcsetattr(self._fd, termios.TCSANOW, settings)

    def send(self, frame: bytes) -> None:
        """Write a frame; what the device does not take is lost."""
        try:
            os.write(self._fd, frame)
        except OSError:
            return

    def receive(self, until_s: float) -> list[bytes]:
        """Bytes that have arrived."""
        if self._wait(self._fd, until_s):
            try:
                return [os.read(self._fd, _CHUNK)]
            except OSError:
                self._wait(None, until_s)  # unplugged, or its USB is being set up again
        return []

    def close(self) -> None:
        """Free the device."""
        os.close(self._fd)
