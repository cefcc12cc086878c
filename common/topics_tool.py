"""Looks at the live bus: what `outrider topics`, `outrider topics hz` and `outrider topics echo` print."""

from __future__ import annotations

import os
import queue
import statistics
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, TextIO

import msgspec
import zenoh

from common import topics
from common.bus import Bus
from common.codec import Rejected, decode
from common.header import Header
from common.messages import Image, Message

_OTHER_CLOCK_MS = 60_000.0  # an age beyond this is no age: the stamp is of another machine's clock
_SILENCE_S = 3.0


class StreamStats:
    """Rate, regularity, age, volume and losses of one stream, from what arrived.

    Args:
        name: topic name.
    """

    def __init__(self, name: str):
        self.name = name
        self.messages = 0
        """Messages that arrived, refused ones included."""
        self.payload_bytes = 0
        """Their payloads, bytes."""
        self.lost = 0
        """Messages that never arrived, from gaps in the sequence."""
        self.refused: Counter[str] = Counter()
        """Messages that no node would accept, by reason."""
        self.sources: set[str] = set()
        """Names of the publishing nodes."""
        self._received_ns: list[int] = []
        self._ages_ms: list[float] = []
        self._last: dict[tuple[str, int], int] = {}

    def add(self, payload: bytes, attachment: bytes | None, received_ns: int) -> None:
        """Note a message as it arrived at a time (monotonic, ns)."""
        self.messages += 1
        self.payload_bytes += len(payload)
        self._received_ns.append(received_ns)
        try:
            header, _ = decode(topics.topic(self.name).type, payload, attachment)
        except Rejected as refusal:
            self.refused[refusal.reason] += 1
            return
        self._note(header, received_ns)

    def _note(self, header: Header, received_ns: int) -> None:
        self.sources.add(header.source)
        stream = (header.source, header.boot)
        if stream in self._last:
            self.lost += max(0, header.seq - self._last[stream] - 1)
        self._last[stream] = header.seq
        age_ms = (received_ns - header.capture_ns) / 1e6
        if 0.0 <= age_ms < _OTHER_CLOCK_MS:
            self._ages_ms.append(age_ms)

    def rate_hz(self) -> float | None:
        """Mean rate between the first and the last message, Hz; None with fewer than two."""
        span_ns = self._received_ns[-1] - self._received_ns[0] if self._received_ns else 0
        return (len(self._received_ns) - 1) * 1e9 / span_ns if span_ns > 0 else None

    def intervals_ms(self) -> list[float]:
        """Times between messages, ms."""
        return [(b - a) / 1e6 for a, b in zip(self._received_ns, self._received_ns[1:], strict=False)]

    def jitter_ms(self) -> float | None:
        """Standard deviation of the time between messages, ms; None with fewer than three."""
        intervals = self.intervals_ms()
        return statistics.stdev(intervals) if len(intervals) > 1 else None

    def age_ms(self) -> tuple[float, float] | None:
        """Median and largest time from capture to arrival, ms; None when the stamps are of another machine's clock."""
        return (statistics.median(self._ages_ms), max(self._ages_ms)) if self._ages_ms else None


def list_topics(bus: Bus, seconds: float, out: TextIO | None = None) -> None:
    """Print every topic with its type, nominal and live rate, publisher and purpose.

    Args:
        bus: session to listen on; topics that stay on the vehicle show no rate on the ground.
        seconds: how long to listen.
        out: where to print; None for standard output.
    """
    found = _listen(bus, [*topics.TOPICS, topics.health_topic("*").name], seconds)
    live_health = sorted(name for name in found if name.startswith("health/"))
    rows = [("TOPIC", "TYPE", "NOMINAL", "LIVE", "FROM", "WHAT")]
    for name in [*topics.TOPICS, *live_health]:
        topic, stats = topics.topic(name), found.get(name)
        rows.append(
            (
                name,
                topic.type.__name__,
                f"{topic.rate_hz:g} Hz" if topic.rate_hz else "events",
                _live(stats, seconds),
                ", ".join(sorted(stats.sources)) if stats else "",
                topic.doc,
            )
        )
    print_table(rows, out)


def _live(stats: StreamStats | None, seconds: float) -> str:
    if stats is None or not stats.messages:
        return "-"
    rate = stats.rate_hz()
    return f"{stats.messages} in {seconds:g} s" if rate is None else f"{rate:.1f} Hz"


