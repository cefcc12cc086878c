"""People drawn on a picture: box, skeleton, number."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from common.messages import BONES
from onboard.people.findings import Found
from onboard.people.pose import Picture

_COLOURS = (
    (80, 200, 60), (40, 120, 255), (230, 160, 40), (200, 60, 200), (60, 220, 230), (240, 90, 90), (120, 240, 160),
)  # fmt: skip
_SEEN = 0.5


def draw(picture: Picture, people: Sequence[Found], note: str = "") -> Picture:
    """A copy of a picture (H, W, 3), BGR, with everybody on it and a note in its corner."""
    shown = picture.copy()
    for found in people:
        colour = _COLOURS[found.number % len(_COLOURS)]
        x, y, width, height = found.box_px
        cv2.rectangle(shown, (x, y), (x + width, y + height), colour, 2)
        joints = np.round(found.pose.joints_px).astype(int)
        for start, end in BONES:
            if min(found.pose.confidence[[start, end]]) > _SEEN:
                cv2.line(shown, joints[start].tolist(), joints[end].tolist(), colour, 2, cv2.LINE_AA)
        _write(shown, str(found.number), (x, max(y - 5, 12)), colour)
    if note:
        _write(shown, note, (6, 16), (255, 255, 255))
    return shown


def _write(picture: Picture, text: str, place: tuple[int, int], colour: tuple[int, int, int]) -> None:
    for ink, width in (((0, 0, 0), 3), (colour, 1)):
        cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, ink, width, cv2.LINE_AA)
