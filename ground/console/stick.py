"""The operator's stick: what the pages that hold it ask for, and when nobody may be believed any more.

Nothing is latched. A page says every 50 ms how its stick stands; one that falls silent, or whose connection has fallen
behind, counts as let go. One hand alone moves the vehicle: where a second one joins or moves too, everybody has to let
go first.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import NamedTuple

import msgspec

from common.messages import Request

SILENT_S = 0.2
"""A page that said nothing for so long holds the stick no longer, s."""
BEHIND_S = 0.5
"""A page whose newest word from the console is older than this, s, has fallen behind: its stick does not count."""
_GAP_S = 0.5  # a hiccup of the network may pass; after a longer one the hand has to prove that it still is there
_HOVER_S = 0.3
_PERIOD_S = 0.04  # steps come at 20 Hz and for each picture: not every one needs a request


class StickError(ValueError):
    """What a page sent is no position of a stick; the text says why."""


class Stand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the stick of a page stands, each axis -1 to 1."""

    beat: int
    """The newest beat of the console that the page has heard: the console's clock, ms."""
    forward: float = 0.0
    """Along the vehicle's heading."""
    right: float = 0.0
    """To its right."""
    up: float = 0.0
    """Climb."""
    turn: float = 0.0
    """Heading rate, clockwise seen from above."""

    @property
    def axes(self) -> tuple[float, float, float, float]:
        """Forward, right, up, turn."""
        return self.forward, self.right, self.up, self.turn

    @property
    def centred(self) -> bool:
        """Whether it asks for nothing."""
        return self.axes == (0.0, 0.0, 0.0, 0.0)


def read_stand(text: str | bytes) -> Stand:
    """The position that a page sent as JSON.

    Raises:
        StickError: malformed, an unknown field, or an axis outside -1 to 1.
    """
    try:
        stand = msgspec.json.decode(text, type=Stand)
    except msgspec.MsgspecError as error:
        raise StickError(f"stick: got {str(text)[:80]!r}, expected beat and four axes ({error})") from None
    if not all(-1.0 <= axis <= 1.0 for axis in stand.axes):
        raise StickError(f"stick: got {stand.axes}, expected each axis within -1 to 1")
    return stand


@dataclass(frozen=True)
class Speeds:
    """What the full deflection of an axis asks for."""

    level_m_s: float
    """Horizontally, m/s."""
    climb_m_s: float
    """Vertically, m/s."""
    turn_rad_s: float
    """Heading rate, rad/s."""


class Asked(NamedTuple):
    """What the stick asks for now."""

    request: Request
    """Velocity in the `heading` frame."""
    heard_ns: int
    """When the page said so (console's clock); for a hover of the console's own, now."""


@dataclass
class _Hand:
    """One page that holds the stick."""

    stand: Stand | None = None
    heard_ns: int = 0
    void: bool = False
    """Whether it has to let go before it counts again."""

    def fault(self, t_ns: int) -> str:
        """Why its stick does not count, empty when it does."""
        if self.stand is None or (t_ns - self.heard_ns) / 1e9 > SILENT_S:
            return "the page is silent"
        if self.heard_ns / 1e6 - self.stand.beat > BEHIND_S * 1e3:
            return f"the connection is slow ({self.heard_ns / 1e6 - self.stand.beat:.0f} ms): hover"
        return "let go and push again" if self.void else ""


class Stick:
    """What all pages ask for together. Pages speak from the server's thread, the node asks from its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._hands: dict[int, _Hand] = {}
        self._joined = 0
        self._moved_ns: int | None = None
        self._asked_ns = 0

    @property
    def hands(self) -> int:
        """Pages that hold the stick."""
        return len(self._hands)

    def join(self) -> int:
        """A page takes hold; returns its number. Whoever moves the stick meanwhile has to let go and push again."""
        with self._lock:
            for hand in self._hands.values():
                hand.void |= hand.stand is not None and not hand.stand.centred
            self._joined += 1
            self._hands[self._joined] = _Hand()
            return self._joined

    def leave(self, number: int) -> None:
        """A page lets go for good."""
        with self._lock:
            self._hands.pop(number, None)

    def move(self, number: int, stand: Stand, t_ns: int) -> None:
        """A page says how its stick stands; after a long silence it has to let go first."""
        with self._lock:
            hand = self._hands[number]
            hand.void |= hand.stand is not None and (t_ns - hand.heard_ns) / 1e9 > _GAP_S
            hand.void &= not stand.centred
            hand.stand, hand.heard_ns = stand, t_ns

    def note(self, number: int, t_ns: int) -> str:
        """Why a page's stick does not count, in words for its operator; empty when it does."""
        with self._lock:
            hand = self._hands.get(number)
            fault = "" if hand is None or hand.stand is None else hand.fault(t_ns)
            others = len(self._hands) - 1
        return f"{fault} (another page holds the stick too)" if fault and others > 0 else fault

    def ask(self, t_ns: int, speeds: Speeds) -> Asked | None:
        """The request that is due, or None: between two requests, and while nobody moves the stick.

        After the last motion an explicit hover goes out for 0.3 s, so that the vehicle need not wait for the request
        before to grow stale; then nothing, and helm holds.

        Args:
            t_ns: console's clock, ns.
            speeds: at full deflection.
        """
        with self._lock:
            if (t_ns - self._asked_ns) / 1e9 < _PERIOD_S:
                return None
            moving = [h for h in self._hands.values() if not h.fault(t_ns) and h.stand and not h.stand.centred]
            if len(moving) > 1:
                for hand in moving:
                    hand.void = True
                moving = []
            if moving and moving[0].stand is not None:
                self._moved_ns = self._asked_ns = t_ns
                return Asked(request_of(moving[0].stand, speeds), moving[0].heard_ns)
            if self._moved_ns is None or (t_ns - self._moved_ns) / 1e9 > _HOVER_S:
                return None
            self._asked_ns = t_ns
            return Asked(Request(frame="heading", vector=(0.0, 0.0, 0.0)), t_ns)


def request_of(stand: Stand, speeds: Speeds) -> Request:
    """Velocity in the `heading` frame for a position of the stick; a diagonal is no faster than an axis."""
    length = max(math.hypot(stand.forward, stand.right), 1.0)
    level = speeds.level_m_s / length
    return Request(
        frame="heading",
        vector=(stand.forward * level, stand.right * level, -stand.up * speeds.climb_m_s),
        yaw_rate_rad_s=stand.turn * speeds.turn_rad_s,
    )
