"""Teulière's colour tracker: a CONDENSATION filter over multi-kernel colour histograms (Teulière 2011, section II).

What it adds to the paper, each for a reason given where it stands: bins placed for the target and a gain for the light
(`common.tracking.colour`), one filtered velocity for all particles (`common.tracking.motion`), a weak prior on the
size, a limit that follows the smallest distance slowly, and a search over the picture when the target stays away.
Stamps are used as they are: the time between two pictures is never assumed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, TrackState, check_box, check_frame
from common.tracking.config import ParticleFilterConfig
from common.tracking.histogram import LAYOUTS, PSI, SCALE, HistogramModel, X, Y, learn_model
from common.tracking.light import Light
from common.tracking.motion import ConstantVelocity, MotionNoise, wrap_angle
from common.tracking.particles import expected_state, likelihood_weights, systematic_resample

_SEARCH_ANGLE_RAD = 0.6
"""Spread of the searching particles' rotation when the search begins, rad; it grows in proportion to the time."""


class ParticleFilterTracker:
    """Tracks a rotated rectangle of fixed aspect ratio by its colours. See `common.tracking.base.Tracker`.

    Args:
        config: its parameters.
        rng: source of all its randomness; the same one and the same pictures give the same results.
    """

    config_type = ParticleFilterConfig

    def __init__(self, config: ParticleFilterConfig, rng: np.random.Generator):
        self._config = config
        self._rng = rng
        self._model: HistogramModel | None = None

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the reference histograms and spread the particles around the box (section II-C)."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        config = self._config
        x, y, width, height = box
        self._size_px = self._usual_size_px = size = math.sqrt(width * height)
        self._unit = np.array([size, size, 1.0, 1.0 / size])  # what a relative noise of one is, in the state's units
        state = np.array([x + width / 2, y + height / 2, wrap_angle(angle_rad), 1.0 / size])
        self._model = learn_model(frame, state, height / width, LAYOUTS[config.kernels], config.backend)
        self._stride = self._model.kernels.stride(state, config.kernel_pixels)
        spread = np.array([config.start_position, config.start_position, config.start_angle, 0.02]) * self._unit
        self._states = state + self._rng.normal(size=(config.particles, 4)) * spread
        self._rates = np.zeros_like(self._states)
        self._motion = self._new_motion(state)
        self._light = Light(config.light_memory_s)
        self._first_distances: list[float] = []
        self._healthy_distance = config.limit_ceiling / config.limit_factor
        self._expected: Expectation | None = None
        self._unseen_s = 0.0
        self._frame, self._t_ns = frame, t_ns
        self._result = self._report(state, config.start_angle, 0.0)

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Evolution, update and resampling of fig. 5, or critical mode (section II-D)."""
        if self._model is None:
            raise ValueError("tracker: update before init; select a target first")
        check_frame(frame, self._frame.shape)
        if self._t_ns is not None and t_ns < self._t_ns:
            raise ValueError(f"t_ns: got {t_ns}, expected at least the previous picture's {self._t_ns}")
        if np.array_equal(frame[::16], self._frame[::16]) and np.array_equal(frame, self._frame):
            # A frozen camera tells nothing; weighing it would stop the velocity. The time is kept for the next picture.
            return replace(self._result, repeated=True)
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._frame, self._t_ns = frame, t_ns
        self._evolve(min(dt_s, self._config.longest_step_s))
        if self._expected is not None and self._unseen_s > 0:
            self._recentre(self._expected)
        self._expected = None
        distances = self._distances(self._model)
        smallest = float(distances.min())
        if len(self._first_distances) < self._config.limit_frames:
            self._first_distances.append(smallest)
            self._healthy_distance = float(np.median(self._first_distances))
        if smallest <= self._limit:
            mean, angle_std = self._seen(distances, dt_s)
        else:
            mean, angle_std = self._unseen(dt_s)
        self._result = self._report(mean, angle_std, smallest)
        return self._result

    def expect(self, expectation: Expectation) -> None:
        """Say where the next picture should show the target, from a motion model outside the picture.

        A camera on a vehicle that brakes and turns moves the whole picture, and a constant velocity in the picture
        (Teulière 2011, section II-C) is then wrong by more than the particles spread. While the target is seen, they
        move by the expected change; while it is hidden, the coasting ones are put where it is expected.
        """
        self._expected = expectation

    def _recentre(self, expected: Expectation) -> None:
        """Move the coasting particles, as a cloud, to where the target is expected."""
        coasting = self._states[self._strewn :]
        mean, _ = expected_state(coasting, np.full(len(coasting), 1 / len(coasting)))
        rows, columns = self._frame.shape[:2]
        x = min(max(expected.center_px[0], -self._size_px), columns + self._size_px)
        y = min(max(expected.center_px[1], -self._size_px), rows + self._size_px)
        coasting[:, : PSI + 1] += np.array([x, y, expected.angle_rad]) - mean[: PSI + 1]
        # What is left of the rates is how far the target may have changed its own motion: the cloud widens with time.
        self._rates[self._strewn :] -= self._rates[self._strewn :].mean(axis=0)

    @property
    def _strewn(self) -> int:
        """Number of particles that search the whole picture."""
        searching = self._unseen_s > self._config.search_after_s
        return int(self._config.search * len(self._states)) if searching else 0

    def _distances(self, model: HistogramModel) -> np.ndarray:
        """Distances (N,) under the light in force, or under another that finds the target when that one does not."""
        distances = model.distances(self._frame, self._states, self._light.gain, self._stride)
        if distances.min() <= self._limit:
            return distances
        for gain in self._light.jumps(self._frame):
            other = model.distances(self._frame, self._states, gain, self._stride)
            if other.min() <= self._limit:
                self._light.gain = gain
                return other
        return distances

    @property
    def _limit(self) -> float:
        """d_lim = 1.3 d_min (section II-D), within its bounds."""
        limit = self._config.limit_factor * self._healthy_distance
        return min(max(limit, self._config.limit_floor), self._config.limit_ceiling)

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

    def _evolve(self, dt_s: float) -> None:
        """Constant velocity and a random walk for every particle; none goes far out of the picture or out of scale."""
        config, seen = self._config, self._unseen_s == 0
        self._motion.predict(dt_s)
        walk = np.array([config.position_noise, config.position_noise, config.angle_noise, config.scale_noise])
        walk *= self._unit * math.sqrt(dt_s) * (1.0 if seen else config.predicted_noise)
        self._states = self._states + self._moved(dt_s) + self._rng.normal(size=self._states.shape) * walk
        memory_s = np.array([np.inf, np.inf, config.angle_rate_memory_s, config.scale_rate_memory_s])
        self._rates = self._rates * np.exp(-dt_s / memory_s)
        low, high = 1 / (self._size_px * config.max_scale), config.max_scale / self._size_px
        self._states[:, SCALE] = self._states[:, SCALE].clip(low, high)
        rows, columns = self._frame.shape[:2]
        for axis, end in ((X, columns), (Y, rows)):
            inside = self._states[:, axis].clip(-self._size_px, end + self._size_px)
            self._rates[inside != self._states[:, axis], axis] = 0.0
            self._states[:, axis] = inside

    def _moved(self, dt_s: float) -> np.ndarray:
        """How far each particle moves in a time: as expected from outside while the target is seen, else at its rate.

        The size follows the expectation in either case.
        """
        moved, expected = self._rates * dt_s, self._expected
        if expected is None:
            return moved
        if self._unseen_s == 0:
            moved[:, :PSI] = expected.moved_px
            moved[:, PSI] += expected.turned_rad
        moved[:, SCALE] = self._states[:, SCALE] * (1.0 / expected.grown - 1.0)
        self._usual_size_px *= expected.grown
        return moved

    def _seen(self, distances: np.ndarray, dt_s: float) -> tuple[np.ndarray, float]:
        """Weigh, estimate, learn motion, limit and light, resample. Returns the mean state and its angle's spread."""
        config = self._config
        prior = np.exp(-0.5 * (np.log(self._states[:, SCALE] * self._usual_size_px) / config.size_prior) ** 2)
        weights = likelihood_weights(distances, config.likelihood_lambda) * prior
        weights /= weights.sum()
        mean, angle_std = expected_state(self._states, weights)
        smallest = float(distances.min())
        # While an occluder slides over the target the rectangle clings to the visible rest: the velocity must not
        # learn from that, so the closer to the limit, the less it does.
        margin = max(self._limit - self._healthy_distance, 1e-6)
        confidence = min(1.0, max(0.05, 1.0 - (smallest - self._healthy_distance) / margin))
        if self._unseen_s > config.search_after_s:
            self._motion = self._new_motion(mean)  # found somewhere else: the old velocity says nothing
        else:
            self._motion.correct(mean, confidence)
        self._unseen_s = 0.0
        self._healthy_distance += (1 - math.exp(-dt_s / config.limit_memory_s)) * (smallest - self._healthy_distance)
        if self._model is not None:
            self._stride = self._model.kernels.stride(mean, config.kernel_pixels)
            self._light.follow(self._model, self._frame, mean, 2 * self._stride, dt_s)
        self._states = self._states[systematic_resample(weights, self._rng.random())]
        self._rates = np.tile(self._motion.rate, (len(self._states), 1))
        return mean, angle_std

    def _unseen(self, dt_s: float) -> tuple[np.ndarray, float]:
        """Critical mode: no weights, no resampling, the motion alone (section II-D). Returns as `_seen`."""
        config, count = self._config, len(self._states)
        if self._unseen_s == 0:
            # The cloud lags behind while it is being covered: it goes on from where the motion filter has it.
            mean, _ = expected_state(self._states, np.full(count, 1 / count))
            self._states[:, :PSI] += (self._motion.value - mean)[:PSI]
            spread = config.predicted_rates * self._motion.rate_std
            self._rates = self._motion.rate + self._rng.normal(size=(count, 4)) * spread
        self._unseen_s += dt_s
        coasting = self._states[self._strewn :]
        mean, angle_std = expected_state(coasting, np.full(len(coasting), 1 / len(coasting)))
        if self._strewn:
            self._strew(self._strewn, mean[PSI])
        return mean, angle_std

    def _strew(self, count: int, angle_rad: float) -> None:
        """Put the first particles anywhere in the picture for the next update."""
        rows, columns = self._frame.shape[:2]
        self._states[:count, X] = self._rng.random(count) * columns
        self._states[:count, Y] = self._rng.random(count) * rows
        # The longer it was out of sight, the less its last heading says.
        doubt_rad = _SEARCH_ANGLE_RAD * self._unseen_s / self._config.search_after_s
        self._states[:count, PSI] = angle_rad + doubt_rad * self._rng.normal(size=count)
        self._rates[:count] = 0.0

    def _report(self, mean: np.ndarray, angle_std_rad: float, smallest: float) -> TrackResult:
        state: TrackState = "tracking"
        if self._unseen_s > 0:
            state = "lost" if self._unseen_s >= self._config.lost_after_s else "predicted"
        model = self._model
        aspect = model.aspect if model is not None else 1.0
        width = 1.0 / (mean[SCALE] * math.sqrt(aspect))
        return TrackResult(
            center_px=(float(mean[X]), float(mean[Y])),
            size_px=(width, width * aspect),
            angle_rad=wrap_angle(float(mean[PSI])),
            score=1.0 - smallest,
            score_limit=1.0 - self._limit,
            state=state,
            angle_std_rad=angle_std_rad,
        )
