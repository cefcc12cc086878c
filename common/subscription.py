"""A reader of one topic: it keeps the latest, in a ring of Zenoh, and its thread decodes, checks and hands on."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import zenoh

from common import topics
from common.codec import Rejected, decode
from common.header import Header, Received

log = logging.getLogger(__name__)

_QUEUE_DEPTH = 256


def survive(name: str, work: Callable[[], None]) -> None:
    """Call a reader's callback; its exception is logged, and the reader goes on with the next message."""
    try:
        work()
    except Exception:
        log.exception("%s: a callback failed", name)


class Subscription:
    """A reader of one topic: a ring in Zenoh, one thread that decodes, checks and hands on."""

    def __init__(
        self, session: zenoh.Session, vehicle: str, topic: topics.Topic, callback: Callable[[Received[Any]], None]
    ):
        self.topic = topic
        self.rejected: Counter[str] = Counter()
        """Messages refused at the door, by reason."""
        self.dropped = 0
        """Messages that were overwritten in the ring or lost on the way, from gaps in the sequence."""
        self._callback = callback
        self._last: dict[tuple[str, int], int] = {}
        depth = 1 if topic.delivery == "latest" else _QUEUE_DEPTH
        self._subscriber = session.declare_subscriber(
            topics.key(vehicle, topic.name), zenoh.handlers.RingChannel(depth)
        )
        # The thread waits at the ring, not at the subscriber, which could not be undeclared meanwhile.
        self._ring = self._subscriber.handler
        self.thread = threading.Thread(target=self._read, name=f"read {topic.name}", daemon=True)
        """Ends when this or the session is closed."""
        self.thread.start()

    def close(self) -> None:
        """Stop reading; what is still in the ring is dropped."""
        with contextlib.suppress(zenoh.ZError):
            self._subscriber.undeclare()

    def _read(self) -> None:
        while True:
            try:
                sample = self._ring.recv()
            except Exception:  # noqa: BLE001 — the binding raises several types once it is closed
                return
            received_ns = time.monotonic_ns()
            attachment = sample.attachment
            try:
                header, message = decode(
                    self.topic.type,
                    sample.payload.to_bytes(),
                    attachment.to_bytes() if attachment is not None else None,
                )
            except Rejected as refusal:
                self._count_rejection(refusal)
                continue
            self._count_gap(header)
            received = Received(message, header, received_ns)
            survive(self.topic.name, lambda r=received: self._callback(r))

    def _count_rejection(self, refusal: Rejected) -> None:
        # The first of each kind is worth a line; a flood of them is worth a number only.
        if not self.rejected[refusal.reason]:
            log.warning("%s: refused a message: %s", self.topic.name, refusal)
        self.rejected[refusal.reason] += 1

    def _count_gap(self, header: Header) -> None:
        stream = (header.source, header.boot)
        last = self._last.get(stream)
        if last is None:
            self._last = {stream: header.seq}
            return
        self.dropped += max(0, header.seq - last - 1)
        self._last[stream] = header.seq
