"""Hypothesis strategies for every message type, made from the types themselves."""

from __future__ import annotations

import math
import types
import typing
from typing import Any, Literal

import msgspec
from hypothesis import strategies as st

from common.header import Header, InputRef
from common.messages import (
    JOINTS,
    SECTORS,
    CameraInfo,
    Image,
    LimiterStatus,
    Message,
    MessageError,
    Obstacle,
    PersonDetection,
    PersonPicture,
    Request,
    View,
)

int64 = st.integers(-(2**63), 2**63 - 1)
numbers = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(max_size=12)


def message_types() -> list[type[Message]]:
    """Every message type there is, nested ones included, by name."""
    found: list[type[Message]] = []
    waiting = list(Message.__subclasses__())
    while waiting:
        kind = waiting.pop()
        found.append(kind)
        waiting += kind.__subclasses__()
    return sorted((k for k in found if k.__module__.startswith("common.messages")), key=lambda k: k.__name__)


def _unit(size: int) -> st.SearchStrategy[tuple[float, ...]]:
    parts = st.tuples(*[st.floats(-1.0, 1.0)] * size).filter(lambda v: math.hypot(*v) > 0.1)
    return parts.map(lambda v: tuple(c / math.hypot(*v) for c in v))


def images() -> st.SearchStrategy[Image]:
    """Small pictures of every encoding."""

    def fill(width: int, height: int, encoding: str, byte: int) -> Image:
        if encoding == "jpeg":
            data = b"\xff\xd8" + bytes([byte]) * width + b"\xff\xd9"
        else:
            data = bytes([byte]) * (width * height * {"bgr8": 3, "gray8": 1}[encoding])
        return Image(camera="down", width=width, height=height, encoding=typing.cast(Any, encoding), data=data)

    return st.builds(
        fill, st.integers(1, 20), st.integers(1, 20), st.sampled_from(("bgr8", "gray8", "jpeg")), st.integers(0, 255)
    )


def views() -> st.SearchStrategy[View]:
    """Views of a few cells."""

    def build(columns: int, rows: int, seen: bytes, width: float, height: float, range_m: float, q: Any) -> View:
        return View(
            ned_q_sensor=q,
            half_width_rad=width,
            half_height_rad=height,
            range_m=range_m,
            columns=columns,
            rows=rows,
            seen=tuple(bool(b & 1) for b in seen[: columns * rows]),
        )

    return st.builds(
        build,
        st.integers(1, 4),
        st.integers(1, 4),
        st.binary(min_size=16, max_size=16),
        st.floats(0.01, math.pi),
        st.floats(0.01, math.pi / 2),
        st.floats(0.0, 1e4),
        _unit(4),
    )


# Fields whose promise is narrower than their type; a new one that is missing here fails the tests by name.
_NARROW: dict[tuple[type[Message], str], st.SearchStrategy[Any]] = {
    (CameraInfo, "fx_px"): st.floats(1.0, 1e5),
    (CameraInfo, "fy_px"): st.floats(1.0, 1e5),
    (LimiterStatus, "seen"): st.lists(st.booleans(), min_size=SECTORS, max_size=SECTORS).map(tuple),
    (LimiterStatus, "sectors_m"): st.lists(numbers, min_size=SECTORS, max_size=SECTORS).map(tuple),
    (Obstacle, "distance_m"): st.floats(0.0, 1e4),
    (Obstacle, "ned_direction"): _unit(3),
    (PersonDetection, "number"): st.integers(1, 2**31),
    (PersonDetection, "joints_px"): st.tuples(*[st.tuples(numbers, numbers, numbers)] * len(JOINTS)),
    (PersonPicture, "jpeg"): st.binary(max_size=50).map(lambda data: b"\xff\xd8" + data + b"\xff\xd9"),
    (Request, "valid_ms"): st.floats(0.0, 10_000.0),
}


def messages(kind: type[Message]) -> st.SearchStrategy[Any]:
    """Valid messages of a type."""
    if kind is Image:
        return images()
    if kind is View:
        return views()
    fields = {}
    for field in msgspec.structs.fields(kind):
        if (kind, field.name) in _NARROW:
            fields[field.name] = _NARROW[kind, field.name]
        elif "_q_" in field.name:
            fields[field.name] = _unit(4)
        else:
            fields[field.name] = _of_type(field.type)
    return st.builds(kind, **fields)


def any_message() -> st.SearchStrategy[Message]:
    """Valid messages of any type."""
    return st.sampled_from(message_types()).flatmap(messages)


def headers(schema: int) -> st.SearchStrategy[Header]:
    """Headers of messages with this schema hash."""
    references = st.builds(InputRef, text, int64, text, int64, int64, int64)
    return st.builds(
        Header, st.just(schema), text, int64, int64, int64, int64, st.lists(references, max_size=3).map(tuple)
    )


def is_valid(message: Message) -> bool:
    """Whether a message keeps its promises."""
    try:
        message.check()
    except MessageError:
        return False
    return True


def _of_type(kind: Any) -> st.SearchStrategy[Any]:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    simple = {
        bool: st.booleans(),
        int: int64,
        float: numbers,
        str: text,
        bytes: st.binary(max_size=50),
        type(None): st.none(),
    }
    if kind in simple:
        return simple[kind]
    if origin is Literal:
        return st.sampled_from(arguments)
    if origin in (typing.Union, types.UnionType):
        return st.one_of([_of_type(a) for a in arguments])
    if origin is tuple and arguments[-1] is Ellipsis:
        return st.lists(_of_type(arguments[0]), max_size=4).map(tuple)
    if origin is tuple:
        return st.tuples(*[_of_type(a) for a in arguments])
    if origin is dict:
        return st.dictionaries(_of_type(arguments[0]), _of_type(arguments[1]), max_size=4)
    if isinstance(kind, type) and issubclass(kind, Message):
        return messages(kind)
    raise TypeError(f"no strategy for a field of type {kind!r}: add one here")
