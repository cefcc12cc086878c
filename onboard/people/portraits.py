"""A picture of each person: the best of late, for the operator."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import cv2
import numpy as np

from common.messages import PersonPicture
from onboard.people.findings import Found
from onboard.people.pose import Picture

_MARGIN = 0.15
_QUALITY = 80
_FADE_S = 20.0
"""A picture loses half of its worth in this time, so that a newer one takes its place."""


@dataclass
class _Portrait:
    picture: Picture
    taken_ns: int
    worth: float
    told: bool = False


class Portraits:
    """Keeps a picture of each person and says which one to send next.

    Args:
        side_px: longest side of a picture that is sent, px.
    """

    def __init__(self, side_px: int):
        self._side_px = side_px
        self._kept: dict[int, _Portrait] = {}
        self._turn = 0

    def see(self, found: Found, picture: Picture, t_ns: int) -> None:
        """Take a picture of a person, if it is worth more than the one there is: larger, clearer, newer."""
        x, y, width, height = found.sight.region.box_px
        worth = float(found.pose.confidence.mean()) * (width * height) ** 0.5
        kept = self._kept.get(found.number)
        if kept is not None and worth < kept.worth * 0.5 ** ((t_ns - kept.taken_ns) / 1e9 / _FADE_S):
            return
        margin = round(_MARGIN * max(width, height))
        low = max(x - margin, 0), max(y - margin, 0)
        cut = picture[low[1] : y + height + margin, low[0] : x + width + margin]
        self._kept[found.number] = _Portrait(cut.copy(), t_ns, worth, told=kept is not None and kept.told)

    def keep(self, numbers: Collection[int]) -> None:
        """Forget everybody else."""
        self._kept = {number: kept for number, kept in self._kept.items() if number in numbers}

    def next(self, wanted: Collection[int]) -> PersonPicture | None:
        """The picture to send now: of somebody who was not shown yet, else of each in turn; None without any.

        Args:
            wanted: numbers of those who may be shown.
        """
        there = sorted(number for number in self._kept if number in wanted)
        if not there:
            return None
        fresh = [number for number in there if not self._kept[number].told]
        later = [number for number in there if number > self._turn] or there
        number = fresh[0] if fresh else later[0]
        self._turn = number
        kept = self._kept[number]
        kept.told = True
        height, width = kept.picture.shape[:2]
        scale = min(1.0, self._side_px / max(height, width))
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        small = cv2.resize(kept.picture, size, interpolation=cv2.INTER_AREA)
        ok, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        if not ok:
            raise RuntimeError(f"JPEG encoding failed for a {size[0]}x{size[1]} picture")
        return PersonPicture(number=number, taken_ns=kept.taken_ns, jpeg=np.asarray(jpeg).tobytes())
