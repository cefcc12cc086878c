"""Recordings survive a round trip, and end cleanly where a killed writer left them."""

from __future__ import annotations

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.codec import encode, schema_hash
from common.header import Header, InputRef
from common.messages import Image, Message, Session, Track
from common.recording import HEADER_SUFFIX, RecordingError, RecordingWriter, read_configuration, read_recording

CONFIGURATION = {"bus": {"vehicle": "kite"}, "recorder": {"folder": "recordings", "segment_mb": 1000}}


def header_of(message: Message, seq: int) -> Header:
    source = InputRef("camera/down/jpeg", 7, "camera", 10, 11, 12)
    return Header(schema_hash(type(message)), "test", 99, seq, 1_000 + seq, 2_000 + seq, (source,))


def jpeg() -> Image:
    ok, data = cv2.imencode(".jpg", np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8))
    assert ok
    return Image(camera="down", width=64, height=48, encoding="jpeg", data=data.tobytes())


def write(writer: RecordingWriter, topic: str, message: Message, seq: int) -> None:
    payload, attachment = encode(header_of(message, seq), message)
    writer.write(topic, payload, attachment, 1_700_000_000_000_000_000 + seq)


def test_messages_and_headers_come_back_as_they_were(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages: list[tuple[str, Message]] = []
    for i in range(50):
        messages.append(("pursuit/track", Track(state="tracking", x_px=float(i))))
        messages.append(("camera/down/jpeg", jpeg()))
    with RecordingWriter(path, CONFIGURATION) as writer:
        for seq, (topic, message) in enumerate(messages):
            write(writer, topic, message, seq)

    read = list(read_recording(path))

    assert [(r.topic, r.message) for r in read] == messages
    assert [r.header for r in read] == [header_of(m, i) for i, (_, m) in enumerate(messages)]
    assert read_configuration(path) == CONFIGURATION


def test_payload_of_a_picture_is_the_plain_jpeg_for_other_tools(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    path = tmp_path / "a.mcap"
    picture = jpeg()
    with RecordingWriter(path, CONFIGURATION) as writer:
        write(writer, "camera/down/jpeg", picture, 0)

    with path.open("rb") as stream:
        found = {
            channel.topic: (channel.message_encoding, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
        }

    assert found["camera/down/jpeg"] == ("jpeg", picture.data)
    assert set(found) == {"camera/down/jpeg", "camera/down/jpeg" + HEADER_SUFFIX}


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 0.97])
def test_a_file_that_was_cut_off_is_read_up_to_its_last_whole_chunk(
    tmp_path: Path, share: float, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.mcap"
    ends: list[int] = []
    writer = RecordingWriter(path, CONFIGURATION)
    for second in range(10):
        for i in range(20):
            write(writer, "camera/down/jpeg", jpeg(), second * 20 + i)
        writer.flush()
        ends.append(writer.size_bytes)
    whole = path.read_bytes()
    writer.abandon()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * share)])

    with caplog.at_level(logging.WARNING):
        read = list(read_recording(cut))

    whole_chunks = sum(end <= cut.stat().st_size for end in ends)
    # The chunk's index follows it: a cut inside the index loses no message.
    assert len(read) in (whole_chunks * 20, (whole_chunks + 1) * 20)
    assert [r.header.seq for r in read] == list(range(len(read)))
    assert "ends in the middle" in caplog.text
    assert read_configuration(cut) == CONFIGURATION


def test_every_prefix_of_a_recording_is_read_or_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, CONFIGURATION) as writer:
        for seq in range(3):
            write(writer, "pursuit/track", Track(state="idle"), seq)
            writer.flush()
    whole = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    counts = []
    for length in range(1, len(whole)):
        cut.write_bytes(whole[:length])
        counts.append(len(list(read_recording(cut))))

    assert counts == sorted(counts), "a longer prefix never holds less"
    assert counts[-1] == 3


def test_damage_in_the_middle_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, CONFIGURATION) as writer:
        for seq in range(5):
            write(writer, "camera/down/jpeg", jpeg(), seq)
            writer.flush()
    damaged = bytearray(path.read_bytes())
    middle = len(damaged) // 2
    damaged[middle : middle + 16] = bytes(b ^ 0xFF for b in damaged[middle : middle + 16])
    path.write_bytes(damaged)

    with pytest.raises(RecordingError, match="damaged after"):
        list(read_recording(path))


def test_a_malformed_message_is_kept_in_the_file_and_left_out_on_reading(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, CONFIGURATION) as writer:
        write(writer, "pursuit/track", Track(state="idle"), 0)
        writer.write(
            "pursuit/track", b"\xc1 no message", encode(header_of(Track(state="idle"), 1), Track(state="idle"))[1], 1
        )
        writer.write("pursuit/track", b"no header", b"", 2)
        write(writer, "pursuit/track", Track(state="idle"), 3)

    with caplog.at_level(logging.WARNING):
        read = list(read_recording(path))

    assert [r.header.seq for r in read] == [0, 3]
    assert "malformed" in caplog.text
    assert "no header" in caplog.text


def test_messages_of_another_version_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payload, _ = encode(header_of(Track(state="idle"), 0), Track(state="idle"))
    session = Session(vehicle="kite", monotonic_ns=1, utc_ns=2)
    _, attachment = encode(header_of(session, 0), session)
    with RecordingWriter(path, CONFIGURATION) as writer:
        writer.write("pursuit/track", payload, attachment, 1)

    with pytest.raises(RecordingError, match=r"pursuit/track: Track from 'test' has schema .* same version"):
        list(read_recording(path))


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "a.mcap"
    text.write_text("this is no recording, but long enough to be read as one")

    with pytest.raises(RecordingError, match="no recording"):
        list(read_recording(text))
    with pytest.raises(RecordingError, match=r"b\.mcap: cannot be read \(No such file"):
        list(read_recording(tmp_path / "b.mcap"))
    with pytest.raises(FileExistsError):
        RecordingWriter(text, CONFIGURATION)