def hz(bus: Bus, names: Sequence[str], seconds: float, out: TextIO | None = None) -> None:
    """Measure topics and print a line for each: rate, jitter, longest gap, age, volume, losses, refusals.

    Args:
        bus: session to listen on.
        names: topics; none means all of the table.
        seconds: how long to listen.
        out: where to print; None for standard output.

    Raises:
        KeyError: an unknown topic; the text suggests the nearest one.
    """
    for name in names:
        topics.topic(name)
    found = _listen(bus, names or list(topics.TOPICS), seconds)
    rows = [("TOPIC", "HZ", "JITTER ms", "GAP ms", "AGE ms", "AGE MAX", "kB/s", "LOST", "REFUSED")]
    for name in names or topics.TOPICS:
        stats = found.get(name, StreamStats(name))
        gap_ms = max(stats.intervals_ms(), default=None)
        age = stats.age_ms()
        rows.append(
            (
                name,
                _number(stats.rate_hz()),
                _number(stats.jitter_ms()),
                _number(gap_ms),
                _number(age and age[0]),
                _number(age and age[1]),
                f"{stats.payload_bytes / 1e3 / seconds:.1f}",
                str(stats.lost),
                ", ".join(f"{n} {reason}" for reason, n in stats.refused.items()) or "0",
            )
        )
    print_table(rows, out)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def echo(bus: Bus, name: str, count: int, out: TextIO | None = None) -> None:
    """Print the messages of a topic, one JSON object a line, until interrupted.

    Pictures are named by their size alone. A message that no node would accept is a line with the reason.

    Args:
        bus: session to listen on.
        name: topic.
        count: how many messages to print; 0 for no end.
        out: where to print; None for standard output.

    Raises:
        KeyError: an unknown topic; the text suggests the nearest one.
    """
    topic = topics.topic(name)
    arrived: queue.SimpleQueue[tuple[bytes, bytes | None]] = queue.SimpleQueue()
    bus.subscribe_raw(name, lambda sample: arrived.put(_bytes_of(sample)))
    printed = 0
    heard = False
    began_s = time.monotonic()
    try:
        while not count or printed < count:
            try:
                payload, attachment = arrived.get(timeout=0.2)
            except queue.Empty:
                if not heard and time.monotonic() - began_s > _SILENCE_S:
                    heard = True
                    print(f"nothing on {name} yet; is its node running (`outrider topics`)?", file=sys.stderr)
                continue
            heard = True
            print(line_of(topic, payload, attachment), file=out or sys.stdout, flush=True)
            printed += 1
    except BrokenPipeError:
        # The reader (`| head`) has seen enough. What is still buffered goes nowhere, without a second complaint.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def line_of(topic: topics.Topic, payload: bytes, attachment: bytes | None) -> str:
    """A message as one line of JSON: `header` and `message`, or `refused`."""
    try:
        header, message = decode(topic.type, payload, attachment)
    except Rejected as refusal:
        return _json({"topic": topic.name, "refused": str(refusal), "bytes": len(payload)})
    return _json({"topic": topic.name, "header": _header_fields(header), "message": _message_fields(message)})


def _header_fields(header: Header) -> dict[str, Any]:
    fields = {name: getattr(header, name) for name in header.__struct_fields__}
    fields["inputs"] = [f"{ref.topic}#{ref.seq}" for ref in header.inputs]
    return fields


def _message_fields(message: Message) -> dict[str, Any]:
    fields = {name: getattr(message, name) for name in message.__struct_fields__}
    if isinstance(message, Image):
        fields["data"] = f"{len(message.data)} bytes"
    return fields


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _bytes_of(sample: zenoh.Sample) -> tuple[bytes, bytes | None]:
    attachment = sample.attachment
    return sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()


def _listen(bus: Bus, patterns: Iterable[str], seconds: float) -> dict[str, StreamStats]:
    """What arrives on some topics in so many seconds, by topic name."""
    prefix = topics.key(bus.config.vehicle, "")
    arrived: queue.SimpleQueue[tuple[str, bytes, bytes | None, int]] = queue.SimpleQueue()

    def receive(sample: zenoh.Sample) -> None:
        arrived.put((str(sample.key_expr).removeprefix(prefix), *_bytes_of(sample), time.monotonic_ns()))

    for pattern in patterns:
        bus.subscribe_raw(pattern, receive)
    found: dict[str, StreamStats] = {}
    deadline_s = time.monotonic() + seconds
    while (remaining_s := deadline_s - time.monotonic()) > 0:
        try:
            name, payload, attachment, received_ns = arrived.get(timeout=remaining_s)
        except queue.Empty:
            break
        found.setdefault(name, StreamStats(name)).add(payload, attachment, received_ns)
    return found


def print_table(rows: Sequence[Sequence[str]], out: TextIO | None) -> None:
    """Print rows of cells in columns; the first row is the heading."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        print(
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip(),
            file=out or sys.stdout,
        )
