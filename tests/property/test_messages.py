"""Every message type survives the wire, and nothing that is malformed gets through or crashes a reader."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.codec import Rejected, decode, decode_header, encode, schema_hash
from common.messages import Image, Message, MessageError
from tests.property.strategies import any_message, headers, images, is_valid, message_types, messages

TYPES = message_types()
FEW = settings(max_examples=20)  # for each of two dozen types
WITH_NUMBERS = [k for k in TYPES if "float" in repr([f.type for f in msgspec.structs.fields(k)])]


def paths_of_floats(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where the floats are in plain data."""
    if isinstance(value, float):
        yield path
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from paths_of_floats(item, (*path, key))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from paths_of_floats(item, (*path, index))


def with_value(data: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Plain data with one leaf replaced."""
    if not path:
        return value
    if isinstance(data, dict):
        return {k: with_value(v, path[1:], value) if k == path[0] else v for k, v in data.items()}
    return [with_value(v, path[1:], value) if i == path[0] else v for i, v in enumerate(data)]


def test_the_types_are_found() -> None:
    assert {"Image", "VehicleState", "Request", "Track", "Health", "PreflightItem"} <= {k.__name__ for k in TYPES}
    assert len(WITH_NUMBERS) > 5


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k.__name__)
@FEW
@given(data=st.data())
def test_round_trip(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    header = data.draw(headers(schema_hash(kind)))

    payload, attachment = encode(header, message)

    assert decode(kind, payload, attachment) == (header, message)


@pytest.mark.parametrize("kind", WITH_NUMBERS, ids=lambda k: k.__name__)
@FEW
@given(data=st.data(), poison=st.sampled_from((math.nan, math.inf, -math.inf)))
def test_a_number_that_is_not_finite_is_rejected_wherever_it_stands(
    kind: type[Message], data: st.DataObject, poison: float
) -> None:
    plain = msgspec.to_builtins(data.draw(messages(kind)))
    places = list(paths_of_floats(plain))
    assume(places)
    poisoned = with_value(plain, data.draw(st.sampled_from(places)), poison)
    header = data.draw(headers(schema_hash(kind)))
    message = msgspec.convert(poisoned, kind)

    with pytest.raises(MessageError):
        encode(header, message)
    with pytest.raises(Rejected) as refusal:
        decode(kind, msgspec.msgpack.encode(poisoned), msgspec.msgpack.encode((header, None)))
    assert refusal.value.reason == "content"


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k.__name__)
@FEW
@given(payload=st.binary(max_size=200), attachment=st.none() | st.binary(max_size=200))
def test_random_bytes_are_rejected_by_name(kind: type[Message], payload: bytes, attachment: bytes | None) -> None:
    with pytest.raises(Rejected) as refusal:
        decode(kind, payload, attachment)
    assert refusal.value.reason == "no header"


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k.__name__)
@FEW
@given(data=st.data(), payload=st.binary(max_size=200))
def test_random_bytes_behind_a_good_header_are_rejected_or_valid(
    kind: type[Message], data: st.DataObject, payload: bytes
) -> None:
    header = data.draw(headers(schema_hash(kind)))
    try:
        _, message = decode(kind, payload, msgspec.msgpack.encode((header, None)))
    except Rejected as refusal:
        assert refusal.reason in ("malformed", "content")
    else:
        assert is_valid(message)


@given(data=st.data())
def test_damaged_bytes_are_rejected_or_valid(data: st.DataObject) -> None:
    message = data.draw(any_message())
    header = data.draw(headers(schema_hash(type(message))))
    parts = [bytearray(p) for p in encode(header, message)]
    part = parts[data.draw(st.integers(0, 1))]
    assume(part)
    for _ in range(data.draw(st.integers(1, 3))):
        part[data.draw(st.integers(0, len(part) - 1))] = data.draw(st.integers(0, 255))
    payload, attachment = (bytes(p) for p in parts)
    payload = payload[: data.draw(st.integers(0, len(payload)))]
    try:
        _, arrived = decode(type(message), payload, attachment)
    except Rejected as refusal:
        assert refusal.reason in ("no header", "schema", "malformed", "content")
    else:
        assert type(arrived) is type(message)
        assert is_valid(arrived)


@given(images(), st.data())
def test_a_truncated_picture_is_rejected(picture: Image, data: st.DataObject) -> None:
    header = data.draw(headers(schema_hash(Image)))
    payload, attachment = encode(header, picture)

    with pytest.raises(Rejected) as refusal:
        decode(Image, payload[: data.draw(st.integers(0, len(payload) - 1))], attachment)
    assert refusal.value.reason == "content"


@given(data=st.data())
def test_a_header_is_read_without_knowing_the_type(data: st.DataObject) -> None:
    message = data.draw(any_message())
    header = data.draw(headers(schema_hash(type(message))))

    assert decode_header(encode(header, message)[1])[0] == header
