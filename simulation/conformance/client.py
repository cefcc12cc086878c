"""A raw MAVLink client: it sees every message and every acknowledgement, and keeps a setpoint stream at its rate.

One thread, one loop: `run` sends what is due and collects what arrives, until a time or a condition. Its clock is the
wire's.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from simulation.conformance.wire import Wire

GROUND_STATION, COMPANION = 6, 18
_COMPANION_ADDRESS, _STATION_ADDRESS = (245, 191), (255, 190)
_NO_AUTOPILOT = 8
Stream = Callable[[], Any]
_KEPT = 60000
_REPLY_S = 1.5
_HEARTBEAT_S = 1.0


@dataclass(frozen=True)
class Seen:
    """A message of the autopilot and when it came."""

    t_s: float
    """Time of receipt on the wire's clock, s."""
    message: Any
    """The pymavlink message."""


class Client:
    """The conversation with one autopilot, as a companion computer or as a ground station on the same link.

    Args:
        wire: what carries it.
    """

    def __init__(self, wire: Wire):
        self.wire = wire
        self.seen: deque[Seen] = deque(maxlen=_KEPT)
        """Messages of the autopilot, oldest first."""
        self.latest: dict[str, Seen] = {}
        """The newest message of each name."""
        self.others: dict[tuple[int, int], Seen] = {}
        """Newest heartbeat of everybody else on the vehicle's network, by system and component."""
        self.target: tuple[int, int] | None = None
        """System and component of the autopilot, once heard."""
        self.station_beats = False
        """Whether a ground station's heartbeat is sent too."""
        self.stream: Stream | None = None
        """Makes the setpoint that is streamed; None for no stream."""
        self.stream_hz = 20.0
        """Rate of that stream."""
        self._voices = {s: mavlink.MAVLink(None, *s) for s in (_COMPANION_ADDRESS, _STATION_ADDRESS)}
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._beat_due_s = self._stream_due_s = -math.inf
        self._streaming: Stream | None = None

    @property
    def now_s(self) -> float:
        """The wire's time, s."""
        return self.wire.now_s()

    def sign(self, key: bytes | None) -> None:
        """Sign all frames from now on with a key of 32 bytes, or none of them."""
        for voice in self._voices.values():
            voice.signing.secret_key = key
            voice.signing.sign_outgoing = key is not None
            voice.signing.timestamp = max(voice.signing.timestamp, 1)

    def send(self, message: Any, station: bool = False) -> None:
        """Send a message as companion, or as ground station."""
        voice = self._voices[_STATION_ADDRESS if station else _COMPANION_ADDRESS]
        self.wire.send(message.pack(voice))
        voice.seq = (voice.seq + 1) & 0xFF

    def run(self, duration_s: float, until: Callable[[], bool] | None = None) -> bool:
        """Live for a while: heartbeats and stream go out, messages come in.

        Args:
            duration_s: how long at most, s.
            until: looked at after each arrival; ends the wait when true.

        Returns:
            Whether the condition came true; True without one.
        """
        end_s = self.now_s + duration_s
        over = False
        while not (until is not None and until()):
            if over:
                return until is None
            now_s = self.now_s
            over = now_s >= end_s  # what came while this process had no core is looked at all the same
            self._send_due(now_s)
            due_s = min(end_s, self._beat_due_s, self._stream_due_s if self.stream else math.inf)
            for chunk in self.wire.receive(due_s):
                self._take(chunk)
        return True

    def _send_due(self, now_s: float) -> None:
        if now_s >= self._beat_due_s:
            self._beat_due_s = now_s + _HEARTBEAT_S
            self.send(mavlink.MAVLink_heartbeat_message(COMPANION, _NO_AUTOPILOT, 0, 0, 0, 3))
            if self.station_beats:
                self.send(mavlink.MAVLink_heartbeat_message(GROUND_STATION, _NO_AUTOPILOT, 0, 0, 0, 3), station=True)
        if self.stream is None:
            self._streaming = None
            return
        if self._streaming is not self.stream:  # a new setpoint goes out at once
            if self._streaming is None or self.stream_hz > 5.0:
                self._stream_due_s = now_s
            self._streaming = self.stream
        if now_s >= self._stream_due_s:
            self.send(self.stream())
            self._stream_due_s = max(self._stream_due_s, now_s - 0.5 / self.stream_hz) + 1.0 / self.stream_hz

    def _take(self, chunk: bytes) -> None:
        now_s = self.now_s
        message: Any
        for message in self._parser.parse_buffer(chunk) or []:
            kind, sender = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
            if kind == "HEARTBEAT":
                if message.autopilot == _NO_AUTOPILOT:
                    self.others[sender] = Seen(now_s, message)
                elif self.target is None:
                    self.target = sender
            if kind == "BAD_DATA" or (self.target is not None and sender != self.target):
                continue
            self.latest[kind] = seen = Seen(now_s, message)
            self.seen.append(seen)

    # ------------------------------------------------------------ looking back

    def since(self, t_s: float, *names: str) -> list[Seen]:
        """Messages of these names received after a time, oldest first."""
        found: list[Seen] = []
        for seen in reversed(self.seen):
            if seen.t_s <= t_s:
                break
            if not names or seen.message.get_type() in names:
                found.append(seen)
        return found[::-1]

    def await_message(self, name: str, timeout_s: float = _REPLY_S) -> Any:
        """The next message of a name, or None."""
        start = self.latest.get(name)
        self.run(timeout_s, lambda: self.latest.get(name) is not start)
        newest = self.latest.get(name)
        return None if newest is start or newest is None else newest.message

    # ------------------------------------------------------------ asking

    @property
    def address(self) -> tuple[int, int]:
        """System and component to speak to; everybody while the autopilot is unknown."""
        return self.target or (0, 0)

    def command(
        self, command: int, *values: float, station: bool = False, settle_s: float = 0.0, timeout_s: float = _REPLY_S
    ) -> list[tuple[float, int]]:
        """Send COMMAND_LONG and collect its acknowledgements.

        Args:
            command: MAV_CMD.
            values: the first parameters; the others are NaN.
            station: speak as the ground station.
            settle_s: how long to listen on after the first acknowledgement, for a second one, s.
            timeout_s: how long to wait for the first, s.

        Returns:
            (time of receipt, MAV_RESULT) of each acknowledgement.
        """
        padded = [*values, *([math.nan] * (7 - len(values)))]
        sent_s = self.now_s
        self.send(mavlink.MAVLink_command_long_message(*self.address, command, 0, *padded), station)

        def acknowledged() -> list[tuple[float, int]]:
            acks = self.since(sent_s, "COMMAND_ACK")
            return [(s.t_s, s.message.result) for s in acks if s.message.command == command]

        self.run(timeout_s, lambda: bool(acknowledged()))
        if settle_s > 0.0:
            self.run(settle_s)
        return acknowledged()

    def interval(self, message_id: int, hz: float) -> None:
        """Ask for a message at a rate; 0 restores the link's default."""
        self.command(511, message_id, 1e6 / hz if hz > 0 else 0.0)

    def param_read(self, name: str) -> Any:
        """PARAM_VALUE of a parameter, or None when it is not answered."""
        return self._param(name, mavlink.MAVLink_param_request_read_message(*self.address, name.encode(), -1))

    def param_write(self, name: str, raw: float, wire_type: int) -> Any:
        """PARAM_VALUE that answers a write, or None."""
        return self._param(name, mavlink.MAVLink_param_set_message(*self.address, name.encode(), raw, wire_type))

    def _param(self, name: str, request: Any) -> Any:
        for _ in range(3):
            sent_s = self.now_s
            self.send(request)

            def answers(since_s: float = sent_s) -> list[Any]:
                values = (s.message for s in self.since(since_s, "PARAM_VALUE"))
                return [v for v in values if v.param_id.rstrip("\x00") == name]

            if self.run(0.7, lambda answers=answers: bool(answers())):
                return answers()[-1]
        return None
