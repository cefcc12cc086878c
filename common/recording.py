"""Recordings: MCAP files that hold what passed on the bus, payload and header as they were.

A stream has two channels: `camera/down/jpeg` holds the payloads (a JPEG file, or MessagePack), and
`camera/down/jpeg#header` the attachments, each just before its payload, with the same sequence number and log time
(UTC of the recording machine, ns). Payloads are plain: any MCAP tool that is told that the channel holds JPEG files can
show the pictures. The resolved configuration is MCAP metadata at the beginning of the file.

Chunks are compressed, and closed by `RecordingWriter.flush`: a recording whose writer was killed is read up to its last
whole chunk. Files that were closed end with an index that lets viewers seek; reading here needs none.
"""

from __future__ import annotations

import contextlib
import json
import logging
import struct
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import mcap.records as records
import zstandard
from mcap.exceptions import McapError
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from common import topics
from common.codec import Rejected, decode
from common.header import Header
from common.messages import Image, Message

log = logging.getLogger(__name__)

HEADER_SUFFIX = "#header"
_CONFIGURATION = "configuration"
_CHUNK_BYTES = 1 << 20
_UNREADABLE = (McapError, CRCValidationError, zstandard.ZstdError, struct.error, UnicodeDecodeError)


class RecordingError(ValueError):
    """A recording that cannot be read; the text names the file, what was found and what was expected."""


class Recorded(NamedTuple):
    """One message of a recording."""

    topic: str
    """Topic name, as in `common.topics`."""
    header: Header
    """The header that it carried."""
    message: Message
    """The message, checked as on receipt."""


class RecordingWriter:
    """Writes one recording.

    Args:
        path: file to create.
        configuration: resolved configuration, section name to plain data.

    Raises:
        OSError: the file exists or cannot be created.
    """

    def __init__(self, path: Path, configuration: dict[str, Any]):
        self.path = path
        self.messages = 0
        """Messages written so far."""
        self._stream = path.open("xb")
        self._writer = Writer(self._stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._channels: dict[str, tuple[int, int]] = {}
        self._sequence: Counter[str] = Counter()
        self._writer.start(profile="outrider")
        self._writer.add_metadata(_CONFIGURATION, {name: json.dumps(table) for name, table in configuration.items()})

    @property
    def size_bytes(self) -> int:
        """Bytes written so far, without the chunk in progress."""
        return self._stream.tell()

    def write(self, topic: str, payload: bytes, attachment: bytes, log_ns: int) -> None:
        """Add a message as it came from the bus.

        Args:
            topic: topic name.
            payload: bytes of the message.
            attachment: bytes of the header; empty when there was none.
            log_ns: when it was received, UTC, ns.

        Raises:
            OSError: the disk is full or gone.
        """
        header_channel, payload_channel = self._channels_of(topic, payload)
        sequence = self._sequence[topic] & 0xFFFF_FFFF  # 32 bits in MCAP
        self._sequence[topic] += 1
        self._writer.add_message(header_channel, log_ns, attachment, log_ns, sequence)
        self._writer.add_message(payload_channel, log_ns, payload, log_ns, sequence)
        self.messages += 1

    def _channels_of(self, topic: str, payload: bytes) -> tuple[int, int]:
        if topic not in self._channels:
            kind = topics.topic(topic).type
            encoding = "msgpack"
            if kind is Image:
                encoding = "jpeg" if payload.startswith(b"\xff\xd8") else "raw"
            about = {"type": kind.__name__}
            self._channels[topic] = (
                self._writer.register_channel(topic + HEADER_SUFFIX, "msgpack", schema_id=0, metadata=about),
                self._writer.register_channel(topic, encoding, schema_id=0, metadata=about),
            )
        return self._channels[topic]

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the operating system: a kill from now on does not lose it.

        Raises:
            OSError: the disk is full or gone.
        """
        self._writer.flush()

    def close(self) -> None:
        """Write the index and close the file.

        Raises:
            OSError: the disk is full or gone; the file is closed all the same.
        """
        try:
            self._writer.finish()
        finally:
            self._stream.close()

    def abandon(self) -> None:
        """Close the file as it is, after an error; what was flushed stays readable."""
        with contextlib.suppress(OSError):
            self._stream.close()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close() if kind is None else self.abandon()


def read_recording(path: Path) -> Iterator[Recorded]:
    """Messages of a recording, in the order in which they were received.

    A file that ends in the middle (its writer was killed) is read up to its last whole chunk, with a warning. A message
    that would have been refused on receipt is left out, with one warning for each topic and reason.

    Raises:
        RecordingError: no such file, no recording, damage in the middle, or messages of another version of Outrider.
    """
    refused: Counter[tuple[str, str]] = Counter()
    for name, payload, attachment in _pairs(path):
        try:
            header, message = decode(topics.topic(name).type, payload, attachment)
        except KeyError as error:
            raise RecordingError(f"{path}: {error.args[0]}") from None
        except Rejected as refusal:
            if refusal.reason == "schema":
                raise RecordingError(f"{path}: {name}: {refusal.detail}") from None
            if not refused[name, refusal.reason]:
                log.warning("%s: %s: left out a message: %s", path, name, refusal)
            refused[name, refusal.reason] += 1
            continue
        yield Recorded(name, header, message)


def read_configuration(path: Path) -> dict[str, Any]:
    """Resolved configuration that a recording was made with: section name to plain data.

    Raises:
        RecordingError: no such file, or no recording of Outrider.
    """
    with contextlib.closing(_records(path)) as found:
        for record in found:
            if isinstance(record, records.Metadata) and record.name == _CONFIGURATION:
                return {name: json.loads(text) for name, text in record.metadata.items()}
    raise RecordingError(f"{path}: holds no configuration, expected a recording of Outrider")


def _pairs(path: Path) -> Iterator[tuple[str, bytes, bytes]]:
    """Topic, payload and attachment of each message."""
    channels: dict[int, str] = {}
    attachments: dict[str, tuple[int, bytes]] = {}
    for record in _records(path):
        if isinstance(record, records.Channel):
            channels[record.id] = record.topic
        elif isinstance(record, records.Message):
            name = channels[record.channel_id]
            if name.endswith(HEADER_SUFFIX):
                attachments[name.removesuffix(HEADER_SUFFIX)] = (record.sequence, record.data)
            else:
                sequence, attachment = attachments.pop(name, (record.sequence, b""))
                yield name, record.data, attachment if sequence == record.sequence else b""


def _records(path: Path) -> Generator[records.McapRecord]:
    """Records of an MCAP file, those inside chunks included; ends with a warning where a cut-off file ends."""
    try:
        stream = path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from None
    with stream:
        size = path.stat().st_size
        try:
            for record in StreamReader(stream, emit_chunks=True).records:
                # A cut-off chunk is noticed by its checksum, before any of its messages is handed on.
                if isinstance(record, records.Chunk):
                    yield from breakup_chunk(record, validate_crc=True)
                else:
                    yield record
        except _UNREADABLE as error:
            text = str(error) or type(error).__name__
            if stream.tell() < size or stream.tell() == 0:
                raise RecordingError(
                    f"{path}: damaged after {stream.tell()} of {size} bytes, or no recording: {text}"
                ) from None
            log.warning("%s: ends in the middle (was its writer killed?); read up to its last whole chunk", path)
