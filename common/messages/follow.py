"""What the vehicle's own follower tells of its trackers."""

from __future__ import annotations

from common.messages.base import Message


class MemberBox(Message, frozen=True, kw_only=True):
    """Where one of the fused trackers sees the target."""

    name: str
    """Of the registry (`dsst`)."""
    box_px: tuple[float, float, float, float] | None = None
    """x, y, width, height of the upright box, px; None where it does not see the target."""


class FollowMembers(Message, frozen=True, kw_only=True):
    """What each tracker of the follower says, in the picture named by the header's `capture_ns`."""

    camera: str
    """Camera whose pictures are followed; `follow/track` is in them too."""
    members: tuple[MemberBox, ...] = ()
    """Each tracker; empty without a target."""
