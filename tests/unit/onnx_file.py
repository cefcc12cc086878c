"""The smallest ONNX file that answers something: its output is its input, written field by field."""

from __future__ import annotations

from pathlib import Path


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
