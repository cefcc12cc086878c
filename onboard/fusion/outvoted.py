"""When the one that is heard, since it is where the target was expected, is given up for several that agree."""

from __future__ import annotations

from collections.abc import Mapping

from common.tracking.base import Box
from onboard.fusion.doubt import same_as
from onboard.fusion.lasting import Lasting

_AFTER_S, _BREAK_S = 0.5, 0.2
"""How long they must have agreed, s, and the longest break in that."""
_MANY = 3
"""How many are believed whatever they look like."""


class Outvoted:
    """Watches for how long several have agreed against one."""

    def __init__(self) -> None:
        self._held = Lasting(_BREAK_S)

    def by(
        self, similar: Mapping[str, float], boxes: Mapping[str, Box], others: frozenset[str], t_ns: int
    ) -> tuple[str, ...]:
        """Two trackers or more of which some were not heard, once they have agreed for long against the one that was.

        Two must look no less like the target: then they are the majority, and the answer has gone astray with the one.
        Once it has gone over to them, it stays with them while two agree.

        Args:
            similar: likeness of each tracker's box, 0 to 1.
            boxes: the same trackers' boxes, px.
            others: who would not be heard, by where their box is.
            t_ns: stamp of the picture, ns.
        """
        groups = [{name, *same_as(name, boxes)} for name in others]
        group: set[str] = max(groups, key=len, default=set())
        against = boxes.keys() - others - group
        many = 2 if self._held.so_far(t_ns) >= _AFTER_S else _MANY
        outvoted = len(against) == 1 and len(group) >= 2
        if outvoted and len(group) < many:
            outvoted = max(similar[name] for name in group) >= similar[next(iter(against))]
        return tuple(sorted(group)) if self._held.note(outvoted, t_ns) >= _AFTER_S else ()
