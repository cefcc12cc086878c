"""What every single-object tracker is and returns, and the checks on what it is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import cv2
import numpy as np

Box = tuple[float, float, float, float]
"""Upright rectangle before its rotation about its own centre: x, y of the corner, width, height, px."""

TrackState = Literal["tracking", "predicted", "lost"]


@dataclass(frozen=True)
class TrackResult:
    """Where the target is in one picture: a rotated rectangle, how well it fits, and whether it was seen at all."""

    center_px: tuple[float, float]
    """Centre (column, row), px; may lie outside the picture."""
    size_px: tuple[float, float]
    """Sides along the rectangle's own x and y axes, px."""
    angle_rad: float
    """Rotation of those axes from the image's x axis towards its y axis, rad, in (-pi, pi]."""
    score: float
    """Fit of the best hypothesis, 0 to 1 (1: equal to the reference)."""
    score_limit: float
    """Fit below which the target counts as not seen, 0 to 1."""
    state: TrackState
    """`tracking`: seen. `predicted`: not seen for a short time, the motion model alone. `lost`: not seen for long."""
    angle_std_rad: float
    """Circular standard deviation of the angle, rad; large when the picture does not tell the orientation."""
    repeated: bool = False
    """The picture equals the one before: it says nothing about now, and every other field is unchanged."""
    reinitialised: bool = False
    """A search of the whole picture found the target in this one: it may be far from where it was predicted."""

    def corners_px(self) -> np.ndarray:
        """Corners of the rectangle in the picture, (4, 2) px, in order around it."""
        half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(self.size_px) / 2
        cosine, sine = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return np.array(self.center_px) + half @ np.array([[cosine, sine], [-sine, cosine]])

    def overlap(self, box: Box) -> float:
        """Area of the intersection with an upright box over the area of the union (Jaccard), 0 to 1."""
        mine = (self.center_px, self.size_px, math.degrees(self.angle_rad))
        other = (center_of(box), (box[2], box[3]), 0.0)
        _, polygon = cv2.rotatedRectangleIntersection(mine, other)
        if polygon is None or len(polygon) < 3:
            return 0.0
        shared = float(cv2.contourArea(cv2.convexHull(polygon)))
        return shared / (self.size_px[0] * self.size_px[1] + box[2] * box[3] - shared)


def center_of(box: Box) -> tuple[float, float]:
    """Centre (column, row) of an upright box, px."""
    return box[0] + box[2] / 2, box[1] + box[3] / 2


def size_of(box: Box) -> float:
    """Side of the square of a box's area, px."""
    return math.sqrt(box[2] * box[3])


def upright_around(box: Box, angle_rad: float) -> Box:
    """Upright box around the ellipse in a rectangle that is turned about its centre, px.

    Not every tracker follows a rotation: one that starts on an upright box and one on a turned one would disagree for
    ever about the size. Trackers weigh pixels by that ellipse; the box around the rectangle itself would grow by half
    of a tall target's width for 15 degrees of doubt.
    """
    x, y, width, height = box
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    across, down = math.hypot(width * cosine, height * sine), math.hypot(width * sine, height * cosine)
    left, top = x + (width - across) / 2, y + (height - down) / 2
    return float(left), float(top), across, down  # messages take no NumPy numbers


def upright_box(result: TrackResult) -> Box:
    """Upright box around the ellipse in the target's rectangle: x, y, width, height, px. See `upright_around`."""
    (x, y), (width, height) = result.center_px, result.size_px
    return upright_around((x - width / 2, y - height / 2, width, height), result.angle_rad)


@dataclass(frozen=True)
class Expectation:
    """Where the next picture should show the target, from a motion model outside the picture."""

    center_px: tuple[float, float]
    """Centre (column, row), px."""
    angle_rad: float
    """Rotation, rad."""
    moved_px: tuple[float, float]
    """How far that is from where the same model had it in the last picture, px."""
    turned_rad: float
    """How far it turned in the picture by the camera's own turn since then, rad."""
    grown: float
    """Its size over the one in the last picture."""


class Tracker(Protocol):
    """A single-object tracker: told once what the target looks like, then asked picture by picture where it is."""

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the target and start on it.

        Args:
            frame: picture, (H, W, 3) uint8 BGR.
            box: the target's rectangle before its rotation, px.
            angle_rad: rotation about the box's centre, from the image's x axis towards its y axis, rad.
            t_ns: capture stamp of the picture, ns; without it the first update counts as the same instant.

        Raises:
            ValueError: no colour picture, or a box that is degenerate or not in the picture.
        """
        ...

    def expect(self, expectation: Expectation) -> None:
        """Say where the next picture should show the target; what counts as seen is unchanged by it."""
        ...

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Where the target is in the next picture.

        Args:
            frame: picture of the same size as at the start, (H, W, 3) uint8 BGR.
            t_ns: its capture stamp, ns, not before the previous one.

        Raises:
            ValueError: another size or type of picture, a stamp that goes back, or a tracker that was not started.
        """
        ...


