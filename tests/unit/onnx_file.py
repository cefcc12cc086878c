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


def write_red_detector(
    path: Path, size_px: int, cell_px: int, box_px: tuple[float, float], layout: str = "yolo"
) -> None:
    """A detector of red: one box of a size for each cell, its score how much redder than green the cell is.

    It takes (1, 3, size, size), RGB, 0 to 1: a convolution as large as a cell, the boxes added, the cells in one row.
    What it gives is laid out as `DetectorConfig.decoder` says: `yolo` (1, 5, cells), `yolo_objectness` (1, cells, 7)
    whose second class is sure, `ssd` (1, 1, cells, 7) whose class is 1.
    """
    side = size_px // cell_px
    rows, score = {"yolo": (5, 4), "yolo_objectness": (7, 4), "ssd": (7, 2)}[layout]
    weights = np.zeros((rows, 3, cell_px, cell_px), np.float32)
    weights[score, 0], weights[score, 1] = 1.0 / cell_px**2, -1.0 / cell_px**2
    boxes = np.zeros((1, rows, side, side), np.float32)
    middles = (np.arange(side, dtype=np.float32) + 0.5) * cell_px
    x, y = np.broadcast_arrays(middles[None, :], middles[:, None])
    if layout == "ssd":
        boxes[0, 1] = 1.0
        corners = (x - box_px[0] / 2, y - box_px[1] / 2, x + box_px[0] / 2, y + box_px[1] / 2)
        boxes[0, 3:] = np.array(corners) / size_px
    else:
        boxes[0, 0], boxes[0, 1], boxes[0, 2], boxes[0, 3] = x, y, *box_px
        boxes[0, 6:] = 1.0
    shape = (1, rows, side * side) if layout == "yolo" else (1, side * side, rows)
    shape = (1, *shape) if layout == "ssd" else shape
    graph = _node("Conv", ("picture", "weights"), "redness", _integers("strides", (cell_px, cell_px)))
    graph += _node("Add", ("redness", "boxes"), "grid")
    if layout != "yolo":
        graph += _node("Transpose", ("grid",), "cells", _integers("perm", (0, 2, 3, 1)))
    graph += _node("Reshape", ("grid" if layout == "yolo" else "cells", "row"), "found")
    graph += _bytes(2, "red") + _initializer("weights", weights) + _initializer("boxes", boxes)
    graph += _initializer("row", np.array(shape, np.int64))
    graph += _bytes(11, _tensor("picture", (1, 3, size_px, size_px)))
    graph += _bytes(12, _tensor("found", shape))
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13)))


def write_raw_ssd(path: Path, size_px: int, boxes: int, sure: int) -> None:
    """A network that finds the same in every picture: default box `sure`, a step right and twice as high, of class 1.

    It has two outputs, `boxes` (1, boxes, 4) and `scores` (1, boxes, 3), as TensorFlow's SSD before its last steps.
    """
    encodings, logits = np.zeros((1, boxes, 4), np.float32), np.full((1, boxes, 3), -6.0, np.float32)
    encodings[0, sure] = (0.0, 1.0, 5.0 * np.log(2.0), 0.0)
    logits[0, sure, 1] = 2.0
    graph = b""
    for name, values in (("boxes", encodings), ("scores", logits)):
        # The picture's mean times nothing: a network whose outputs do not hang on its input is no network to OpenCV.
        graph += _node("GlobalAveragePool", ("picture",), f"{name}_mean") + _node(
            "Conv", (f"{name}_mean", f"{name}_nothing"), f"{name}_zero"
        )
        graph += _node("Reshape", (f"{name}_zero", f"{name}_one"), f"{name}_scalar")
        graph += _node("Add", (f"{name}_values", f"{name}_scalar"), name)
        graph += _initializer(f"{name}_nothing", np.zeros((1, 3, 1, 1), np.float32))
        graph += _initializer(f"{name}_one", np.array([1, 1, 1], np.int64)) + _initializer(f"{name}_values", values)
        graph += _bytes(12, _tensor(name, values.shape))
    graph += _bytes(2, "ssd") + _bytes(11, _tensor("picture", (1, 3, size_px, size_px)))
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13)))


