"""The header that every message carries in its Zenoh attachment."""

from __future__ import annotations

import msgspec


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
