"""Regions without depth: the boxes of a person detector in an ONNX or TFLite file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType

import cv2
import numpy as np

from common.config import ConfigError
from common.geometry.rotation import Array
from onboard.people.network_file import read_network
from onboard.people.pipeline_config import DetectorConfig
from onboard.people.pose import Picture
from onboard.people.regions import Box, Region
from onboard.people.watch import iou

_GREY = 114
_LEAST_SIDE_PX = 4
_COMMON = 0.35
"""Share of a square's side that the next one shows, too: a person whom one cuts is whole in the other."""
_CUT = 0.02
"""A box so near to the border of a square inside the picture, as a share of its side, is cut by it."""
_ROUNDING = 0.05
"""Of a square's way to the next, which its side in whole pixels may cost."""
_STRIDES, _SCALES = (16, 32, 64, 128, 256, 512), (0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.0)
_ASPECTS = (1.0, 2.0, 0.5, 3.0, 1.0 / 3.0)
"""Of SSD's default boxes as TensorFlow's models have them (Liu et al. 2016, section 2.2, arXiv 1512.02325)."""
_OF_MIDDLE, _OF_SIDES = 0.1, 0.2
"""Variances of its encodings."""


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
    if rows.shape[1] != 7:
        raise ConfigError(
            f"detector: decoder 'ssd' got an output of shape {output.shape}, expected 7 numbers for each box; is it "
            "another decoder's?"
        )
    rows = rows[np.round(rows[:, 1]) == person]
    return rows[:, 3:7] * size_px, rows[:, 2]


def _ssd_raw(output: Array, person: int, size_px: int) -> tuple[Array, Array]:
    rows, anchors = output.reshape(output.shape[-2:]), default_boxes(size_px)
    _require(rows, 5 + person, "ssd_raw", output)
    if len(rows) != len(anchors):
        raise ConfigError(
            f"detector: decoder 'ssd_raw' got an output of shape {output.shape}, expected {len(anchors)} boxes at "
            f"{size_px} px"
        )
    y, x, height, width = rows[:, :4].T
    middles = anchors[:, :2] + _OF_MIDDLE * np.stack((x, y), axis=1) * anchors[:, 2:]
    sides = np.exp(np.clip(_OF_SIDES * np.stack((width, height), axis=1), -20.0, 20.0)) * anchors[:, 2:]
    return size_px * _corners(np.hstack((middles, sides))), 1.0 / (1.0 + np.exp(-rows[:, 4 + person]))


@cache
def default_boxes(size_px: int) -> Array:
    """Middles x, y, widths and heights (N, 4) of SSD's default boxes, as shares of the picture's side."""
    boxes = []
    for layer, stride in enumerate(_STRIDES):
        scale, between = _SCALES[layer], math.sqrt(_SCALES[layer] * _SCALES[layer + 1])
        shapes = [(scale, aspect) for aspect in _ASPECTS] + [(between, 1.0)]
        if layer == 0:
            shapes = [(0.1, 1.0), (scale, 2.0), (scale, 0.5)]
        sides = np.array([(side * math.sqrt(aspect), side / math.sqrt(aspect)) for side, aspect in shapes])
        cells = math.ceil(size_px / stride)
        middles = (np.stack(np.meshgrid(range(cells), range(cells)), axis=-1).reshape(-1, 2) + 0.5) / cells
        boxes.append(np.hstack((np.repeat(middles, len(sides), axis=0), np.tile(sides, (len(middles), 1)))))
    return np.concatenate(boxes)


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
    {"yolo": _yolo, "yolo_objectness": _yolo_objectness, "ssd": _ssd, "ssd_raw": _ssd_raw}
)
"""From an output, the person's class and the side of the picture that went in: boxes (N, 4) of left, top, right,
bottom, px of that picture, and scores (N,)."""


