"""What `outrider topics` computes from what arrives, and how a message looks as a line."""

from __future__ import annotations

import io
import json

import pytest

from common import topics
from common.codec import encode, schema_hash
from common.header import Header, InputRef
from common.messages import Image, Message, Track
from common.topics_tool import StreamStats, line_of, print_table

MS = 1_000_000
IDLE = Track(state="idle")


def wire(message: Message, seq: int, capture_ns: int = 0, boot: int = 1) -> tuple[bytes, bytes]:
    reference = InputRef("camera/down/jpeg", 41, "camera", 0, 0, 0)
    return encode(Header(schema_hash(type(message)), "pursuit", boot, seq, 0, capture_ns, (reference,)), message)


def test_a_regular_stream_has_its_rate_and_no_jitter() -> None:
    stats = StreamStats("pursuit/track")
    for i in range(21):
        stats.add(*wire(IDLE, i, capture_ns=i * 50 * MS), received_ns=(i * 50 + 7) * MS)

    assert stats.rate_hz() == pytest.approx(20.0)
    assert stats.jitter_ms() == pytest.approx(0.0)
    assert max(stats.intervals_ms()) == pytest.approx(50.0)
    assert stats.age_ms() == (7.0, 7.0)
    assert (stats.messages, stats.lost, stats.sources) == (21, 0, {"pursuit"})
    assert stats.payload_bytes == 21 * len(wire(IDLE, 0)[0])


def test_gaps_in_the_sequence_are_losses_but_a_restart_is_none() -> None:
    stats = StreamStats("pursuit/track")
    for seq in (5, 6, 9, 10):
        stats.add(*wire(IDLE, seq), received_ns=seq * MS)
    stats.add(*wire(IDLE, 0, boot=2), received_ns=20 * MS)
    stats.add(*wire(IDLE, 2, boot=2), received_ns=21 * MS)

    assert stats.lost == 3


def test_what_no_node_would_accept_is_counted_by_reason() -> None:
    stats = StreamStats("pursuit/track")
    payload, attachment = wire(IDLE, 0)
    stats.add(b"\xc1", attachment, received_ns=1)
    stats.add(payload, None, received_ns=2)
    stats.add(payload, b"junk", received_ns=3)

    assert stats.refused == {"malformed": 1, "no header": 2}
    assert stats.messages == 3


def test_too_little_gives_no_figures() -> None:
    stats = StreamStats("pursuit/track")
    assert (stats.rate_hz(), stats.jitter_ms(), stats.age_ms()) == (None, None, None)
    stats.add(*wire(IDLE, 0), received_ns=MS)
    assert stats.rate_hz() is None


def test_stamps_of_another_machine_s_clock_are_no_age() -> None:
    stats = StreamStats("pursuit/track")
    stats.add(*wire(IDLE, 0, capture_ns=10**18), received_ns=MS)
    stats.add(*wire(IDLE, 1, capture_ns=0), received_ns=10**15)

    assert stats.age_ms() is None


def test_a_message_is_one_line_of_json() -> None:
    line = line_of(topics.topic("pursuit/track"), *wire(IDLE, 3, capture_ns=9))

    assert "\n" not in line
    shown = json.loads(line)
    assert shown["topic"] == "pursuit/track"
    assert shown["message"]["state"] == "idle"
    assert (shown["header"]["seq"], shown["header"]["capture_ns"]) == (3, 9)
    assert shown["header"]["inputs"] == ["camera/down/jpeg#41"]


def test_a_picture_is_shown_by_its_size() -> None:
    picture = Image(camera="down", width=64, height=48, encoding="gray8", data=bytes(64 * 48))

    shown = json.loads(line_of(topics.topic("camera/down/raw"), *wire(picture, 0)))

    assert shown["message"] == {"camera": "down", "width": 64, "height": 48, "encoding": "gray8", "data": "3072 bytes"}


def test_a_refused_message_is_a_line_too() -> None:
    shown = json.loads(line_of(topics.topic("pursuit/track"), b"junk", b"junk"))

    assert shown["refused"].startswith("no header: ")
    assert shown["bytes"] == 4


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    out = io.StringIO()

    print_table([("A", "B"), ("long one", "x")], out)

    assert out.getvalue() == "A         B\nlong one  x\n"
