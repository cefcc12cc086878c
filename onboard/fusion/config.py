"""Settings of the fusion (`[fusion]`, `[hab_df]` and `[depth]` of the vehicle file).

Every process reads all settings, so nothing is imported here that takes its time, as filterpy does.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Positive, Section
from common.tracking.registry import check_name


class FusionConfig(Section, frozen=True, kw_only=True):
    """Weights, votes and times of HAB-DF (Echeverri 2016, chapter 4).

    Distances are in units of the measurement (`Fusion.unit`): 1 for a plain signal, the target's size for boxes. The
    noise of a source is its standard deviation in the same units; the penalties are variances against `omega_0`, which
    stands for that noise, so that the thesis's figures for boxes (ω₀ = 10) keep their meaning.
    """

    acceleration: Positive = 6.0
    """Root of the spectral density of the random acceleration, units/s^1.5: what rates change by in one second."""
    start_rate: NonNegative = 2.0
    """Standard deviation of the unknown rates at the start, units/s."""
    outlier_confidence: Annotated[float, msgspec.Meta(gt=0.5, lt=1)] = 0.9999
    """Share of healthy measurements below the switch of eq. 4.4. It gives ζ/η = sqrt(N χ²_N), the largest value of
    eq. 4.3 inside that ellipsoid: 9.7 for a box (the thesis: 10)."""
    outlier_zeta: Positive = 10.0
    """ζ of eq. 4.4; η follows from it and the switch, and is 1 for a box."""
    delta: NonNegative = 100.0
    """Δ of eq. 4.8 against ω₀: the penalty of an outlier (the thesis: 10 for TLD and Struck, 1,000 for CMT)."""
    delta_unsure: NonNegative = 10_000.0
    """Δ while a source's own confidence is below its threshold (the thesis: 10,000)."""
    delta_hesitant: NonNegative = 100.0
    """Δ of a source whose confidence is just at its threshold: against others, its word counts less than theirs."""
    clearly_above: Positive = 0.2
    """How far above its threshold the confidence of a source must be for none of that."""
    omega_0: Positive = 10.0
    """ω₀ of eq. 4.7."""
    omega: NonNegative = 1000.0
    """ω of eq. 4.7 (the thesis: 500 to 20,000)."""
    vote_slope: Positive = 8.0
    """η of eq. 4.7, 1/unit."""
    vote_lambda: Positive = 4.0
    """λ of eq. 4.7: the penalty begins at the distance λ/η."""
    common_jumps: bool = False
    """Whether what two sources see alike, each sure of itself, is believed however far it is from their pasts. For
    vectors of several components alone: two faulty numbers meet by chance far more often than two faulty boxes."""
    agility_memory_s: Positive = 1.0
    """Time constant with which the acceleration that such a jump showed is forgotten, s."""
    standing_fall_s: Positive = 0.2
    """Time constant with which a source that agrees with nobody loses its standing, s: agreeing with it counts less."""
    standing_rise_s: Positive = 4.0
    """Time constant with which agreement with any other gives it back, s: for so long two faulty sources that meet by
    chance cannot outvote the past; then they can."""
    correlation: Fraction = 0.5
    """Correlation of the sources' errors: trackers that watch the same pixels err together. 0 treats n equal sources as
    n independent ones, 1 as one."""
    support: Positive = 0.5
    """Least sum of the sources' reliabilities (fault-free variance over that of eq. 4.8, times how far each vouches) in
    a step that counts as seen."""
    predict_for_s: NonNegative = 1.0
    """How long the answer is predicted without any reliable source before it is called lost, s."""
    stale_after_s: Positive = 0.5
    """A source that has said nothing for so long has no vote, s."""
    forget_after_s: Positive = 0.5
    """A source that comes back after so long without a measurement begins a new filter, s."""
    confidence_memory_s: Positive = 0.5
    """Time constant with which the fusion's own confidence falls without support, s."""
    drift_enter: Positive = 0.35
    """Distance from the fused answer above which a source counts as drifted, units."""
    drift_leave: Positive = 0.2
    """Distance below which it no longer does, units."""
    drift_after_s: NonNegative = 0.4
    """How long it must have drifted before it is to be started anew, s."""
    restart_every_s: Positive = 0.6
    """Shortest time between two new starts of one source, s."""
    restart_support: NonNegative = 0.8
    """Least such sum of the others for a new start: it would copy a wrong answer."""

    def check(self) -> None:
        """Raise ConfigError when the hysteresis is the wrong way round."""
        if self.drift_leave > self.drift_enter:
            raise ConfigError(
                f"drift_leave: got {self.drift_leave}, above drift_enter {self.drift_enter}; expected at most that"
            )


class HabDfConfig(Section, frozen=True, kw_only=True):
    """Which trackers are fused."""

    members: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] = ("dsst", "cmt", "struck", "tld")
    """Names of the registry. Three make a majority; of two that disagree, the past tells which to believe."""
    outline: bool = True
    """Over films: whether the answer is the whole target, and not the members' box, which the follower flies by."""
    vote_slope: Positive = 16.0
    """`fusion.vote_slope` for boxes: healthy ones of different trackers lie 0.2 to 0.3 target sizes apart."""
    vote_lambda: Positive = 8.0
    """`fusion.vote_lambda` for boxes: the same switch of half a target size as the general one."""
    common_jumps: bool = True
    """`fusion.common_jumps` for boxes: a shaken camera moves all of them."""

    def of_boxes(self, general: FusionConfig) -> FusionConfig:
        """The general settings with those that are for boxes."""
        return msgspec.structs.replace(
            general, vote_slope=self.vote_slope, vote_lambda=self.vote_lambda, common_jumps=self.common_jumps
        )

    def check(self) -> None:
        """Raise ConfigError when a member is unknown, named twice, or is the fusion itself."""
        for name in self.members:
            check_name(name, "members")
        if len(set(self.members)) != len(self.members) or "hab-df" in self.members:
            raise ConfigError(f"members: got {list(self.members)}, expected different trackers, hab-df not among them")


class DepthConfig(Section, frozen=True, kw_only=True):
    """Reliability and noise of the two ways to measure a distance."""

    eta: Positive = 20.0
    """η of eq. 3.12: steepness over the share of pixels without depth (section 3.6)."""
    zeta: Positive = 12.0
    """ζ of eq. 3.12: it switches where a share ζ/η, 0.6, of the pixels has no depth (section 3.6)."""
    kappa: Positive = 1.0
    """κ of eqs 3.14 and 3.15, m² (the thesis: 100 in its own units): variance of the way that is not to be trusted."""
    tof_noise_m: Positive = 0.01
    """Standard deviation of the time-of-flight distance within its range, m: the floor of eq. 3.14."""
    scale_noise: Positive = 0.04
    """Standard deviation of the distance from the size, relative: the floor of eq. 3.15, which printed reaches zero."""
    pixel_noise_px: Positive = 2.0
    """Standard deviation of the target's place in the picture, px."""
    acceleration_m_s: Positive = 0.6
    """Root of the spectral density of the distance's random acceleration, m/s^1.5."""
    acceleration_px_s: Positive = 150.0
    """The same of the place in the picture, px/s^1.5."""
    reliable: Fraction = 0.1
    """R_ζ up to which a time-of-flight distance teaches the scale K_z."""
    least_gain: Fraction = 0.002
    """Share with which each further one refines K_z after the first five hundred: a box errs slowly."""
