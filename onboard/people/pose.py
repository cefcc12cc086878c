"""Fifteen joints of a person in a picture, in the paper's order, and the crop that shows a body upright (sec. 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.rotation import Array

HEAD, NECK, HIP_R, KNEE_R, ANKLE_R, HIP_L, KNEE_L, ANKLE_L, WAIST = 0, 1, 8, 9, 10, 11, 12, 13, 14
ANKLES = (ANKLE_R, ANKLE_L)
BONES = np.array(
    [
        *((0, 1), (1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 14)),
        *((14, 8), (8, 9), (9, 10), (14, 11), (11, 12), (12, 13)),
    ]
)
"""Pairs of joints."""

STANDING_M = 1.2
"""Who reaches higher stands."""

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Pose:
    """A person's joints in a picture."""

    joints_px: Array
    """(15, 2), in the order of `JOINTS`."""
    confidence: Array
    """(15,), 0 to 1."""
    presence: float
    """What the network says about a person being there at all, 0 to 1; 1 where it says nothing."""

    @property
    def feet_px(self) -> Array:
        """(2,) middle of the ankles."""
        return self.joints_px[list(ANKLES)].mean(axis=0)

    @property
    def up(self) -> Array:
        """(2,) unit vector from the feet to the head, or up the picture where both are the same."""
        line = self.joints_px[HEAD] - self.feet_px
        length = float(np.linalg.norm(line))
        return line / length if length > 1e-6 else np.array([0.0, -1.0])


def upright_crop(
    picture: Picture, centre_px: ArrayLike, up: ArrayLike, side_px: float, size: int
) -> tuple[Picture, Array]:
    """Square (size, size, 3) of a picture, turned so that a direction points up, and the map (2, 3) back to it.

    Args:
        picture: (H, W, 3).
        centre_px: middle of the square in the picture, px.
        up: (2,) direction in the picture that becomes up.
        side_px: side of the square in the picture, px.
        size: side of the result, px.
    """
    up = np.asarray(up, float) / np.linalg.norm(up)
    right = np.array([-up[1], up[0]])
    step = side_px / size
    # Columns: where one crop pixel to the right and one down lead in the picture.
    turn = np.column_stack((right, -up)) * step
    back = np.column_stack((turn, np.asarray(centre_px, float) - turn @ np.full(2, 0.5 * (size - 1))))
    flags = cv2.WARP_INVERSE_MAP | (cv2.INTER_LINEAR if step < 2 else cv2.INTER_AREA)
    crop = cv2.warpAffine(picture, back, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(crop, np.uint8), back
