"""Things that stand or walk in the simulated world, in the scenario file: barrels, walls, people."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

from common.config import ConfigError, Positive, Section
from simulation.world.path_config import PathConfig

Colour = Annotated[str, msgspec.Meta(pattern="^#[0-9a-fA-F]{6}$")]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


class BarrelConfig(Section, frozen=True, kw_only=True):
    """A barrel (or, tall and thin, a post)."""

    north_m: float
    """Centre, north, m."""
    east_m: float
    """Centre, east, m."""
    radius_m: Positive = 0.3
    """Radius, m."""
    height_m: Positive = 0.9
    """Height, m."""
    colour: Colour = "#1f5fa8"
    """Colour."""


class WallConfig(Section, frozen=True, kw_only=True):
    """A straight wall between two points on the ground."""

    start: tuple[float, float]
    """One end of its middle line, (north, east), m."""
    end: tuple[float, float]
    """The other end, (north, east), m."""
    height_m: Positive = 3.0
    """Height, m."""
    thickness_m: Positive = 0.2
    """Thickness, m."""
    colour: Colour = "#b9a58c"
    """Colour."""

    def check(self) -> None:
        """Refuse a wall without length."""
        if math.dist(self.start, self.end) < 0.05:
            raise ConfigError(f"start, end: got {self.start} and {self.end}, expected two different points")


class PersonConfig(Section, frozen=True, kw_only=True):
    """A person who stands, or walks along a way."""

    north_m: float = 0.0
    """Place of one who stands, north, m."""
    east_m: float = 0.0
    """Place of one who stands, east, m."""
    heading_deg: float = 0.0
    """Where one who stands looks, degrees."""
    height_m: Annotated[float, msgspec.Meta(ge=0.5, le=2.5)] = 1.75
    """Height, m."""
    shirt: Colour = "#d9480f"
    """Colour of the upper body and arms."""
    trousers: Colour = "#2b3440"
    """Colour of the legs."""
    skin: Colour = "#c99a77"
    """Colour of the head."""
    path: PathConfig = PathConfig()
    """Way of one who walks; in `ping_pong` they turn round at the ends."""
