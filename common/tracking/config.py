"""Configuration of the trackers."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Positive, Section


class ParticleFilterConfig(Section, frozen=True, kw_only=True):
    """The colour particle filter (Teulière 2011, section II).

    Lengths are in target sizes (square root of the target's area), so that one set of figures serves a car of 96 px
    and a pedestrian of 30 px. Noises are standard deviations that grow with the square root of time. They were tuned on
    synthetic scenes like those of the tests (cars at 120 to 220 px/s with turns, occlusions of 1 s, light falling by
    half in 6 s) and on a real video of a car and of pedestrians.
    """

    particles: Annotated[int, msgspec.Meta(ge=10, le=100_000)] = 200
    """Number of particles (Teulière 2011, section IV)."""
    kernels: Literal["whole", "halves", "quarters", "five", "nine"] = "five"
    """Layout of the kernels in the rectangle."""
    backend: Literal["compiled", "numpy"] = "compiled"
    """Which form takes the histograms: the compiled one, or the NumPy reference, which is twenty times slower."""
    kernel_pixels: Positive = 800.0
    """Pixels of one kernel that are read, within a factor of 1.4. Of more, every other one is left out as a
    checkerboard, then every second row and column, and so on; for a target of 96 x 48 px it has 1,300 and 650 are
    read."""
    likelihood_lambda: Positive = 20.0
    """Sharpness of the likelihood exp(-lambda d^2) (Teulière 2011, eq. 5)."""
    size_prior: Positive = 0.2
    """Standard deviation of the logarithm of the size against the first one, as part of the weight. A smaller rectangle
    inside a plain target fits as well as the right one; without this the estimate shrinks by a fifth."""
    start_position: NonNegative = 0.08
    """Spread of the first particles in position, target sizes."""
    start_angle: NonNegative = 0.05
    """Spread of the first particles in rotation, rad."""
    start_velocity: NonNegative = 3.0
    """Uncertainty of the velocity at the start, target sizes/s."""
    position_noise: NonNegative = 0.45
    """Random walk of the position, target sizes/sqrt(s)."""
    velocity_noise: NonNegative = 1.2
    """Random walk of the velocity, target sizes/s/sqrt(s)."""
    angle_noise: NonNegative = 0.5
    """Random walk of the rotation, rad/sqrt(s)."""
    angle_rate_noise: NonNegative = 2.0
    """Random walk of the turn rate, rad/s/sqrt(s)."""
    angle_rate_memory_s: Positive = 2.0
    """Time constant with which the turn rate returns to zero, s: a target does not spin for ever."""
    turn_sweep_rad: NonNegative = 0.0
    """How far the mean is turned either way to find the angle that fits best, rad; 0 leaves the mean alone. For
    a camera that looks down on what turns; what stands upright in the picture is followed better without."""
    line_reach_rad: Annotated[float, msgspec.Meta(ge=0, le=0.7)] = 0.0
    """How far the mean is then turned to lie along the target's own straight lines, rad; 0 leaves them unread. They
    count if they run along the rectangle, within this reach, when the target is chosen."""
    scale_noise: NonNegative = 0.06
    """Random walk of 1/sqrt(A), relative, 1/sqrt(s)."""
    scale_rate_noise: NonNegative = 0.1
    """Random walk of its rate, relative, 1/s/sqrt(s)."""
    scale_rate_memory_s: Positive = 0.5
    """Time constant with which that rate returns to zero, s."""
    max_scale: Annotated[float, msgspec.Meta(gt=1)] = 3.0
    """Bound of the size against the first one, either way."""
    longest_step_s: Positive = 1.0
    """Longest time between two pictures over which the motion is extrapolated, s."""
    limit_factor: Annotated[float, msgspec.Meta(gt=1)] = 1.3
    """d_lim over the smallest distance of a healthy picture (Teulière 2011, section II-D)."""
    limit_frames: Annotated[int, msgspec.Meta(ge=1)] = 10
    """Pictures from whose median that smallest distance is taken at the start."""
    limit_floor: Fraction = 0.36
    """Lower bound of d_lim: noise, sampling and a turn reach 0.3 on a target in full view, and 0.4 on a car that shows
    its sides to a low camera (then 0.48)."""
    limit_ceiling: Fraction = 0.62
    """Upper bound of d_lim: above it, ground passes for the target."""
    limit_memory_s: Positive = 2.0
    """Time constant with which d_lim follows the smallest distance while the target is seen, s."""
    light_memory_s: NonNegative = 0.1
    """Time constant with which the gain that undoes changes of light follows, s; 0 switches it off."""
    predicted_noise: NonNegative = 0.4
    """Factor on the random walks while the target is not seen: the cloud has to reach it, not to fill the picture."""
    predicted_rates: NonNegative = 0.6
    """Factor on the spread of the particles' own rates while the target is not seen."""
    reinitialise_after: Annotated[int, msgspec.Meta(ge=0)] = 8
    """Pictures without the target after which the whole picture is searched for it; 0 leaves that to the operator."""
    reinitialise_every: Annotated[int, msgspec.Meta(ge=1)] = 2
    """The search is repeated every so many pictures."""
    found_limit: Fraction = 0.45
    """Largest distance at which a target known from a picture of it alone is taken as found."""
    lost_after_s: Positive = 3.0
    """Time without sight of the target after which it is called lost, s."""

    def check(self) -> None:
        """Raise ConfigError when the bounds of d_lim are the wrong way round."""
        if self.limit_ceiling < self.limit_floor:
            raise ConfigError(
                f"limit_ceiling: got {self.limit_ceiling}, below limit_floor {self.limit_floor}; expected at least that"
            )
