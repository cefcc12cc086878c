"""ONNX files that are small enough to be written field by field: one that gives back its input, one that finds red."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*out, value))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _tensor(name: str, shape: tuple[int, ...]) -> bytes:
    dimensions = b"".join(_bytes(1, _number(1, size)) for size in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, 1) + _bytes(2, dimensions)))


def write_identity(path: Path, size_px: int) -> None:
    """A model that gives back the picture (1, 3, size, size) that goes in: three heatmaps, one of each colour."""
    shape = (1, 3, size_px, size_px)
    node = _bytes(1, "picture") + _bytes(2, "maps") + _bytes(4, "Identity")
    graph = _bytes(1, node) + _bytes(2, "colours") + _bytes(11, _tensor("picture", shape))
    graph += _bytes(12, _tensor("maps", shape))
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13)))


def _initializer(name: str, values: np.ndarray) -> bytes:
    kind = 7 if values.dtype == np.int64 else 1
    dimensions = b"".join(_number(1, size) for size in values.shape)
    return _bytes(5, dimensions + _number(2, kind) + _bytes(8, name) + _bytes(9, values.tobytes()))


def _integers(name: str, values: tuple[int, ...]) -> bytes:
    return _bytes(5, _bytes(1, name) + b"".join(_number(8, v) for v in values) + _number(20, 7))


def _node(kind: str, inputs: tuple[str, ...], output: str, attributes: bytes = b"") -> bytes:
    return _bytes(1, b"".join(_bytes(1, i) for i in inputs) + _bytes(2, output) + _bytes(4, kind) + attributes)


def write_red_detector(path: Path, size_px: int, cell_px: int, box_px: tuple[float, float]) -> None:
    """A detector of red: one box of a size for each cell, its score how much redder than green the cell is.

    It takes (1, 3, size, size), RGB, 0 to 1, and gives (1, 5, cells) of centre x, y, width, height and score, as YOLO's
    heads do: a convolution as large as a cell, the boxes added, the cells in one row.
    """
    side = size_px // cell_px
    weights = np.zeros((5, 3, cell_px, cell_px), np.float32)
    weights[4, 0], weights[4, 1] = 1.0 / cell_px**2, -1.0 / cell_px**2
    boxes = np.zeros((1, 5, side, side), np.float32)
    middles = (np.arange(side, dtype=np.float32) + 0.5) * cell_px
    boxes[0, 0], boxes[0, 1] = middles[None, :], middles[:, None]
    boxes[0, 2], boxes[0, 3] = box_px
    graph = _node("Conv", ("picture", "weights"), "redness", _integers("strides", (cell_px, cell_px)))
    graph += _node("Add", ("redness", "boxes"), "grid") + _node("Reshape", ("grid", "row"), "found")
    graph += _bytes(2, "red") + _initializer("weights", weights) + _initializer("boxes", boxes)
    graph += _initializer("row", np.array([1, 5, side * side], np.int64))
    graph += _bytes(11, _tensor("picture", (1, 3, size_px, size_px)))
    graph += _bytes(12, _tensor("found", (1, 5, side * side)))
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13)))
