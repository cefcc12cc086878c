"""Depth pictures: metres in arrays, NaN where nothing returned; 16-bit millimetres on the bus, 0 there.

16 bits carry 65.5 m at 1 mm, which is below any depth sensor's noise, in half of what floats would take.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.messages import Image, MessageError

DepthPicture = NDArray[np.float32]

_MM_PER_M = 1000.0
_LARGEST_MM = 65535
_WIRE = np.dtype("<u2")


def to_image(camera: str, depth_m: DepthPicture) -> Image:
    """Message of a depth picture.

    Args:
        camera: camera name.
        depth_m: (height, width), m along the optical axis; NaN, zero, negative or beyond 65.5 m: nothing returned.
    """
    height, width = depth_m.shape
    return Image(camera=camera, width=width, height=height, encoding="depth_mm", data=to_mm(depth_m).tobytes())


def to_mm(depth_m: DepthPicture) -> NDArray[np.uint16]:
    """Millimetres (height, width), little-endian, 0 where `depth_m` has no depth (see `to_image`)."""
    scaled = depth_m * np.float32(_MM_PER_M) + np.float32(0.5)
    # NaN compares as outside.
    return np.where((scaled >= 1.0) & (scaled < _LARGEST_MM + 1.0), scaled, np.float32(0.0)).astype(_WIRE)


def in_mm(image: Image) -> NDArray[np.uint16]:
    """Pixels (height, width) of a depth message, mm, 0 where nothing returned; read-only.

    Raises:
        MessageError: it is no depth picture.
    """
    if image.encoding != "depth_mm":
        raise MessageError(f"encoding: got {image.encoding!r}, expected 'depth_mm'")
    return np.frombuffer(image.data, _WIRE).reshape(image.height, image.width)


def in_m(image: Image) -> DepthPicture:
    """Depth (height, width), m along the optical axis, NaN where nothing returned.

    Raises:
        MessageError: it is no depth picture.
    """
    mm = in_mm(image)
    depth = mm.astype(np.float32) / np.float32(_MM_PER_M)
    depth[mm == 0] = np.nan
    return depth
