"""What the operator chose to follow: the pictures since then, so that trackers that come up later catch up."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from common.messages import Reply
from common.node import CommandCall
from common.tracking.base import Box

if TYPE_CHECKING:
    from onboard.follow.follower import Follower

_KEPT = 16
"""Pictures that are kept: at 20 Hz 0.8 s of them, in which an operator's box must come."""
_LATEST_NS = 100_000_000
"""How far from the stamp that a box names its picture may be, ns."""
_EVERY_NS = 90_000_000
"""Of the pictures that wait for the trackers ten a second are enough, ns."""
_WAITING_S = 12.0
"""How long a command waits for the trackers to come up, s: on a busy machine that takes seconds."""
_AT_ONCE_S = 0.5
"""How long the node's loop may be held at once while they catch up, s."""


class Picture(NamedTuple):
    """One picture."""

    t_ns: int
    """Its capture stamp, ns."""
    frame: np.ndarray
    """(H, W, 3) uint8 BGR."""


class Pictures:
    """The newest pictures, of which a box may name one."""

    def __init__(self) -> None:
        self._kept: deque[Picture] = deque(maxlen=_KEPT)

    def keep(self, picture: Picture) -> None:
        """Keep one, instead of the oldest."""
        self._kept.append(picture)

    def since(self, capture_ns: int) -> list[Picture]:
        """The picture of this stamp (0: the newest), ns, and all after it.

        Raises:
            ValueError: it is not kept.
        """
        if not capture_ns:
            capture_ns = self._kept[-1].t_ns if self._kept else 0
        named = min(self._kept, key=lambda p: abs(p.t_ns - capture_ns), default=None)
        if named is None or abs(named.t_ns - capture_ns) > _LATEST_NS:
            raise ValueError("got a box on a picture that is not kept; draw it on the live picture")
        return [p for p in self._kept if p.t_ns >= named.t_ns]


class Choice:
    """A target on its way to the trackers; they may still be coming up.

    Args:
        call: the command, answered by `advance` or `supersede`.
        box: x, y, width, height before the rotation, px.
        pictures: the one that the box was drawn on, and all since.
        t_ns: now, ns.
    """

    def __init__(self, call: CommandCall, box: Box, pictures: list[Picture], t_ns: int):
        self._call, self._box = call, box
        self._pictures = deque(pictures)
        self._until_ns = t_ns + round(_WAITING_S * 1e9)
        self._begun = False

    def add(self, picture: Picture) -> None:
        """One more has come."""
        if picture.t_ns - self._pictures[-1].t_ns >= _EVERY_NS:
            self._pictures.append(picture)

    def supersede(self, follower: Follower | None, by: str) -> None:
        """Another command has come: this one comes to nothing, and what it had begun is not followed."""
        self._end("refused", f"superseded by {by}", follower)

    def _end(self, outcome: Literal["refused", "failed"], reason: str, follower: Follower | None) -> None:
        """Answer that it comes to nothing; a target from before is kept unless this one has replaced it."""
        if self._begun and follower is not None:
            follower.drop()
        self._call.reply(Reply(outcome=outcome, reason=f"select: {reason}"))

    def advance(self, follower: Follower | None, t_ns: int) -> bool:
        """Give the trackers what they have not seen, for half a second at most; whether it is answered.

        Args:
            follower: None while it is not made.
            t_ns: now, ns.
        """
        if follower is None or not (self._begun or follower.fusion.pool.await_ready(0.0)):
            if t_ns < self._until_ns:
                return False
            told = f"the trackers did not start within {_WAITING_S:g} s; see this node's log, try again"
            self._end("failed", told, follower)
            return True
        try:
            self._catch_up(follower)
        except ValueError as error:
            self._end("refused", str(error), follower)
            return True
        if len(self._pictures) > 1:
            return False
        self._call.reply(Reply(outcome="done", reason="the trackers have it; it is flown after once you follow"))
        return True

    def _catch_up(self, follower: Follower) -> None:
        end_s = time.monotonic() + _AT_ONCE_S
        if not self._begun:
            follower.select(self._pictures[0], self._box, self._call.command.angle_rad)
            self._begun = True
        while len(self._pictures) > 1 and time.monotonic() < end_s:  # the last one named stays, for its stamp
            self._pictures.popleft()
            follower.fusion.catch_up(self._pictures[0].frame, self._pictures[0].t_ns)
