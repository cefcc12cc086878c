"""What of each person a camera truly sees: box, and which shares of head and body."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.camera import Camera
from simulation.world.renderer import ned_to_pixels
from simulation.world.scene import NWU_FROM_NED, Scene

Array = NDArray[np.float64]

_LEAST = 0.5
"""Share of head and body that must be seen (Al-Kaff 2019, section 6.2.1: the head, and half of the shape)."""


@dataclass(frozen=True)
class SeenPerson:
    """One person in one picture."""

    number: int
    """From 1, in the scenario's order: the identity."""
    box_px: tuple[int, int, int, int]
    """x, y, width, height of what is seen."""
    head: float
    """Share of the head that lies in the picture with nothing but the person before it."""
    body: float
    """The same of the whole surface."""
    ned_p_m: Array
    """(3,) middle of the body, m."""

    @property
    def counts(self) -> bool:
        """Whether the person is seen well enough to be expected; else they are no miss, and to find them no mistake."""
        return self.head >= _LEAST and self.body >= _LEAST


def seen_people(
    scene: Scene, camera: Camera, ned_p_camera_m: ArrayLike, ned_q_camera: ArrayLike, bodies: NDArray[np.int32]
) -> list[SeenPerson]:
    """Everybody of whom at least one pixel is seen.

    Args:
        scene: as it was placed and drawn.
        camera: that drew it.
        ned_p_camera_m: (3,) where it was, m.
        ned_q_camera: (4,) its attitude.
        bodies: (height, width) what it saw, by `Renderer.bodies`.
    """
    found = []
    for number, person in enumerate(scene.people, 1):
        mine = bodies == person.body
        if not mine.any():
            continue
        grown = cv2.dilate(mine.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        rows, columns = np.flatnonzero(mine.any(axis=1)), np.flatnonzero(mine.any(axis=0))
        box = (int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
        shares, weights, middles = [], [], []
        for part in person.samples:
            nwu = scene.data.xpos[part.body] + part.points_m @ scene.data.xmat[part.body].reshape(3, 3).T
            places = ned_to_pixels(camera, ned_p_camera_m, ned_q_camera, nwu * NWU_FROM_NED)
            shares.append(float(_shown(places, grown).mean()))
            weights.append(part.area_m2)
            middles.append(nwu.mean(axis=0))
        head = next(share for share, part in zip(shares, person.samples, strict=True) if part.head)
        middle = np.average(middles, axis=0, weights=weights) * NWU_FROM_NED
        found.append(SeenPerson(number, box, head, float(np.average(shares, weights=weights)), middle))
    return found


def _shown(places_px: Array, grown: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points lie on pixels that show the person, or beside one: a point of the outline may fall off it."""
    height, width = grown.shape
    shown = np.zeros(len(places_px), bool)
    with np.errstate(invalid="ignore"):
        columns, rows = np.round(places_px).T
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)  # NaN compares as outside
    shown[inside] = grown[rows[inside].astype(int), columns[inside].astype(int)]
    return shown