def _constant_head(name: str, source: str, values: np.ndarray, kernel_px: int) -> bytes:
    """A convolution without weights, so that its output (1, C, ...) is `values` (C,) wherever it looks."""
    window = (kernel_px, kernel_px)
    graph = _node(
        "Conv",
        (source, f"{name}_w", f"{name}_b"),
        name,
        _integers("kernel_shape", window) + _integers("strides", window),
    )
    weights = np.zeros((len(values), 3, *window), np.float32)
    return graph + _initializer(f"{name}_w", weights) + _initializer(f"{name}_b", values.astype(np.float32))


def _write(path: Path, graph: bytes, inputs: dict[str, tuple[int, ...]], outputs: dict[str, tuple[int, ...]]) -> None:
    graph += _bytes(2, "constant") + b"".join(_bytes(11, _tensor(name, shape)) for name, shape in inputs.items())
    graph += b"".join(_bytes(12, _tensor(name, shape)) for name, shape in outputs.items())
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13)))


def _both(one: str, other: str) -> bytes:
    """`both`: an input, and nothing of another one: a network may not leave an input out."""
    graph = _node("GlobalAveragePool", (one,), "mean") + _node("Mul", ("mean", "nothing"), "zero")
    return graph + _initializer("nothing", np.zeros((1, 3, 1, 1), np.float32)) + _node("Add", (other, "zero"), "both")


def write_constant_vit(path: Path, score: float) -> None:
    """What OpenCV's `TrackerVit` takes: every place is the target with this score, as large as before."""
    values = {"output1": [score], "output2": [0.25, 0.25], "output3": [0.5, 0.5]}
    graph = _both("template", "search")
    graph += b"".join(_constant_head(name, "both", np.array(value), 16) for name, value in values.items())
    outputs = {name: (1, len(value), 16, 16) for name, value in values.items()}
    _write(path, graph, {"template": (1, 3, 128, 128), "search": (1, 3, 256, 256)}, outputs)


def write_constant_nano(backbone: Path, neckhead: Path, logit: float) -> None:
    """What OpenCV's `TrackerNano` takes: every place is the target with this logit, its sides 32 px of the search."""
    pooled = _node(
        "AveragePool", ("input",), "output", _integers("kernel_shape", (15, 15)) + _integers("strides", (16, 16))
    )
    _write(backbone, pooled, {"input": (1, 3, 255, 255)}, {"output": (1, 3, 16, 16)})
    values = {"output1": [0.0, logit], "output2": [16.0] * 4}
    graph = _both("input1", "input2")
    graph += b"".join(_constant_head(name, "both", np.array(value), 1) for name, value in values.items())
    outputs = {name: (1, len(value), 16, 16) for name, value in values.items()}
    _write(neckhead, graph, {"input1": (1, 3, 8, 8), "input2": (1, 3, 16, 16)}, outputs)


def _conv(source: str, name: str, weights: np.ndarray, bias: np.ndarray | None = None) -> bytes:
    """A convolution (out, in, k, k) with a stride of one and no border."""
    inputs = (source, f"{name}_w") if bias is None else (source, f"{name}_w", f"{name}_b")
    graph = _node("Conv", inputs, name, _integers("kernel_shape", weights.shape[2:]))
    graph += _initializer(f"{name}_w", weights.astype(np.float32))
    return graph if bias is None else graph + _initializer(f"{name}_b", bias.astype(np.float32))


