"""Bytes and back: what is refused, under which name, and that versions are told apart."""

from __future__ import annotations

import math

import msgspec
import pytest

from common.codec import Rejected, decode, decode_header, encode, schema_hash
from common.header import Header, InputRef
from common.messages import Image, Message, MessageError, Obstacle, Obstacles, Session, Track

TRACK = Track(state="tracking", x_px=12.5, error=(0.1, -0.2))
PICTURE = Image(camera="down", width=2, height=1, encoding="bgr8", data=b"abcdef")


def header(kind: type[Message], **changes: int) -> Header:
    source = InputRef("camera/down/jpeg", 7, "camera", 10, 11, 12)
    return msgspec.structs.replace(Header(schema_hash(kind), "pursuit", 2**62, 3, 100, 90, (source,)), **changes)


def test_a_message_comes_back_with_its_header() -> None:
    payload, attachment = encode(header(Track), TRACK)

    assert decode(Track, payload, attachment) == (header(Track), TRACK)
    assert decode_header(attachment) == (header(Track), None)


def test_the_payload_of_a_picture_is_its_pixels_alone() -> None:
    payload, attachment = encode(header(Image), PICTURE)

    assert payload == PICTURE.data
    assert decode(Image, payload, attachment) == (header(Image), PICTURE)
    assert len(attachment) < 200


def test_an_invalid_message_is_not_encoded() -> None:
    with pytest.raises(MessageError, match="x_px: got nan"):
        encode(header(Track), Track(state="tracking", x_px=math.nan))


@pytest.mark.parametrize(
    ("payload", "reason", "words"),
    [
        (b"", "malformed", "truncated"),
        (b"\xc1", "malformed", "MessagePack data is malformed"),
        (b"\x80", "malformed", "missing required field `state`"),
        (msgspec.msgpack.encode({"state": "idle"}) + b"\x00", "malformed", "trailing characters"),
        (msgspec.msgpack.encode({"state": "idle", "surprise": 1}), "malformed", "unknown field `surprise`"),
        (b"\x81\xa5state\xa2\xff\xfe", "malformed", "utf-8"),
        (
            msgspec.msgpack.encode({"state": "idle", "x_px": math.inf}),
            "content",
            "x_px: got inf, expected a finite number",
        ),
    ],
)
def test_a_bad_payload_is_refused_with_a_reason(payload: bytes, reason: str, words: str) -> None:
    _, attachment = encode(header(Track), TRACK)

    with pytest.raises(Rejected, match=words) as refusal:
        decode(Track, payload, attachment)
    assert refusal.value.reason == reason
    assert "'pursuit'" in refusal.value.detail, "the sender is named"


@pytest.mark.parametrize(
    "attachment",
    [
        None,
        b"",
        b"\xc0",
        b"\x92\x90\xc0",
        b"no header at all",
        msgspec.msgpack.encode((header(Track), None))[:-2],
        msgspec.msgpack.encode((header(Track), None)).replace(b"\xa7pursuit", b"\xa7purs\xff\xfe\xfd"),
        msgspec.msgpack.encode((header(Track), None))[:-1] + b"\x81\xa1a" + b"\x91" * 50_000 + b"\x01",
    ],
    ids=["none", "empty", "nil", "short", "text", "cut", "no UTF-8", "endless nesting"],
)
def test_a_message_without_a_proper_header_is_refused(attachment: bytes | None) -> None:
    payload, _ = encode(header(Track), TRACK)

    with pytest.raises(Rejected) as refusal:
        decode(Track, payload, attachment)
    assert refusal.value.reason == "no header"


def test_another_schema_is_refused_by_name() -> None:
    payload, attachment = encode(header(Session), Session(vehicle="kite", monotonic_ns=1, utc_ns=2))

    with pytest.raises(Rejected, match=r"Track from 'pursuit' has schema .*same version of Outrider") as refusal:
        decode(Track, payload, attachment)
    assert refusal.value.reason == "schema"


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"width": 2, "height": 1, "encoding": "bgr8"},
        {"camera": "down", "width": 2, "height": 1, "encoding": "png"},
        {"camera": "down", "width": 2.5, "height": 1, "encoding": "bgr8"},
        {"camera": "down", "width": 2, "height": 1, "encoding": "bgr8", "colour": "red"},
        {3: 4},
    ],
)
def test_a_picture_whose_fields_are_wrong_is_refused(fields: dict) -> None:
    attachment = msgspec.msgpack.encode((header(Image), fields))

    with pytest.raises(Rejected) as refusal:
        decode(Image, PICTURE.data, attachment)
    assert refusal.value.reason == "malformed"


def test_a_picture_with_too_few_pixels_is_refused() -> None:
    payload, attachment = encode(header(Image), PICTURE)

    with pytest.raises(Rejected, match="got 5 bytes, expected 6") as refusal:
        decode(Image, payload[:-1], attachment)
    assert refusal.value.reason == "content"


def test_the_schema_follows_names_and_types_through_nested_messages() -> None:
    base = msgspec.defstruct("Point", [("x_m", float)], bases=(Message,), frozen=True)
    renamed = msgspec.defstruct("Point", [("y_m", float)], bases=(Message,), frozen=True)
    retyped = msgspec.defstruct("Point", [("x_m", int)], bases=(Message,), frozen=True)
    outer = [
        msgspec.defstruct("Line", [("points", tuple[kind, ...])], bases=(Message,), frozen=True)
        for kind in (base, renamed, retyped)
    ]

    assert len({schema_hash(kind) for kind in (base, renamed, retyped)}) == 3
    assert len({schema_hash(kind) for kind in outer}) == 3
    assert schema_hash(Obstacles) != schema_hash(Obstacle)
    assert 0 <= schema_hash(Track) < 2**32


def test_the_schema_is_the_same_in_every_process() -> None:
    import subprocess
    import sys

    code = "from common.codec import schema_hash; from common.messages import Health; print(schema_hash(Health))"
    printed = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": "."},
        ).stdout
        for seed in ("1", "2")
    }

    assert len(printed) == 1
