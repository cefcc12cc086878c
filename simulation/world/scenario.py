"""The scenario file: what stands and moves in the simulated world, and what reality does to its pictures.

Positions are NED metres from home (north, east); headings are degrees from north, clockwise; colours are `#rrggbb`.
Wind is no part of it: it acts on the vehicle, so the autopilot's section has it.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Positive, Section, build, find_file, read_toml
from simulation.world.depth_config import DepthFaultConfig, DepthNoiseConfig
from simulation.world.objects_config import BarrelConfig, Colour, PersonConfig, ThingConfig, WallConfig
from simulation.world.path_config import PathConfig


class CarConfig(Section, frozen=True, kw_only=True):
    """A car: size, colours by part (so that its orientation shows in colours), and its way."""

    length_m: Positive = 0.9
    """Length, m."""
    width_m: Positive = 0.45
    """Width, m."""
    height_m: Positive = 0.3
    """Height, m."""
    bonnet: Colour = "#c8102e"
    """Colour of the bonnet (front)."""
    roof: Colour = "#f2f2ee"
    """Colour of the roof."""
    boot: Colour = "#1746a2"
    """Colour of the boot (rear)."""
    stripe: Colour = "#f5b301"
    """Colour of the stripe along the right-hand side."""
    north_m: float = 0.0
    """Place of a parked car, north, m."""
    east_m: float = 0.0
    """Place of a parked car, east, m."""
    heading_deg: float = 0.0
    """Heading of a parked car, degrees."""
    path: PathConfig = PathConfig()
    """Way of a moving car."""


class OccluderConfig(Section, frozen=True, kw_only=True):
    """Something above the road that hides the car from the camera."""

    kind: Literal["bridge", "tree"] = "bridge"
    """`bridge`: a deck across the road. `tree`: a crown above it, its trunk beside it."""
    north_m: float
    """Centre of deck or crown, north, m."""
    east_m: float
    """Centre of deck or crown, east, m."""
    heading_deg: float = 0.0
    """Direction in which the bridge spans, or in which the trunk stands from the crown's centre, degrees."""
    width_m: Positive = 1.1
    """Width of the deck, or diameter of the crown, m."""
    span_m: Positive = 4.0
    """Length of the deck, m (bridge)."""
    height_m: Annotated[float, msgspec.Meta(gt=0.5, le=3.5)] = 1.3
    """Height of the deck, or of the crown's centre, m; the vehicle flies above it."""


class RoadConfig(Section, frozen=True, kw_only=True):
    """A road besides the car's own."""

    points: tuple[tuple[float, float], ...]
    """Polyline, (north, east), m."""
    width_m: Positive = 1.4
    """Width, m."""


class GroundConfig(Section, frozen=True, kw_only=True):
    """The painted ground and what grows and stands beside the road."""

    kind: Literal["meadow", "gravel", "snow"] = "meadow"
    """Texture beside the road."""
    size_m: Annotated[float, msgspec.Meta(ge=10, le=200)] = 56.0
    """Side of the painted square around home, m; a plainer field continues it."""
    texture_px: Annotated[int, msgspec.Meta(ge=256, le=8192)] = 4096
    """Side of that square's texture, px."""
    road: bool = True
    """Whether a road follows the path of the car."""
    road_width_m: Positive = 1.7
    """Width of that road, m."""
    roads: tuple[RoadConfig, ...] = ()
    """Further roads."""
    trees: Annotated[int, msgspec.Meta(ge=0, le=200)] = 26
    """Number of trees and bushes beside the roads."""
    houses: Annotated[int, msgspec.Meta(ge=0, le=20)] = 4
    """Number of houses beside the roads."""


class LightStepConfig(Section, frozen=True, kw_only=True):
    """A change of light, as when a cloud passes."""

    at_s: NonNegative
    """When it begins, s of world time (modulo `repeat_s` of the light)."""
    gain: Positive = 1.0
    """Factor on the brightness from then on."""
    tint: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    """Factors on red, green and blue from then on."""
    ramp_s: NonNegative = 0.0
    """How long the change takes, s; 0: a step."""


