"""Keypoints of a window at the size and rotation that the target first had, and their descriptors' distances.

Seen like that, a keypoint's surroundings hardly change while the target grows or turns, so corners and upright binary
descriptors (Rublee et al. 2011, ORB, DOI 10.1109/ICCV.2011.6126544) do, and on a dark or small target there are enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

BITS = 256
"""Bits of a descriptor."""
_PATCH_PX = 31
_QUALITY = 0.003
"""Least strength of a corner against the strongest one."""
_NEIGHBOURHOOD_PX = 24.0
_SMALL_PX = 400
"""Longer side up to which a picture is blurred by products of matrices: they grow with its third power."""
_LEAST_CONTRAST = 6.0
"""Contrast that the sensor's noise has, grey levels: what is plainer is not made any stronger."""


@dataclass(frozen=True)
class View:
    """A window of the picture, scaled and turned upright."""

    center_px: tuple[float, float]
    """Its middle in the picture, px."""
    zoom: float
    """Pixels of the view for one of the picture."""
    angle_rad: float
    """Rotation of the target in the picture, which the view undoes, rad."""
    size_px: tuple[int, int]
    """Width and height of the view."""

    def cut(self, grey: np.ndarray) -> np.ndarray:
        """The view of a picture (H, W) uint8; what is beyond the edge repeats it."""
        if self.zoom < 0.6:  # one pixel of the view is several of the picture
            grey = cv2.blur(grey, (round(1 / self.zoom),) * 2)
        return cv2.warpAffine(
            grey, self._matrix(), self.size_px, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip

    def in_picture(self, points: np.ndarray) -> np.ndarray:
        """Places (n, 2) of the view in the picture, px."""
        matrix = self._matrix()
        return points @ matrix[:, :2].T + matrix[:, 2]

    def _matrix(self) -> np.ndarray:
        cosine, sine = math.cos(self.angle_rad) / self.zoom, math.sin(self.angle_rad) / self.zoom
        turn = np.array([[cosine, -sine], [sine, cosine]])
        middle = (np.array(self.size_px) - 1) / 2
        return np.column_stack([turn, np.array(self.center_px) - turn @ middle])


class Keypoints:
    """Finds corners and describes them.

    Args:
        spacing_px: least distance of two corners.
    """

    def __init__(self, spacing_px: float):
        self._spacing_px = spacing_px
        self._describer = cv2.ORB.create(nlevels=1, edgeThreshold=0, patchSize=_PATCH_PX)

    def find(self, picture: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Corners (n, 2) float32, px, and descriptors (n, 4) uint64 of a grey picture (H, W) uint8."""
        picture = _even(picture)
        corners = cv2.goodFeaturesToTrack(picture, count, _QUALITY, self._spacing_px)
        if corners is None:
            return np.zeros((0, 2), np.float32), np.zeros((0, BITS // 64), np.uint64)
        keypoints = [cv2.KeyPoint(float(x), float(y), _PATCH_PX, 0.0) for x, y in corners.reshape(-1, 2)]
        keypoints, descriptors = self._describer.compute(picture, keypoints)
        if not keypoints:
            return np.zeros((0, 2), np.float32), np.zeros((0, BITS // 64), np.uint64)
        return np.array([k.pt for k in keypoints], np.float32), np.ascontiguousarray(descriptors).view(np.uint64)


def _even(picture: np.ndarray) -> np.ndarray:
    """The picture (H, W) uint8 at the same contrast everywhere: a dark target has corners beside a bright wall."""
    values = picture.astype(np.float32)
    values -= _surroundings(values)
    contrast = np.sqrt(_surroundings(values * values))
    return np.clip(128.0 + 45.0 * values / (contrast + _LEAST_CONTRAST), 0, 255).astype(np.uint8)


def _surroundings(values: np.ndarray) -> np.ndarray:
    """Gaussian mean (H, W) around each pixel of a picture (H, W) float32.

    So wide a kernel is as long as the picture: then two products of matrices are it, in a sixth of the time.
    """
    rows, columns = values.shape
    if max(rows, columns) > _SMALL_PX:
        return cv2.GaussianBlur(values, (0, 0), _NEIGHBOURHOOD_PX)
    return _blur_along(rows) @ values @ _blur_along(columns).T


@lru_cache(maxsize=64)
def _blur_along(length: int) -> np.ndarray:
    """Matrix (n, n) float32 that blurs columns (n, m) as `cv2.GaussianBlur` does, edges included."""
    kernel = cv2.getGaussianKernel(2 * round(4 * _NEIGHBOURHOOD_PX) + 1, _NEIGHBOURHOOD_PX, cv2.CV_32F)
    return cv2.sepFilter2D(np.eye(length, dtype=np.float32), cv2.CV_32F, np.ones(1, np.float32), kernel)


def differing(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Share (n, m) of the bits in which descriptors (n, 4) differ from others (m, 4), both uint64, 0 to 1."""
    count = np.zeros((len(one), len(other)), np.uint16)
    for word in range(one.shape[1]):  # sums along so short an axis are slow
        count += np.bitwise_count(one[:, None, word] ^ other[None, :, word])
    return count / np.float32(BITS)


def unique_matches(distances: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of rows (k,) and columns (k,) of distances (n, m) that are each other's nearest, and near enough."""
    if 0 in distances.shape:
        return np.zeros(0, int), np.zeros(0, int)
    rows = np.arange(len(distances))
    columns = distances.argmin(axis=1)
    good = (distances.argmin(axis=0)[columns] == rows) & (distances[rows, columns] <= limit)
    return rows[good], columns[good]
