"""What the target's place says of trackers' boxes, where somebody knows it: who is at it, and what stands there.

`foreseen.py` judges one picture. Here is what needs several: who has been elsewhere for long, who agree elsewhere for
long, and for how long a thing has been believed that no tracker knows.
"""

from __future__ import annotations

from collections.abc import Mapping

from common.evaluation import jaccard
from common.tracking.base import Box
from onboard.fusion.doubt import together
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.lasting import Lasting
from onboard.fusion.silhouette import SILHOUETTE

_ON_IT, _IT = 0.4, 0.6
"""Least overlap with the one thing that is no part of the surroundings of who is heard beside it, and who is right."""
_SOLID_ALONE_S, _SOLID = 3.0, 0.6
"""How long the depth camera's thing is heard by itself, s: then it may be anything that stands there. And its
confidence: of several things it may be the wrong one."""
_DISPUTED_S, _EMPTY_S, _BREAK_S = 0.3, 0.3, 0.2
"""How long two trackers or more must have agreed where the target is not foreseen for them to be heard, s; how long its
place must have been empty for any to be; and the longest break in that."""
_ASTRAY_S = 0.3
"""How long a tracker must have been where, or as large as, the target cannot be for it to be put on the answer, s."""


class PlaceCheck:
    """Holds trackers' boxes against the target's place, picture by picture.

    Args:
        t_ns: stamp of the first picture, ns.
    """

    def __init__(self, t_ns: int):
        self._t_ns = self._seen_ns = t_ns
        self._disputed, self._empty = Lasting(_BREAK_S), Lasting(_BREAK_S)
        self._contested, self._unbroken, self._thing_ns = False, False, t_ns
        self._foreseen: Foreseen | None = None
        self._whole: Box | None = None
        self._astray: dict[str, int] = {}

    def look(self, t_ns: int, foreseen: Foreseen | None, shape: tuple[int, ...]) -> None:
        """Take in where the target is foreseen in the next picture, of a stamp, ns, and a shape; None: unknown."""
        self._t_ns, self._foreseen = t_ns, foreseen
        self._whole = None if foreseen is None else foreseen.whole(shape)

    @property
    def box(self) -> Box | None:
        """Where the target is foreseen, px; None: unknown."""
        return None if self._foreseen is None else self._foreseen.box

    @property
    def thing(self) -> tuple[Box, float] | None:
        """What stands at the target's place, px, and how sure it is to be it; None where nobody can tell.

        The one thing that is no part of the surroundings; or one of several by the depth camera, unless no tracker has
        seen the target for long.
        """
        if self._whole is not None:
            return self._whole, 1.0
        return None if self._solid is None else (self._solid, _SOLID)

    @property
    def _solid(self) -> Box | None:
        alone = self._t_ns - self._seen_ns > _SOLID_ALONE_S * 1e9
        return None if self._foreseen is None or alone or self._contested else self._foreseen.solid

    @property
    def astray(self) -> frozenset[str]:
        """Trackers that have for some time been where, or as large as, the target cannot be, whatever they see."""
        return frozenset(n for n, since_ns in self._astray.items() if self._t_ns - since_ns >= _ASTRAY_S * 1e9)

    def is_it(self, box: Box) -> bool:
        """Whether a box, px, is on the one thing that is no part of the surroundings."""
        return self._whole is not None and jaccard(box, self._whole) > _IT

    def on_thing(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers whose box, px, is on what stands at the target's place."""
        thing = self.thing
        return frozenset(n for n, box in boxes.items() if thing is not None and jaccard(box, thing[0]) > _IT)

    def seen(self) -> None:
        """A tracker sees the target in the newest picture."""
        self._seen_ns = self._t_ns

    def put(self, name: str) -> None:
        """A tracker was put on the answer."""
        self._astray.pop(name, None)

    def excluded(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers that are at something else; notes since when, and who has another size. Boxes in px."""
        self._contested = False
        self._watch_thing(boxes)
        if self._foreseen is None:
            self._astray.clear()
            return frozenset()
        excluded = self._foreseen.excluded(boxes)
        excluded -= self._majority(self._foreseen, boxes, excluded)
        if self._whole is not None:
            excluded |= {name for name, box in boxes.items() if jaccard(box, self._whole) < _ON_IT}
        for name, box in boxes.items():
            if name in excluded or self._foreseen.grown(box) != 0.0:
                self._astray.setdefault(name, self._t_ns)
            else:
                self._astray.pop(name, None)
        return excluded

    def _watch_thing(self, boxes: Mapping[str, Box]) -> None:
        """Note whether what stands there has been there without a break since a tracker was last on it."""
        if self._t_ns - self._thing_ns > _BREAK_S * 1e9:
            self._unbroken = False
        if self._solid is not None:
            self._thing_ns, self._unbroken = self._t_ns, self._unbroken or bool(self.on_thing(boxes))

    def _majority(self, foreseen: Foreseen, boxes: Mapping[str, Box], excluded: frozenset[str]) -> frozenset[str]:
        """Trackers at another distance than foreseen that are believed for all that.

        Several that have agreed for long, against no more than one that is not: what is foreseen rests on who was
        heard; where that one went astray, so did it. Against several, what stands there has no say, unless it has been
        there ever since a tracker saw the target in it: it knows no look. And any, where the target's place has been
        empty for long.
        """
        away = foreseen.of_his_size({name: boxes[name] for name in excluded})
        group = together({name: boxes[name] for name in away})
        stands = self._unbroken and self._solid is not None
        disputed = len(group) >= 2 and len(boxes) - len(excluded) <= 1 and not stands
        self._contested = disputed and not self.on_thing(boxes)
        if self._empty.note(foreseen.empty, self._t_ns) >= _EMPTY_S:
            return away
        return group if self._disputed.note(disputed, self._t_ns) >= _DISPUTED_S else frozenset()

    def confirmed(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers that agree with another, or with what stands there, where the depth camera has the target."""
        if self._foreseen is None:
            return frozenset()
        there = self._foreseen.confirmed(boxes)
        thing = {} if self._solid is None else {SILHOUETTE.name: self._solid}
        return together({n: box for n, box in boxes.items() if n in there} | thing) - {SILHOUETTE.name}

    def fitted(self, box: Box) -> Box:
        """A tracker's box, px, no larger and no smaller than the target can look."""
        return box if self._foreseen is None else self._foreseen.fitted(box)