class PersonDetector:
    """Finds people's boxes in a picture.

    Args:
        config: file and decoder.

    Raises:
        ConfigError: the file is missing, OpenCV cannot read it, it has no such output, or what it says to an empty
            picture is not what the decoder reads.
    """

    def __init__(self, config: DetectorConfig):
        self._config = config
        expected = "an ONNX or TFLite person detector"
        self._net = read_network(config.file, config.engine, "detector.file", expected)
        names = list(self._net.getUnconnectedOutLayersNames())
        for key, name in (("output", config.output), ("scores", config.scores)):
            if name and name not in names:
                raise ConfigError(f"detector.{key}: {config.file!r} has no output {name!r}, only {names}")
        if not config.output and len(names) != 1:
            raise ConfigError(f"detector.output: got nothing, expected one of the outputs {names} of {config.file!r}")
        self._outputs = [config.output or names[0]] + ([config.scores] if config.scores else [])
        size_px = config.size_px
        try:  # what is wrong shows now, not in flight
            self._in_window(np.zeros((size_px, size_px, 3), np.uint8), (0, 0, size_px, size_px))
        except cv2.error as error:
            raise ConfigError(
                f"detector: {config.file!r} does not run on {size_px}x{size_px} px; is detector.size_px that of the "
                f"network? ({str(error).strip()})"
            ) from None

    def find(self, picture: Picture) -> list[Region]:
        """Regions of the people in a picture (H, W, 3), BGR, the best first; they have no place and no size in metres.

        Raises:
            ConfigError: the output is not what the decoder reads.
        """
        config = self._config
        height, width = picture.shape[:2]
        found = [self._in_window(picture, window) for window in windows(width, height, config.tiles)]
        boxes, scores = (np.concatenate(parts) for parts in zip(*found, strict=True))
        if config.merged:
            boxes, scores = _merged(boxes, scores, config.most_overlap)
        low, high = np.clip(boxes[:, :2], 0, (width, height)), np.clip(boxes[:, 2:], 0, (width, height))
        places = np.round(np.hstack((low, high - low))).astype(int)
        keep = cv2.dnn.NMSBoxes(places.tolist(), scores.tolist(), config.least_score, config.most_overlap)
        kept = places[np.asarray(keep, int).ravel()]
        return [region_of_box(*box) for box in kept.tolist() if min(box[2:]) >= _LEAST_SIDE_PX]

    def _in_window(self, picture: Picture, window: Box) -> tuple[Array, Array]:
        """Boxes (N, 4) of left, top, right, bottom, px of the picture, and scores (N,) of what a part of it shows."""
        config = self._config
        x, y, width, height = window
        scale = config.size_px / max(width, height)
        fitted = np.full((config.size_px, config.size_px, 3), _GREY, np.uint8)
        small = cv2.resize(
            picture[y : y + height, x : x + width], (max(1, round(width * scale)), max(1, round(height * scale)))
        )
        fitted[: small.shape[0], : small.shape[1]] = small
        blob = cv2.dnn.blobFromImage(fitted, 1.0, (config.size_px,) * 2, config.mean, config.colours == "rgb")
        self._net.setInput(blob * np.float32(config.scale))
        outputs = self._net.forward(self._outputs)
        output = np.concatenate([np.asarray(o, float) for o in outputs], axis=-1)
        boxes, scores = DECODERS[config.decoder](output, config.person, config.size_px)
        good = (scores >= config.least_score) & np.isfinite(boxes).all(axis=1)
        boxes, scores = boxes[good] / scale + (x, y, x, y), scores[good]
        margin = _CUT * max(width, height)
        cut = np.zeros(len(boxes), bool)
        for column, border, end in (
            (0, x, 0),
            (1, y, 0),
            (2, x + width, picture.shape[1]),
            (3, y + height, picture.shape[0]),
        ):
            if border != end:
                cut |= np.abs(boxes[:, column] - border) < margin
        return boxes[~cut], scores[~cut]


def _merged(boxes: Array, scores: Array, most_overlap: float) -> tuple[Array, Array]:
    """For each best box and those that share more than this with it their mean, weighted by the squared scores."""
    sized = np.hstack((boxes[:, :2], boxes[:, 2:] - boxes[:, :2])).tolist()
    left, places, best = np.argsort(-scores).tolist(), [], []
    while left:
        same = [k for k in left if k == left[0] or iou(sized[left[0]], sized[k]) > most_overlap]
        weights = scores[same] ** 2
        places.append(weights @ boxes[same] / weights.sum())
        best.append(scores[left[0]])
        left = [k for k in left if k not in same]
    return np.array(places).reshape(-1, 4), np.array(best)


def windows(width: int, height: int, tiles: int) -> list[Box]:
    """Parts x, y, width, height of a picture that are looked at: all of it, and with `tiles` squares that cover it, so
    many along its shorter side, each with a third of the next one in it."""
    parts: list[Box] = [(0, 0, width, height)]
    if tiles:
        side = round(min(width, height) / (1.0 + (tiles - 1) * (1.0 - _COMMON)))
        parts += [(x, y, side, side) for y in _starts(height, side) for x in _starts(width, side)]
    return parts


def _starts(length: int, side: int) -> list[int]:
    """Where squares of a side begin so that they cover a length, px."""
    count = 1 + math.ceil(max(length - side, 0) / (side * (1.0 - _COMMON)) - _ROUNDING)
    return [round(v) for v in np.linspace(0, max(length - side, 0), count).tolist()]


def region_of_box(x: int, y: int, width: int, height: int) -> Region:
    """Region of a box, px, that was found without depth."""
    return Region((x, y, width, height), np.ones((height, width), bool), None, None, None, None)