class LightConfig(Section, frozen=True, kw_only=True):
    """Brightness and colour of the daylight over time."""

    gain: Positive = 1.0
    """Brightness at the start."""
    tint: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    """Factors on red, green and blue at the start."""
    drift: Fraction = 0.0
    """Amplitude of a slow sine in brightness."""
    drift_period_s: Positive = 60.0
    """Period of that sine, s."""
    steps: tuple[LightStepConfig, ...] = ()
    """Changes, in order of `at_s`."""
    repeat_s: NonNegative = 0.0
    """The steps begin anew after this time, s; 0: once."""

    def check(self) -> None:
        """Refuse steps that are out of order or beyond the repetition."""
        times = [step.at_s for step in self.steps]
        if times != sorted(times):
            raise ConfigError(f"steps: got at_s {times}, expected ascending times")
        if self.repeat_s and times and times[-1] >= self.repeat_s:
            raise ConfigError(f"steps: got at_s {times[-1]}, expected less than repeat_s = {self.repeat_s}")


class SensorConfig(Section, frozen=True, kw_only=True):
    """The camera's own imperfections."""

    noise_sigma: Annotated[float, msgspec.Meta(ge=0, le=40)] = 0.0
    """Standard deviation of the Gaussian noise, grey levels of 255."""
    vignette: Fraction = 0.0
    """Loss of brightness in the corners."""
    exposure_jump: Fraction = 0.0
    """Largest relative jump of the exposure gain."""
    exposure_interval_s: Positive = 4.0
    """Time between such jumps, s."""


class RadioConfig(Section, frozen=True, kw_only=True):
    """Errors of the video link."""

    block_probability: Fraction = 0.0
    """Chance that a frame has broken blocks."""
    block_count: Annotated[int, msgspec.Meta(ge=1, le=200)] = 4
    """Runs of broken blocks in such a frame."""
    block_px: Annotated[int, msgspec.Meta(ge=4, le=64)] = 16
    """Side of a block, px."""
    lost_probability: Fraction = 0.0
    """Chance that a burst of lost frames begins at a frame."""
    lost_burst_frames: Annotated[int, msgspec.Meta(ge=1, le=100)] = 1
    """Longest such burst, frames."""
    frozen_probability: Fraction = 0.0
    """Chance that the picture freezes at a frame."""
    frozen_s: NonNegative = 0.3
    """Longest freeze, s; the stamps go on, as they do on a frozen link."""


class ScenarioConfig(Section, frozen=True, kw_only=True):
    """One scenario file."""

    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    """Seed of everything random: textures, props, noise, losses."""
    ground: GroundConfig = GroundConfig()
    """The ground."""
    car: CarConfig = CarConfig()
    """The car that is chased."""
    occluders: tuple[OccluderConfig, ...] = ()
    """What hides the car from above."""
    distractors: tuple[CarConfig, ...] = ()
    """Other cars, parked or moving."""
    barrels: tuple[BarrelConfig, ...] = ()
    """Barrels."""
    walls: tuple[WallConfig, ...] = ()
    """Walls."""
    things: tuple[ThingConfig, ...] = ()
    """Debris and other things that are no people."""
    people: tuple[PersonConfig, ...] = ()
    """People."""
    light: LightConfig = LightConfig()
    """Daylight."""
    sensor: SensorConfig = SensorConfig()
    """Camera noise."""
    radio: RadioConfig = RadioConfig()
    """Video-link errors."""
    depth: DepthNoiseConfig = DepthNoiseConfig()
    """Imperfections of the depth sensors."""
    depth_faults: tuple[DepthFaultConfig, ...] = ()
    """Failures of the depth sensors."""


def load_scenario(name: str) -> ScenarioConfig:
    """Scenario of a name (`chase`) or of a path to a TOML file.

    Raises:
        ConfigError: no such file, or a key or value in it that is refused; the text says which and what was expected.
    """
    path = find_file(name, "scenarios")
    return build(ScenarioConfig, read_toml(path), path.name)
