"""The colour tracker's particles, and how they move while none is weighed (Teulière 2011, sections II-C, II-D)."""

from __future__ import annotations

import math

import numpy as np

from common.tracking.base import Expectation
from common.tracking.config import ParticleFilterConfig
from common.tracking.histogram import PSI, SCALE, X, Y
from common.tracking.motion import ConstantVelocity, MotionNoise
from common.tracking.particles import expected_state, systematic_resample


class Cloud:
    """States and rates of all particles, and the one filtered velocity that they share while the target is seen.

    Args:
        config: the tracker's parameters.
        rng: source of the noise.
        size_px: the target's size, square root of its area, px.
    """

    def __init__(self, config: ParticleFilterConfig, rng: np.random.Generator, size_px: float):
        self._config = config
        self._rng = rng
        self._size_px = size_px
        self.usual_size_px = size_px
        """The target's usual size, px: the first one, and what is known from outside to have changed it."""
        self._unit = np.array([size_px, size_px, 1.0, 1.0 / size_px])  # a relative noise of one, in the state's units

    def start(self, state: np.ndarray) -> None:
        """Spread the particles around a state (4,), at rest."""
        config = self._config
        spread = np.array([config.start_position, config.start_position, config.start_angle, 0.02]) * self._unit
        self.states = state + self._rng.normal(size=(config.particles, 4)) * spread
        """State of each particle, (N, 4)."""
        self._rates = np.zeros_like(self.states)
        self._motion = self._new_motion(state)

    def _new_motion(self, state: np.ndarray) -> ConstantVelocity:
        config = self._config
        velocity, walk = config.start_velocity, config.velocity_noise
        # Estimates of single pictures scatter by about this much on the scenes that the filter was tuned on.
        measured = np.array([0.05, 0.05, 0.06, 0.05])
        noise = MotionNoise(
            start=np.array([velocity, velocity, 0.7, 0.1]) * self._unit,
            walk=np.array([walk, walk, config.angle_rate_noise, config.scale_rate_noise]) * self._unit,
            measured=measured * self._unit,
            memory_s=np.array([np.inf, np.inf, config.angle_rate_memory_s, config.scale_rate_memory_s]),
        )
        return ConstantVelocity(state, noise)

    def evolve(self, dt_s: float, expected: Expectation | None, shape: tuple[int, ...], *, seen: bool) -> None:
        """Constant velocity and a random walk for every particle; none goes far out of the picture or out of scale.

        Args:
            dt_s: time, s.
            expected: what is known from outside of the target's motion in it.
            shape: of the picture.
            seen: whether the target was seen at its beginning.
        """
        config = self._config
        self._motion.predict(dt_s)
        walk = np.array([config.position_noise, config.position_noise, config.angle_noise, config.scale_noise])
        walk *= self._unit * math.sqrt(dt_s) * (1.0 if seen else config.predicted_noise)
        moved = self._moved(dt_s, expected, seen)
        self.states = self.states + moved + self._rng.normal(size=self.states.shape) * walk
        self._rates = self._rates * self._motion.kept(dt_s)
        low, high = 1 / (self._size_px * config.max_scale), config.max_scale / self._size_px
        self.states[:, SCALE] = self.states[:, SCALE].clip(low, high)
        rows, columns = shape[:2]
        for axis, end in ((X, columns), (Y, rows)):
            inside = self.states[:, axis].clip(-self._size_px, end + self._size_px)
            self._rates[inside != self.states[:, axis], axis] = 0.0
            self.states[:, axis] = inside

    def _moved(self, dt_s: float, expected: Expectation | None, seen: bool) -> np.ndarray:
        """How far each particle moves in a time: as expected from outside while the target is seen, else at its rate.

        The size follows the expectation in either case.
        """
        moved = self._rates * dt_s
        if expected is None:
            return moved
        if seen:
            moved[:, :PSI] = expected.moved_px
            moved[:, PSI] += expected.turned_rad
        moved[:, SCALE] = self.states[:, SCALE] * (1.0 / expected.grown - 1.0)
        self.usual_size_px *= expected.grown
        return moved

    def recentre(self, expected: Expectation, shape: tuple[int, ...]) -> None:
        """Move the coasting particles, as a cloud, to where the target is expected in a picture of this shape."""
        mean = self.mean()
        rows, columns = shape[:2]
        x = min(max(expected.center_px[0], -self._size_px), columns + self._size_px)
        y = min(max(expected.center_px[1], -self._size_px), rows + self._size_px)
        self.states[:, : PSI + 1] += np.array([x, y, expected.angle_rad]) - mean[: PSI + 1]
        # What is left of the rates is how far the target may have changed its own motion: the cloud widens with time.
        self._rates -= self._rates.mean(axis=0)

    def mean(self) -> np.ndarray:
        """The mean state, (4,), of particles that count alike."""
        count = len(self.states)
        return expected_state(self.states, np.full(count, 1 / count))[0]

    def believe(self, mean: np.ndarray, turn_rad: float, confidence: float) -> None:
        """Take in what a picture says: every particle turns, and the motion learns the mean state (4,)."""
        self.states[:, PSI] += turn_rad
        self._motion.correct(mean, confidence)

    def resample(self, weights: np.ndarray) -> None:
        """Draw the particles anew by their weights, (N,), all at the filtered rate."""
        self.states = self.states[systematic_resample(weights, self._rng.random())]
        self._rates = np.tile(self._motion.rate, (len(self.states), 1))

    def coast(self) -> None:
        """Go on from where the motion filter has the target, each at a rate of its own (critical mode, section II-D).

        The cloud lags behind while the target is being covered.
        """
        self.states[:, :PSI] += (self._motion.value - self.mean())[:PSI]
        spread = self._config.predicted_rates * self._motion.rate_std
        self._rates = self._motion.rate + self._rng.normal(size=self.states.shape) * spread
