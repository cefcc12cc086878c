"""What reality does to depth pictures, in the scenario file: noise, and failures of the sensor."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Positive, Section


class DepthNoiseConfig(Section, frozen=True, kw_only=True):
    """Imperfections of the depth sensors. The defaults are a perfect one."""

    noise_m: NonNegative = 0.0
    """Standard deviation of the Gaussian noise close by, m."""
    noise_per_m: NonNegative = 0.0
    """What it grows by with the square of the depth z: sigma = noise_m + noise_per_m z², 1/m."""
    step_m: NonNegative = 0.0
    """Depth is rounded to multiples of this, m; the bus carries millimetres in any case."""
    edge_m: Positive = 0.2
    """A pixel lies on an edge when the depths around it differ by more than this, m."""
    flying: Fraction = 0.0
    """Share of the pixels on edges that show a depth somewhere between the two sides (flying pixels)."""
    edge_holes: Fraction = 0.0
    """Share of the pixels on edges that show nothing."""
    holes: Fraction = 0.0
    """Share of the pixels at the end of the range that show nothing; nearer it falls with the square of the depth."""


class DepthFaultConfig(Section, frozen=True, kw_only=True):
    """A failure of one camera's depth, beginning at a time or on approach."""

    camera: Literal["down", "front"] = "front"
    """Whose depth."""
    kind: Literal["frozen", "zero", "silent"] = "frozen"
    """`frozen`: the same picture again and again, with new stamps. `zero`: no pixel shows anything. `silent`: no
    picture comes."""
    at_s: NonNegative | None = None
    """When it begins, s after the vehicle was airborne."""
    within_m: Annotated[float, msgspec.Meta(gt=0, le=50)] | None = None
    """Or: it begins once the vehicle in the air has come so near to a barrel, wall or person, m."""
    for_s: Positive | None = None
    """How long it lasts, s; None: to the end."""

    def check(self) -> None:
        """Refuse a fault without a beginning, and one with two."""
        if (self.at_s is None) == (self.within_m is None):
            raise ConfigError("at_s, within_m: expected exactly one of them, to say when the fault begins")
