"""The queue between the bus and the disk: bounded, so that a slow disk costs messages and never memory."""

from __future__ import annotations

import threading
from collections import deque
from typing import NamedTuple


class RawMessage(NamedTuple):
    """A message as it came."""

    topic: str
    """Topic name."""
    payload: bytes
    """Bytes of the message."""
    attachment: bytes
    """Bytes of the header; empty when there was none."""
    received_utc_ns: int
    """When it was received, UTC, ns."""


class Intake:
    """Messages that wait to be written; filled by reader threads, emptied by one writer.

    Args:
        limit_bytes: most that may wait; what arrives beyond it is dropped and counted.
    """

    def __init__(self, limit_bytes: int):
        self._limit_bytes = limit_bytes
        self._lock = threading.Lock()
        self._waiting: deque[RawMessage] = deque()
        self._bytes = 0
        self.dropped = 0
        """Messages that found the queue full."""

    def put(self, message: RawMessage) -> None:
        """Add a message, or count it as dropped."""
        size = len(message.payload) + len(message.attachment)
        with self._lock:
            if self._bytes + size > self._limit_bytes:
                self.dropped += 1
                return
            self._waiting.append(message)
            self._bytes += size

    def take(self) -> list[RawMessage]:
        """Everything that waits, oldest first."""
        with self._lock:
            batch = list(self._waiting)
            self._waiting.clear()
            self._bytes = 0
            return batch
