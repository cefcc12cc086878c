"""The header that every message carries in its Zenoh attachment, and a message as it arrived with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import msgspec

from common.messages import Message

T = TypeVar("T", bound=Message)


class InputRef(msgspec.Struct, frozen=True, array_like=True):
    """One message that was consumed to compute another: where it came from and when it passed."""

    topic: str
    """Topic name, as in `common.topics`."""
    seq: int
    """Sequence number of the consumed message at its source."""
    source: str
    """Name of the node that published it."""
    capture_ns: int
    """Capture stamp of the data in it (vehicle clock)."""
    sent_ns: int
    """When its source published it (that source's clock)."""
    received_ns: int
    """When the consumer received it (the consumer's clock)."""


class Header(msgspec.Struct, frozen=True, array_like=True):
    """Who sent a message, when, in which order, and what it was computed from."""

    schema: int
    """32-bit hash of the message type's name and fields; a mixed version is refused by name."""
    source: str
    """Name of the publishing node (`pursuit`, `camera`, …)."""
    boot: int
    """Random 63-bit identifier of the publishing process: a restart is visible, two operators can be told apart."""
    seq: int
    """Sequence number of this source and topic, from 0."""
    sent_ns: int
    """Monotonic time of the publishing machine at publication, ns."""
    capture_ns: int
    """When the data was true, in the vehicle's monotonic time, ns. For a request: the newest vehicle stamp used."""
    inputs: tuple[InputRef, ...] = ()
    """The messages that were consumed to compute this one."""


@dataclass(frozen=True)
class Received(Generic[T]):
    """A checked message with its header and the time of its arrival."""

    message: T
    header: Header
    received_ns: int

    def reference(self, topic: str) -> InputRef:
        """Entry for the header of what is computed from this message."""
        h = self.header
        return InputRef(topic, h.seq, h.source, h.capture_ns, h.sent_ns, self.received_ns)
