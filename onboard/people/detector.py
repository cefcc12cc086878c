"""Regions without depth: the boxes of a person detector in an ONNX file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np

from common.config import ConfigError
from common.geometry.rotation import Array
from onboard.people.pipeline_config import DetectorConfig
from onboard.people.pose import Picture
from onboard.people.regions import Region

_GREY = 114
_LEAST_SIDE_PX = 4


def _yolo(output: Array, person: int, size_px: int) -> tuple[Array, Array]:
    rows = output.reshape(output.shape[-2:]).T
    _require(rows, 5 + person, "yolo", output)
    return _corners(rows[:, :4]), rows[:, 4 + person]


def _yolo_objectness(output: Array, person: int, size_px: int) -> tuple[Array, Array]:
    rows = output.reshape(output.shape[-2:])
    _require(rows, 6 + person, "yolo_objectness", output)
    return _corners(rows[:, :4]), rows[:, 4] * rows[:, 5 + person]


def _ssd(output: Array, person: int, size_px: int) -> tuple[Array, Array]:
    rows = output.reshape(-1, output.shape[-1])
    _require(rows, 7, "ssd", output)
    rows = rows[np.round(rows[:, 1]) == person]
    return rows[:, 3:7] * size_px, rows[:, 2]


def _corners(boxes: Array) -> Array:
    """Left, top, right, bottom of centres and sides (N, 4)."""
    half = 0.5 * boxes[:, 2:4]
    return np.hstack((boxes[:, :2] - half, boxes[:, :2] + half))


def _require(rows: Array, least: int, decoder: str, output: Array) -> None:
    if rows.ndim != 2 or rows.shape[1] < least:
        raise ConfigError(
            f"detector: decoder {decoder!r} got an output of shape {output.shape}, expected at least {least} numbers "
            "for each box; is it another decoder's, or `person` too large?"
        )


DECODERS: Mapping[str, Callable[[Array, int, int], tuple[Array, Array]]] = MappingProxyType(
    {"yolo": _yolo, "yolo_objectness": _yolo_objectness, "ssd": _ssd}
)
"""From an output, the person's class and the side of the picture that went in: boxes (N, 4) of left, top, right,
bottom, px of that picture, and scores (N,)."""


class PersonDetector:
    """Finds people's boxes in a picture.

    Args:
        config: file and decoder.

    Raises:
        ConfigError: the file is missing, OpenCV cannot read it, or it has no such output.
    """

    def __init__(self, config: DetectorConfig):
        self._config = config
        path = Path(config.file)
        if not path.is_file():
            raise ConfigError(f"detector.file: {config.file!r} does not exist; expected an ONNX person detector")
        engine = cv2.dnn.ENGINE_CLASSIC if config.engine == "classic" else cv2.dnn.ENGINE_NEW
        try:
            self._net = cv2.dnn.readNetFromONNX(str(path), engine)
        except cv2.error as error:
            raise ConfigError(f"detector.file: OpenCV cannot read {config.file!r} ({str(error).strip()})") from None
        names = list(self._net.getUnconnectedOutLayersNames())
        if config.output and config.output not in names:
            raise ConfigError(f"detector.output: {config.file!r} has no output {config.output!r}, only {names}")
        if not config.output and len(names) != 1:
            raise ConfigError(f"detector.output: got nothing, expected one of the outputs {names} of {config.file!r}")
        self._output = config.output or names[0]

    def find(self, picture: Picture) -> list[Region]:
        """Regions of the people in a picture (H, W, 3), BGR, the best first; they have no place and no size in metres.

        Raises:
            ConfigError: the output is not what the decoder reads.
        """
        config = self._config
        height, width = picture.shape[:2]
        scale = config.size_px / max(height, width)
        fitted = np.full((config.size_px, config.size_px, 3), _GREY, np.uint8)
        small = cv2.resize(picture, (max(1, round(width * scale)), max(1, round(height * scale))))
        fitted[: small.shape[0], : small.shape[1]] = small
        blob = cv2.dnn.blobFromImage(fitted, 1.0, (config.size_px,) * 2, config.mean, config.colours == "rgb")
        self._net.setInput(blob * np.float32(config.scale))
        output = np.asarray(self._net.forward(self._output), float)
        boxes, scores = DECODERS[config.decoder](output, config.person, config.size_px)
        good = (scores >= config.least_score) & np.isfinite(boxes).all(axis=1)
        boxes, scores = boxes[good] / scale, scores[good]
        low, high = np.clip(boxes[:, :2], 0, (width, height)), np.clip(boxes[:, 2:], 0, (width, height))
        places = np.round(np.hstack((low, high - low))).astype(int)
        keep = cv2.dnn.NMSBoxes(places.tolist(), scores.tolist(), config.least_score, config.most_overlap)
        kept = places[np.asarray(keep, int).ravel()]
        return [region_of_box(*box) for box in kept.tolist() if min(box[2:]) >= _LEAST_SIDE_PX]


def region_of_box(x: int, y: int, width: int, height: int) -> Region:
    """Region of a box, px, that was found without depth."""
    return Region((x, y, width, height), np.ones((height, width), bool), None, None, None, None)