@runtime_checkable
class SearchingTracker(Tracker, Protocol):
    """A tracker that also finds its target by itself, anywhere in a picture (Teulière 2011, section II-E)."""

    reinitialisations: int
    """How often it started on a place that a search of the whole picture found."""

    def learn(self, picture: np.ndarray) -> None:
        """Learn the target from a picture of it, (H, W, 3) uint8 BGR, that it fills, with its front at the top.

        Raises:
            ValueError: no colour picture, one that is too small, or one without texture.
        """
        ...

    def find(self, frame: np.ndarray, t_ns: int) -> bool:
        """Search a whole picture and start anew where the target is; False, and nothing changed, where it is not.

        Raises:
            ValueError: another size or type of picture, or a tracker that was never shown its target.
        """
        ...


@runtime_checkable
class Placeable(Tracker, Protocol):
    """A tracker that can be moved to where somebody else has found its target, and keeps what it has learned."""

    def place(self, frame: np.ndarray, box: Box) -> None:
        """Go on from a box in this picture, (H, W, 3) uint8 BGR, without learning anything from it.

        Raises:
            ValueError: a tracker that was not started, or a box that is not in the picture.
        """
        ...


def put(tracker: Tracker, frame: np.ndarray, box: Box, t_ns: int) -> None:
    """Let a tracker go on from a box in this picture, or start it there if it cannot be moved.

    Args:
        tracker: any.
        frame: the picture, (H, W, 3) uint8 BGR.
        box: upright, px.
        t_ns: capture stamp of the picture, ns.

    Raises:
        ValueError: a box that is not in the picture.
    """
    if isinstance(tracker, Placeable):
        tracker.place(frame, box)
    else:
        tracker.init(frame, box, 0.0, t_ns)


def check_frame(frame: np.ndarray, shape: tuple[int, ...] | None = None) -> None:
    """Raise ValueError unless this is a colour picture, of the given shape (H, W, 3) when there is one."""
    if not isinstance(frame, np.ndarray) or frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        got = f"{frame.dtype} {frame.shape}" if isinstance(frame, np.ndarray) else type(frame).__name__
        raise ValueError(f"frame: got {got}, expected a BGR picture (H, W, 3) uint8")
    if frame.shape[0] < 1 or frame.shape[1] < 1:
        raise ValueError(f"frame: got an empty picture {frame.shape}, expected at least one pixel")
    if shape is not None and frame.shape != shape:
        raise ValueError(
            f"frame: got {frame.shape[1]}x{frame.shape[0]} px, expected {shape[1]}x{shape[0]} px as at the start; "
            "select the target again when the camera's size changes"
        )


MIN_SIDE_PX = 6.0
"""Shortest side of a target, px: below it a part of the rectangle holds no more than a pixel or two."""
MIN_MODEL_PX = 12
"""Shortest side of a picture of the target, px."""


_LEAST_CONTRAST = 4.0
"""Least standard deviation of some channel of a picture of the target, grey levels: below it is noise."""


def check_picture(picture: np.ndarray) -> None:
    """Raise ValueError unless this is a colour picture that is large enough, and not of one plain colour."""
    check_frame(picture)
    rows, columns = picture.shape[:2]
    if min(rows, columns) < MIN_MODEL_PX:
        raise ValueError(
            f"got a picture of {columns}x{rows} px, smaller than a kernel can use, expected sides of at "
            f"least {MIN_MODEL_PX} px; take a larger one"
        )
    contrast = float(picture.reshape(-1, 3).std(axis=0).max())
    if contrast < _LEAST_CONTRAST:
        raise ValueError(
            f"got a picture without texture (standard deviation {contrast:.1f} grey levels), expected at least "
            f"{_LEAST_CONTRAST:g}; cut the picture so that the target fills it and shows its colours"
        )


def check_box(frame: np.ndarray, box: Box, angle_rad: float) -> None:
    """Raise ValueError unless the box has an area, a finite angle, and lies with most of its area in the picture."""
    if len(box) != 4 or not all(math.isfinite(v) for v in (*box, angle_rad)):
        raise ValueError(f"box: got {box} at {angle_rad} rad, expected finite x, y, width, height and angle")
    x, y, width, height = box
    if width < MIN_SIDE_PX or height < MIN_SIDE_PX:
        raise ValueError(
            f"box: got {width:g}x{height:g} px, expected sides of at least {MIN_SIDE_PX:g} px; draw a larger box"
        )
    rows, columns = frame.shape[:2]
    inside = max(0.0, min(x + width, columns) - max(x, 0.0)) * max(0.0, min(y + height, rows) - max(y, 0.0))
    if inside < 0.5 * width * height or width > columns or height > rows:
        raise ValueError(
            f"box: got x {x:g}, y {y:g}, {width:g}x{height:g} px, "
            f"expected most of it in the {columns}x{rows} px picture"
        )
