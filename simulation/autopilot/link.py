"""One UDP link of the autopilot: its socket, its peer, and the messages that it carries unasked."""

from __future__ import annotations

import hashlib
import heapq
import socket
from collections import Counter
from collections.abc import Mapping

from pymavlink.dialects.v20 import development as mavlink

from simulation.autopilot.config import LinkConfig
from simulation.autopilot.telemetry import Message, Telemetry

_PEER_SILENT_S = 3.0
_LONGEST_DATAGRAM = 2048
_SEND_QUEUE_BYTES = 262144
# Any key will do: a client has to read the longer frames without it.
_SECRET_KEY = hashlib.sha256(b"simulated autopilot").digest()


class PortInUse(OSError):
    """A local port of the autopilot that somebody else has; the text says which and what to do."""


class UdpLink:
    """A link that speaks MAVLink 2, one message a datagram.

    Args:
        name: section name of the link (`onboard`, `ground`, `truth`), for texts.
        host: local and remote address.
        ports: local port, and the remote port that is sent to until somebody speaks.
        rates: Hz by message identifier.
        first_s: autopilot time before which a message is not sent, by identifier, s.
        system_id: MAVLink system of the autopilot.
        sign: whether to sign every frame.

    Raises:
        PortInUse: the local port cannot be bound.
    """

    def __init__(
        self,
        name: str,
        host: str,
        ports: LinkConfig,
        rates: Mapping[int, float],
        first_s: Mapping[int, float],
        system_id: int,
        sign: bool = False,
    ):
        self.name = name
        self._first_peer = (host, ports.remote_port)
        self.counters: Counter[str] = Counter()
        """`received`, `sent`, `bad` (no MAVLink), `send_failed`."""
        self._mav = mavlink.MAVLink(None, system_id, 1)
        if sign:
            self._mav.signing.secret_key = _SECRET_KEY
            self._mav.signing.sign_outgoing = True
        self._first_s = first_s
        self._default_hz = dict(rates)
        self._socket = _bind(name, host, ports.local_port)
        self.restart()

    def restart(self) -> None:
        """Begin as at the first start: first peer, default rates, clock at 0, sequence at 0."""
        self.peer: tuple[str, int] = self._first_peer
        """Where messages go."""
        self.peer_is_ground_station = False
        """Whether the newest heartbeat of a peer was a ground station's."""
        self._period_s = {message_id: 1.0 / hz for message_id, hz in self._default_hz.items()}
        self._due = [(self._first_s.get(message_id, 0.0), message_id) for message_id in self._default_hz]
        heapq.heapify(self._due)
        self._peer_heard_s = -_PEER_SILENT_S
        self._mav.seq = 0

    def close(self) -> None:
        """Free the port."""
        self._socket.close()

    def send(self, message: Message) -> None:
        """Send one message to the peer; a full socket or an absent peer loses it, as UDP does."""
        self.forward(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) & 0xFF

    def forward(self, frame: bytes) -> None:
        """Send a finished frame."""
        try:
            self._socket.sendto(frame, self.peer)
            self.counters["sent"] += 1
        except OSError:
            self.counters["send_failed"] += 1

    def send_due(self, t_s: float, telemetry: Telemetry) -> None:
        """Send what is due at this autopilot time."""
        due = self._due
        while due and due[0][0] <= t_s:
            at_s, message_id = due[0]
            period_s = self._period_s[message_id]
            # keep the mean rate, but never send a backlog
            heapq.heapreplace(due, (max(at_s + period_s, t_s + 0.5 * period_s), message_id))
            message = telemetry.build(message_id)
            if message is not None:
                self.send(message)

    def interval_us(self, message_id: int) -> int:
        """Interval of a message, µs; -1 when it is not sent."""
        period_s = self._period_s.get(message_id)
        return -1 if period_s is None else round(period_s * 1e6)

    def set_interval(self, message_id: int, interval_us: float, t_s: float) -> None:
        """Change how often a message is sent.

        Args:
            message_id: MAVLink identifier.
            interval_us: µs; 0 for the link's default, negative for never.
            t_s: autopilot time now, s.
        """
        self._due = [entry for entry in self._due if entry[1] != message_id]
        heapq.heapify(self._due)
        self._period_s.pop(message_id, None)
        if interval_us == 0:
            hz = self._default_hz.get(message_id, 0.0)
        else:
            hz = 1e6 / interval_us if interval_us > 0 else 0.0
        if hz > 0.0:
            self._period_s[message_id] = 1.0 / hz
            heapq.heappush(self._due, (max(t_s, self._first_s.get(message_id, 0.0)), message_id))

    def receive(self, t_s: float) -> list[Message]:
        """Messages that have arrived; the sender becomes the peer when the peer has been silent for 3 s."""
        messages: list[Message] = []
        while True:
            try:
                datagram, sender = self._socket.recvfrom(_LONGEST_DATAGRAM)
            except BlockingIOError:
                return messages
            except OSError:
                self.counters["bad"] += 1
                continue
            found = self._parse(datagram)
            if not found:
                continue
            if sender != self.peer and t_s - self._peer_heard_s >= _PEER_SILENT_S:
                self.peer = sender
            if sender == self.peer:
                self._peer_heard_s = t_s
            messages.extend(found)

    def _parse(self, datagram: bytes) -> list[Message]:
        """MAVLink messages of a datagram; a parser each, so that garbage never spoils the next one."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        found = parser.parse_buffer(datagram) or []
        good = [message for message in found if message.get_type() != "BAD_DATA"]
        self.counters["received"] += len(good)
        self.counters["bad"] += len(found) - len(good) or not good
        return good


def _bind(name: str, host: str, port: int) -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        link.bind((host, port))
    except OSError as error:
        link.close()
        raise PortInUse(
            f"autopilot.{name}.local_port: got UDP {host}:{port} ({error.strerror}), expected a free local port; end"
            f" the other autopilot or PX4, or set another port"
        ) from None
    link.setblocking(False)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_QUEUE_BYTES)
    return link
