"""Settings of the search over an area (`[search]` of the vehicle file)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import ConfigError, NonNegative, Positive, Section


class SearchConfig(Section, frozen=True, kw_only=True):
    """Where, how high and how fast."""

    area: tuple[tuple[float, float], ...] = ()
    """Corners (north, east) of the area, m from home, in order, at least three; inward corners are allowed. Empty:
    there is nothing to search."""
    height_m: Positive = 5.0
    """Height above home, m."""
    speed_m_s: Positive = 1.5
    """Speed along the lines, m/s."""
    overlap: Annotated[float, msgspec.Meta(ge=0, lt=0.9)] = 0.25
    """Share of the picture's width that neighbouring lines see both."""
    fence_margin_m: NonNegative = 1.0
    """The lines keep so far inside the fences of limiter and helm, m; an area that asks for more is refused."""
    gain_1_s: Positive = 0.8
    """Speed asked per metre beside the line, or to go, 1/s."""
    climb_m_s: Positive = 0.6
    """Greatest speed up or down to the height, m/s."""
    yaw_gain_1_s: Positive = 1.2
    """Heading rate per radian between nose and line, 1/s."""
    yaw_rate_rad_s: Positive = 0.7
    """Greatest heading rate, rad/s."""
    facing_rad: Annotated[float, msgspec.Meta(gt=0, le=1.5)] = 0.4
    """The nose has to be nearer to the way than this before the vehicle moves, rad: it flies where its camera looks."""
    reached_m: Positive = 0.5
    """A corner of the way counts as reached within this, m."""
    stuck_s: Positive = 8.0
    """Without getting nearer to the next corner for so long, s, the vehicle goes on to the one after it."""

    def check(self) -> None:
        """Refuse an area that is none."""
        if 0 < len(self.area) < 3:
            raise ConfigError(f"area: got {len(self.area)} corners, expected at least three, or none")
