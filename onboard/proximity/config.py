"""Configuration of the proximity node: `[proximity]`."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Fraction, NonNegative, Positive, Section

_Cells = Annotated[int, msgspec.Meta(ge=1, le=64)]


class ProximityConfig(Section, frozen=True, kw_only=True):
    """How depth pictures become the nearest points by direction. Distances are from the vehicle's centre."""

    columns: _Cells = 12
    """Cells across a picture, equal in angle."""
    rows: _Cells = 8
    """Cells down a picture, equal in angle."""
    least_pixels: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 6
    """So many pixels at least must be as near as the point that a cell reports: fewer are taken for noise."""
    least_share: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.02
    """And so large a share of the cell's pixels."""
    edge_m: Positive = 0.06
    """A pixel that differs from the median of its 3 x 3 neighbourhood by more than this, m, is a flying one …"""
    edge_share: Fraction = 0.03
    """… plus this share of its depth."""
    ground_m: NonNegative = 0.4
    """What lies below this height above home, m, is ground: the limiter's minimum height keeps clear of it. The ground
    is taken to be flat."""
    clearance_m: Positive = 1.6
    """A surface so far below or above the vehicle, m, is flown over or under: it does not brake level flight. More than
    `limiter.h_desired_m`."""
    beneath_m: Positive = 3.0
    """Such a surface within this horizontal distance, m, still brakes the descent or climb towards it."""
    empty_is_free: bool = True
    """Whether a direction from which nothing returns, where no ground was to be expected, is seen and free while the
    rest of the picture shows that the sensor works. False: it is unseen. (No sensor tells open sky from velvet.)"""
    alive_share: Fraction = 0.02
    """Share of the pixels that must show something for a picture to count at all."""
    close_m: Positive = 1.0
    """Where something nearer than this was seen within the last second, m, emptiness is not free: it may have come
    nearer than the sensor's range begins."""
    identical_s: Positive = 0.5
    """A picture that stays the same to the last bit for so long, s, is a frozen one; at once when the vehicle moves."""
    silent_s: Positive = 0.3
    """Without a new picture for so long, s, the node reports that it sees nothing."""
    look_back_s: Positive = 0.3
    """An obstacle's own speed is judged over this time, s."""
    closing_noise_m_s: NonNegative = 0.3
    """A closing speed below this is noise, m/s."""
    closing_limit_m_s: Positive = 3.0
    """A closing speed above this is none: something came into the line of sight from the side, m/s."""
