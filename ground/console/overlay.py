"""The picture as the operator sees it: fitted into the browser's window, with target box, age and state drawn on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.messages import BONES, MemberBox, PersonDetection, Track

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

# RGB, as the browser side expects it; the same tones as the style sheet.
GREEN: Colour = (61, 220, 132)
ORANGE: Colour = (255, 159, 28)
RED: Colour = (255, 90, 82)
GREY: Colour = (150, 158, 167)
WHITE: Colour = (240, 244, 248)
BLUE: Colour = (74, 168, 255)
MEMBER_COLOURS: tuple[Colour, ...] = ((255, 214, 90), (214, 140, 255), (120, 230, 230), (255, 150, 170))
"""Of the trackers that the follower is fused from, in their order."""
_FRAME: Colour = (13, 17, 23)
_SURE = 0.3  # a joint less sure than this is not drawn
_ASPECT_RANGE = (0.3, 4.0)
_WORD_PX, _NAME_PX, _FOOT_PX = 18, 15, 36
"""Height of a word's ground, of a line of names, and of the rows below that belong to the captions, px."""


@dataclass(frozen=True)
class Letterbox:
    """Where a picture lies on a canvas of another shape; the canvas is as large as the picture needs, px."""

    width: int
    """Columns of the canvas."""
    height: int
    """Rows of the canvas."""
    left: int
    """Column of the picture's left edge."""
    top: int
    """Row of the picture's upper edge."""
    picture_width: int
    """Columns of the picture."""
    picture_height: int
    """Rows of the picture."""

    @classmethod
    def fit(cls, picture_width: int, picture_height: int, aspect: float) -> Letterbox:
        """Smallest canvas with a given width to height ratio around a picture at its own size.

        It is centred, or at the top of a canvas that is taller than wide: a phone's, whose lower part the panel covers.
        """
        aspect = min(max(aspect, _ASPECT_RANGE[0]), _ASPECT_RANGE[1])
        width = max(picture_width, round(picture_height * aspect))
        height = max(picture_height, round(picture_width / aspect))
        top = 0 if aspect < 1.0 else (height - picture_height) // 2
        return cls(width, height, (width - picture_width) // 2, top, picture_width, picture_height)

    def to_picture(self, u: float, v: float) -> tuple[float, float]:
        """Picture position (x, y), px, of a canvas position in 0..1; outside the picture it is out of its range."""
        return u * self.width - self.left, v * self.height - self.top

    def box(
        self, corner_min: tuple[float, float], corner_max: tuple[float, float]
    ) -> tuple[float, float, float, float] | None:
        """Box (x, y, width, height) in the picture, px, of two canvas corners in 0..1, cut at the picture's edge.

        Returns:
            None when nothing of it lies in the picture.
        """
        (x0, y0), (x1, y1) = self.to_picture(*corner_min), self.to_picture(*corner_max)
        x0, x1 = max(0.0, x0), min(float(self.picture_width), x1)
        y0, y1 = max(0.0, y0), min(float(self.picture_height), y1)
        return (x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None


@dataclass(frozen=True)
class Caption:
    """A word in a corner of the picture."""

    text: str
    """The word."""
    colour: Colour
    """Of its dot."""


class Painter:
    """Draws on pictures, in place."""

    def __init__(self) -> None:
        self._font = cv2.FontFace("sans")

    def target(self, picture: Pixels, track: Track) -> None:
        """Draw the target's rotated rectangle: green when tracked, orange and dashed when lost."""
        self._rectangle(picture, track, GREEN)

    def followed(self, picture: Pixels, track: Track, members: Sequence[MemberBox], obeyed: bool) -> None:
        """Draw the follower's target, blue when seen, orange and dashed when lost, and in thin lines the boxes of the
        trackers that it is fused from, with their names beside it in the same colours; below it, whether helm obeys."""
        coloured = [(m, MEMBER_COLOURS[row % len(MEMBER_COLOURS)]) for row, m in enumerate(members)]
        seeing = [(member, colour) for member, colour in coloured if member.box_px is not None]
        for member, colour in seeing:
            if member.box_px is not None:
                shape = np.round(_rectangle_of(member.box_px) * 16).astype(np.int32).reshape(-1, 1, 2)
                cv2.polylines(picture, [shape], True, colour, 1, cv2.LINE_AA, 4)
        self._rectangle(picture, track, BLUE)
        below = round(track.y_px + track.height_px / 2) + 4
        self.word(picture, round(track.x_px), below, "followed" if obeyed else "to follow")
        self._names(picture, track, [(member.name, colour) for member, colour in seeing])

    def _names(self, picture: Pixels, track: Track, names: Sequence[tuple[str, Colour]]) -> None:
        """Write names one below the other beside the target, to its left where there is no room on the right."""
        if not names:
            return
        wide, high = max(self._width(name, 13, 600) for name, _ in names) + 8, _NAME_PX * len(names) + 4
        left = round(track.x_px + track.width_px / 2) + 6
        if left + wide > picture.shape[1]:
            left = max(0, round(track.x_px - track.width_px / 2) - 6 - wide)
        top = min(max(0, round(track.y_px - track.height_px / 2)), picture.shape[0] - _FOOT_PX - high)
        _shade(picture, left, top, wide, high, 0.6)
        for row, (name, colour) in enumerate(names):
            cv2.putText(picture, name, (left + 4, top + 13 + _NAME_PX * row), colour, self._font, 13, 600)

    def _rectangle(self, picture: Pixels, track: Track, seen: Colour) -> None:
        if track.state == "idle":
            return
        corners = _corners(track)
        colour = seen if track.state == "tracking" else ORANGE
        if track.state == "tracking":
            shape = np.round(corners * 16).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [shape], True, (0, 0, 0), 4, cv2.LINE_AA, 4)
            cv2.polylines(picture, [shape], True, colour, 2, cv2.LINE_AA, 4)
        else:
            _dashed(picture, corners, colour)
        cv2.drawMarker(picture, (round(track.x_px), round(track.y_px)), colour, cv2.MARKER_CROSS, 10, 1, cv2.LINE_AA)

    def person(self, picture: Pixels, found: PersonDetection, word: str, colour: Colour) -> None:
        """Draw somebody's box, skeleton and name; a pose that was only moved along is thinner."""
        x, y, width, height = found.box_px
        shape = np.round(_rectangle_of(found.box_px) * 16).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [shape], True, (0, 0, 0), 4, cv2.LINE_AA, 4)
        cv2.polylines(picture, [shape], True, colour, 2, cv2.LINE_AA, 4)
        sure = [joint[2] >= _SURE for joint in found.joints_px]
        points = [_int(np.asarray(joint[:2])) for joint in found.joints_px]
        thickness = 2 if found.fresh else 1
        for a, b in BONES:
            if sure[a] and sure[b]:
                cv2.line(picture, points[a], points[b], (0, 0, 0), thickness + 2, cv2.LINE_AA)
                cv2.line(picture, points[a], points[b], colour, thickness, cv2.LINE_AA)
        for point, shown in zip(points, sure, strict=True):
            if shown:
                cv2.circle(picture, point, thickness, WHITE, -1, cv2.LINE_AA)
        below = round(y + height) + 4
        # The last rows belong to the captions: there, the name stands above the box.
        fits = below + _WORD_PX <= picture.shape[0] - _FOOT_PX
        self.word(picture, round(x + width / 2), below if fits else round(y) - _WORD_PX - 4, word)

    def mark(self, picture: Pixels, x_px: float, y_px: float, word: str, colour: Colour) -> None:
        """Draw corners around a place and a word below them; nothing where it lies outside the picture."""
        height, width = picture.shape[:2]
        if not (0.0 <= x_px < width and 0.0 <= y_px < height):
            return
        x, y = round(x_px), round(y_px)
        for dx, dy in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
            corner = (x + 14 * dx, y + 14 * dy)
            for end in ((x + 6 * dx, y + 14 * dy), (x + 14 * dx, y + 6 * dy)):
                cv2.line(picture, corner, end, (0, 0, 0), 4, cv2.LINE_AA)
                cv2.line(picture, corner, end, colour, 2, cv2.LINE_AA)
        self.word(picture, x, y + 22, word)

    def word(self, picture: Pixels, x_px: int, y_px: int, word: str) -> None:
        """Write a word centred below a place, within the picture."""
        wide = self._width(word, 13, 600)
        left = min(max(4, x_px - wide // 2), max(4, picture.shape[1] - wide - 4))
        top = min(max(2, y_px), picture.shape[0] - _WORD_PX - 2)
        _shade(picture, left - 4, top, wide + 8, _WORD_PX, 0.6)
        cv2.putText(picture, word, (left, top + 14), WHITE, self._font, 13, 600)

    def aim(self, picture: Pixels) -> None:
        """Draw a small mark at the picture's centre."""
        x, y = picture.shape[1] // 2, picture.shape[0] // 2
        for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            cv2.line(picture, (x + 6 * dx, y + 6 * dy), (x + 14 * dx, y + 14 * dy), WHITE, 1, cv2.LINE_AA)

    def captions(self, picture: Pixels, left: Caption, right: Caption, hint: str = "") -> None:
        """Write the state of the picture bottom left, that of the target bottom right, and a hint between them.

        The upper edge stays free: the browser shows its notes there.
        """
        height, width = picture.shape[:2]
        self._chip(picture, 8, height - 34, left)
        self._chip(picture, width - 8 - self._chip_width(right), height - 34, right)
        if hint:  # in the middle of what the two leave free
            x = (width + self._chip_width(left) - self._chip_width(right) - self._width(hint, 15, 500)) // 2
            _shade(picture, x - 8, height - 34, self._width(hint, 15, 500) + 16, 26, 0.6)
            cv2.putText(picture, hint, (x, height - 16), WHITE, self._font, 15, 500)

    def stale(self, picture: Pixels, title: str, detail: str) -> None:
        """Grey the picture out and say across it that it is no live picture."""
        height, width = picture.shape[:2]
        grey = cv2.convertScaleAbs(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), None, 0.33, 20)
        cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB, picture)
        middle = height // 2
        _shade(picture, 0, middle - 42, width, 84, 0.55)
        lines = ((title, 34, 800, middle + 2, ORANGE), (detail, 16, 500, middle + 28, WHITE))
        for text, size, weight, y, colour in lines:
            cv2.putText(
                picture, text, ((width - self._width(text, size, weight)) // 2, y), colour, self._font, size, weight
            )

    def _width(self, text: str, size: int, weight: int) -> int:
        return cv2.getTextSize((1, 1), text, (0, 0), self._font, size, weight)[2]

    def _chip_width(self, caption: Caption) -> int:
        return self._width(caption.text, 16, 650) + 34

    def _chip(self, picture: Pixels, x: int, y: int, caption: Caption) -> None:
        _shade(picture, x, y, self._chip_width(caption), 26, 0.6)
        cv2.circle(picture, (x + 14, y + 13), 5, caption.colour, -1, cv2.LINE_AA)
        cv2.putText(picture, caption.text, (x + 26, y + 19), WHITE, self._font, 16, 650)


def on_canvas(picture: Pixels, box: Letterbox) -> Pixels:
    """The picture (H, W, 3) on its canvas."""
    canvas = cv2.copyMakeBorder(
        picture,
        box.top,
        box.height - box.top - box.picture_height,
        box.left,
        box.width - box.left - box.picture_width,
        cv2.BORDER_CONSTANT,
        value=_FRAME,
    )
    return np.asarray(canvas, np.uint8)


def blank(width: int, height: int) -> Pixels:
    """A black picture (height, width, 3)."""
    return np.zeros((height, width, 3), np.uint8)


def decode(jpeg: bytes) -> Pixels | None:
    """Pixels (H, W, 3), RGB, of a JPEG file; None when it cannot be read."""
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
    return None if picture is None else np.asarray(picture, np.uint8)


def _rectangle_of(box: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """Corners (4, 2), px, of an upright box, px, in order around it."""
    x, y, width, height = box
    return np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])


def _corners(track: Track) -> NDArray[np.float64]:
    c, s = math.cos(track.angle_rad), math.sin(track.angle_rad)
    half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [track.width_px / 2, track.height_px / 2]
    return half @ np.array([[c, s], [-s, c]]) + [track.x_px, track.y_px]


def _dashed(picture: Pixels, corners: NDArray[np.float64], colour: Colour, dash_px: float = 9.0) -> None:
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        count = max(1, round(length / (2 * dash_px)))
        for i in range(count):
            a, b = start + (end - start) * (i / count), start + (end - start) * ((i + 0.55) / count)
            cv2.line(picture, _int(a), _int(b), (0, 0, 0), 4, cv2.LINE_AA)
            cv2.line(picture, _int(a), _int(b), colour, 2, cv2.LINE_AA)


def _int(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))


def _shade(picture: Pixels, x: int, y: int, width: int, height: int, strength: float) -> None:
    """Darken a rectangle so that text on it can be read on any ground."""
    area = picture[max(0, y) : y + height, max(0, x) : x + width]
    cv2.convertScaleAbs(area, area, 1.0 - strength, 0)
