"""Reads a picture of the target, from which a tracker learns it (Teulière 2011, section II-E)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from common.config import ConfigError
from common.tracking.base import check_picture


def read_model(path: str, option: str) -> np.ndarray:
    """The picture, (H, W, 3) uint8 BGR.

    Args:
        path: image file that the target fills, with its front at the top.
        option: what named the file, for the error's text.

    Raises:
        ConfigError: no such file, no picture, or one that is too small or without texture.
    """
    picture = cv2.imread(path, cv2.IMREAD_COLOR) if Path(path).is_file() else None
    if picture is None:
        raise ConfigError(f"{option}: got {path!r}, expected an image file that OpenCV reads")
    picture = np.asarray(picture)
    try:
        check_picture(picture)
    except ValueError as error:
        raise ConfigError(f"{option}: {path!r}: {error}") from None
    return picture
