"""Things that stand or walk in the simulated world, in the scenario file: barrels, walls, debris, people."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Positive, Section
from simulation.world.path_config import PathConfig
from simulation.world.stances import Posture

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


class ThingConfig(Section, frozen=True, kw_only=True):
    """Something that lies about and is no person: debris, luggage, a figure without human shape."""

    kind: Literal["rock", "rubble", "planks", "crate", "bag", "pipe", "tyre", "branch", "dummy"] = "rock"
    """What it is. `dummy`: a roll as long as a person, without head or limbs."""
    north_m: float
    """Centre, north, m."""
    east_m: float
    """Centre, east, m."""
    heading_deg: float = 0.0
    """Where its longest side points, degrees."""
    size_m: Annotated[float, msgspec.Meta(ge=0.05, le=4.0)] = 0.6
    """Longest side, m."""
    colour: Colour = "#8a857c"
    """Colour."""


class PersonConfig(Section, frozen=True, kw_only=True):
    """A person who lies, sits, stands, waves or jumps at a place, or walks along a way."""

    north_m: float = 0.0
    """Place of the hips of one who does not walk, north, m."""
    east_m: float = 0.0
    """The same, east, m."""
    heading_deg: float = 0.0
    """Where one who stands or sits looks, and where the head of one who lies is, degrees."""
    posture: Posture = "standing"
    """What they do while they do not walk. `side`: lying on the right side."""
    limbs: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Number that sets how arms and legs lie: any other, another way."""
    height_m: Annotated[float, msgspec.Meta(ge=0.5, le=2.5)] = 1.75
    """Height, m."""
    build: Annotated[float, msgspec.Meta(ge=0.7, le=1.5)] = 1.0
    """Factor on the girths of trunk and limbs."""
    shirt: Colour = "#d9480f"
    """Colour of the upper body and arms."""
    pattern: Annotated[int, msgspec.Meta(ge=0, le=4)] = 0
    """What the shirt looks like: 0 plain, 1 buttons, 2 stripes, 3 an open jacket over a light shirt, 4 a print."""
    short_sleeves: bool = False
    """Whether the forearms are bare."""
    trousers: Colour = "#2b3440"
    """Colour of the legs."""
    shorts: bool = False
    """Whether the shins are bare."""
    shoes: Colour = "#2a2522"
    """Colour of shoes and belt."""
    skin: Colour = "#c99a77"
    """Colour of face, neck and hands."""
    hair: Colour = "#3a2a1e"
    """Colour of the hair."""
    long_hair: bool = False
    """Whether it covers the neck."""
    path: PathConfig = PathConfig()
    """Way of one who walks; in `ping_pong` they turn round at the ends."""
