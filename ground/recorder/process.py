"""The recorder: writes every recorded topic to MCAP files, from the first message on.

It subscribes to each topic by name, never to everything at once: a wildcard would pull the raw pictures over the radio.
"""

from __future__ import annotations

import logging
import os
import statistics
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import zenoh

from common import topics
from common.bus import Bus
from common.config import Config, ConfigError
from common.heartbeat import beat
from common.messages import Health
from common.recording import RecordingWriter
from common.session import BusConfig
from ground.recorder.config import RecorderConfig
from ground.recorder.intake import Intake, RawMessage

log = logging.getLogger(__name__)

EXIT_FAILED = 2
_NAME = "recorder"
_PERIOD_S = 0.1  # writing in batches: ten wake-ups a second instead of one for each message
_FLUSH_S = 0.7  # with the period and the writing on top, a kill loses less than a second
_HEALTH_S = 1.0
_INTAKE_BYTES = 64_000_000  # a minute of pictures at 640x480 and 20 Hz


class Segments:
    """The files of one run: one at a time, a new one when it has grown large.

    Args:
        folder: where they go; made when missing.
        vehicle: part of each file's name.
        segment_bytes: size above which a new file begins.
        configuration: resolved configuration, kept in each file.

    Raises:
        ConfigError: the folder or the first file cannot be made.
    """

    def __init__(self, folder: Path, vehicle: str, segment_bytes: int, configuration: dict[str, Any]):
        self._folder = folder
        self._vehicle = vehicle
        self._segment_bytes = segment_bytes
        self._configuration = configuration
        self._closed_bytes = 0
        self._closed_messages = 0
        self.error = ""
        """Why nothing is written any more; empty while all is well."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._writer: RecordingWriter | None = self._begin()
        except OSError as error:
            raise ConfigError(
                f"recorder: cannot write to {str(folder)!r} ({error.strerror}); make it writable, free "
                f"some space, or set recorder.folder to another folder"
            ) from None

    def _begin(self) -> RecordingWriter:
        stem = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}_{self._vehicle}"
        path, number = self._folder / f"{stem}.mcap", 1
        while path.exists():
            number += 1
            path = self._folder / f"{stem}-{number}.mcap"
        writer = RecordingWriter(path, self._configuration)
        writer.flush()
        log.info("recording to %s", path)
        return writer

    @property
    def bytes_written(self) -> int:
        """Size of all files of this run, bytes."""
        return self._closed_bytes + (self._writer.size_bytes if self._writer else 0)

    @property
    def messages(self) -> int:
        """Messages in all files of this run."""
        return self._closed_messages + (self._writer.messages if self._writer else 0)

    def write(self, batch: list[RawMessage]) -> None:
        """Add messages; nothing happens after an error."""
        self._guarded(lambda writer: [writer.write(*message) for message in batch])

    def flush(self) -> None:
        """Make what was written safe from a kill of this process; begin a new file when this one is large."""
        self._guarded(self._flush)

    def _flush(self, writer: RecordingWriter) -> None:
        writer.flush()
        if writer.size_bytes >= self._segment_bytes:
            self._close(writer)
            self._writer = self._begin()

    def close(self) -> None:
        """Finish the last file."""
        self._guarded(self._close)

    def _close(self, writer: RecordingWriter) -> None:
        writer.close()
        self._closed_bytes += writer.path.stat().st_size
        self._closed_messages += writer.messages
        self._writer = None

    def _guarded(self, work: Callable[[RecordingWriter], object]) -> None:
        writer = self._writer
        if writer is None:
            return
        try:
            work(writer)
        except OSError as error:
            self.error = (
                f"cannot write to {str(writer.path)!r} ({error.strerror}): recording has ended; free some "
                f"space or set recorder.folder to another folder, then restart the recorder"
            )
            log.error("%s", self.error)
            if self._writer is not None:
                writer.abandon()
                self._closed_messages += writer.messages
                self._writer = None


def run(config: Config, stop: threading.Event) -> int:
    """Record until told to stop; returns the exit code.

    A disk that fills up in flight ends the recording, not the process: it goes on to say so in its health (ending
    would take the ground station down with it) and exits with 2 when it is told to stop.

    Raises:
        ConfigError: the folder cannot be written when it starts.
        RouterAbsent: told to stop while waiting for the router.
    """
    settings = config.section(RecorderConfig)
    bus_config = config.section(BusConfig)
    segments = None
    if settings.enabled:
        segments = Segments(
            Path(settings.folder), bus_config.vehicle, settings.segment_mb * 1_000_000, config.resolved()
        )
    try:
        with Bus(bus_config, "ground", _NAME, stop=stop) as bus:
            bus.announce()
            return _record(bus, segments, stop)
    finally:
        if segments is not None:
            segments.close()


def recorded_names() -> list[str]:
    """Topic names to subscribe to: all recorded ones, and the health of every node."""
    return [t.name for t in topics.TOPICS.values() if t.recorded] + [topics.health_topic("*").name]


def _record(bus: Bus, segments: Segments | None, stop: threading.Event) -> int:
    intake = Intake(_INTAKE_BYTES)
    prefix = topics.key(bus.config.vehicle, "")

    def receive(sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        intake.put(
            RawMessage(
                str(sample.key_expr).removeprefix(prefix),
                sample.payload.to_bytes(),
                b"" if attachment is None else attachment.to_bytes(),
                time.time_ns(),
            )
        )

    if segments is not None:
        for name in recorded_names():
            bus.subscribe_raw(name, receive)
    steps = 0
    durations_ms: list[float] = []
    flush_at_s = health_at_s = time.monotonic()
    while not stop.wait(_PERIOD_S):
        began_s = time.monotonic()
        if segments is not None:
            segments.write(intake.take())
            if began_s >= flush_at_s:
                segments.flush()
                flush_at_s = began_s + _FLUSH_S
        now_s = time.monotonic()
        steps += 1
        durations_ms.append((now_s - began_s) * 1e3)
        if now_s >= health_at_s:
            beat()
            bus.publish(topics.health_topic(_NAME).name, _health(segments, intake, steps, durations_ms))
            durations_ms.clear()
            health_at_s = now_s + _HEALTH_S
    if segments is not None:
        segments.write(intake.take())
    return EXIT_FAILED if segments is not None and segments.error else 0


def _health(segments: Segments | None, intake: Intake, steps: int, durations_ms: list[float]) -> Health:
    error = "" if segments is None else segments.error
    return Health(
        node=_NAME,
        pid=os.getpid(),
        steps=steps,
        step_ms_median=statistics.median(durations_ms),
        step_ms_max=max(durations_ms),
        input_age_ms={},
        dropped={"all": intake.dropped},
        rejected={},
        errors=1 if error else 0,
        last_error=error,
        metrics={
            "bytes_written": float(0 if segments is None else segments.bytes_written),
            "messages": float(0 if segments is None else segments.messages),
            "recording": float(segments is not None and not error),
        },
    )