def _alike(template: str, side: int, cells: str) -> bytes:
    """`alike` (1, 1, n, n): how far what is around each cell of the search differs from the whole as the target does.

    That is: the template's middle quarter less its rest, in colour, times the mean of nine cells less that of all,
    summed over the colours. A target of four cells is most alike in its middle.
    """
    middle = np.full((side, side), -4 / 3, np.float32)
    middle[side // 4 : side - side // 4, side // 4 : side - side // 4] = 4.0
    contrast = np.eye(3, dtype=np.float32)[:, :, None, None] * middle / side**2
    graph = _conv(template, "contrast", contrast)
    graph += _node("GlobalAveragePool", (cells,), "usual") + _node("Sub", (cells, "usual"), "unusual")
    graph += _node("Mul", ("unusual", "contrast"), "products") + _conv("products", "single", np.ones((1, 3, 1, 1)))
    around = _integers("kernel_shape", (3, 3)) + _integers("pads", (1, 1, 1, 1))
    return graph + _node("AveragePool", ("single",), "alike", around)


def write_colour_vit(path: Path) -> None:
    """A network for OpenCV's `TrackerVit` that compares: it finds what has the target's colour, as large as before."""
    window = _integers("kernel_shape", (16, 16)) + _integers("strides", (16, 16))
    graph = _node("AveragePool", ("search",), "cells", window) + _alike("template", 128, "cells")
    graph += _conv("alike", "logit", np.full((1, 1, 1, 1), 0.5), np.array([-2.0])) + _node(
        "Sigmoid", ("logit",), "output1"
    )
    sizes = {"output2": (0.25, 0.25), "output3": (0.5, 0.5)}
    for name, values in sizes.items():
        graph += _conv("cells", name, np.zeros((2, 3, 1, 1)), np.array(values))
    outputs = {"output1": (1, 1, 16, 16)} | dict.fromkeys(sizes, (1, 2, 16, 16))
    _write(path, graph, {"template": (1, 3, 128, 128), "search": (1, 3, 256, 256)}, outputs)


def write_colour_nano(backbone: Path, neckhead: Path) -> None:
    """Networks for OpenCV's `TrackerNano` that do the same: means of cells, and their comparison."""
    pooled = _node(
        "AveragePool", ("input",), "output", _integers("kernel_shape", (15, 15)) + _integers("strides", (16, 16))
    )
    _write(backbone, pooled, {"input": (1, 3, 255, 255)}, {"output": (1, 3, 16, 16)})
    graph = _alike("input1", 8, "input2")
    scores = np.array([0.0, 2e-4]).reshape(2, 1, 1, 1)  # of products of grey levels
    graph += _conv("alike", "output1", scores, np.array([0.0, -2.0]))
    # A cell's middle lies 8 px beyond the place that OpenCV takes for it, and the target is 64 px wide.
    graph += _conv("input2", "output2", np.zeros((4, 3, 1, 1)), np.array([24.0, 24.0, 40.0, 40.0]))
    outputs = {"output1": (1, 2, 16, 16), "output2": (1, 4, 16, 16)}
    _write(neckhead, graph, {"input1": (1, 3, 8, 8), "input2": (1, 3, 16, 16)}, outputs)


def write_channel_vit(path: Path, channel: int) -> None:
    """A network for OpenCV's `TrackerVit` whose score is what it is given in one channel, mean of a cell."""
    graph = _both("template", "search")
    window = _integers("kernel_shape", (16, 16)) + _integers("strides", (16, 16))
    graph += _node("AveragePool", ("both",), "cells", window)
    chosen = np.eye(3, dtype=np.float32)[channel].reshape(1, 3, 1, 1)
    graph += _conv("cells", "output1", chosen)
    for name, values in {"output2": (0.25, 0.25), "output3": (0.5, 0.5)}.items():
        graph += _conv("cells", name, np.zeros((2, 3, 1, 1)), np.array(values))
    outputs = {"output1": (1, 1, 16, 16), "output2": (1, 2, 16, 16), "output3": (1, 2, 16, 16)}
    _write(path, graph, {"template": (1, 3, 128, 128), "search": (1, 3, 256, 256)}, outputs)
