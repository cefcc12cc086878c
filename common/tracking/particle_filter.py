"""Teulière's colour tracker: a CONDENSATION filter over multi-kernel colour histograms (Teulière 2011, section II).

What it adds to the paper, each for a reason given where it stands: bins placed for the target and a gain for the light
(`common.tracking.colour`), one filtered velocity for all particles (`common.tracking.motion`), a weak prior on the
size, and a limit that follows the smallest distance slowly. When the target stays away for a number of pictures, the
whole picture is searched for it (section II-E, `common.tracking.finder`). Stamps are used as they are: the time between
two pictures is never assumed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, TrackState, check_box, check_frame, check_picture
from common.tracking.cloud import Cloud
from common.tracking.config import ParticleFilterConfig
from common.tracking.finder import Found, Nearby, search
from common.tracking.histogram import LAYOUTS, PSI, SCALE, HistogramModel, X, Y, learn_model
from common.tracking.light import Light
from common.tracking.lines import OwnLines
from common.tracking.loss_limit import LossLimit
from common.tracking.motion import wrap_angle
from common.tracking.particles import expected_state, likelihood_weights
from common.tracking.turn_sweep import best_turn

_REACH_1_S = 3.0
"""How far the target may have come from where it is expected, target sizes for each second out of sight."""
_HEADING_KNOWN_S = (2.0, 6.0)
"""Until when the heading of a target out of sight is believed as before, and from when on not at all."""

_LINES_FROM = 0.5
"""Least confidence in a picture whose lines are read: an occluder's edge is a line, too."""
_CLEAR = 0.8
"""Confidence in a picture whose angle is believed even if the target's lines do not show."""
_DOUBTFUL_RAD = 1.0
"""Standard deviation of an angle that is not believed."""
_PROBATION = 12
"""Pictures in which what a search found must be seen before it is trusted."""


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
        self._result: TrackResult | None = None
        self.reinitialisations = 0
        """How often it started on a place that a search of the whole picture found."""

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the reference histograms and spread the particles around the box (section II-C)."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        x, y, width, height = box
        state = np.array([x + width / 2, y + height / 2, wrap_angle(angle_rad), 1.0 / math.sqrt(width * height)])
        self._learn(frame, state, height / width)
        self._cloud = Cloud(self._config, self._rng, math.sqrt(width * height))
        self._start(state, frame, t_ns)
        self._result = self._report(state, self._config.start_angle, 0.0)

    def learn(self, picture: np.ndarray) -> None:
        """Learn the reference histograms from a picture that the target fills, upright; `find` then starts on it."""
        check_picture(picture)
        height, width = picture.shape[:2]
        state = np.array([(width - 1) / 2, (height - 1) / 2, 0.0, 1.0 / math.sqrt(width * height)])
        self._learn(picture, state, height / width)
        self._result = None

    def find(self, frame: np.ndarray, t_ns: int) -> bool:
        """Search the whole picture, and start on what looks most like the target if that looks enough like it."""
        check_frame(frame, None if self._result is None else self._frame.shape)
        first = self._result is None
        limit = self._config.found_limit if first else self._limit.of_found(relit=True)
        tried = [self._search(frame, gain, None) for gain in (self._light.gain, *self._light.jumps(frame))]
        best = min((f for f in tried if f is not None), key=lambda f: f.distance, default=None)
        if best is None or best.distance > limit:
            return False
        if first:
            self._cloud = Cloud(self._config, self._rng, 1.0 / float(best.state[SCALE]))
        self._start_on(best, frame, t_ns)
        return True

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Evolution, update and resampling of fig. 5, or critical mode (section II-D)."""
        if self._model is None or self._result is None:
            raise ValueError("tracker: update before init; select a target first")
        check_frame(frame, self._frame.shape)
        if self._t_ns is not None and t_ns < self._t_ns:
            raise ValueError(f"t_ns: got {t_ns}, expected at least the previous picture's {self._t_ns}")
        if np.array_equal(frame[::16], self._frame[::16]) and np.array_equal(frame, self._frame):
            # A frozen camera tells nothing; weighing it would stop the velocity. The time is kept for the next picture.
            return replace(self._result, repeated=True)
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._frame, self._t_ns = frame, t_ns
        cloud, expected, seen = self._cloud, self._expected, self._unseen_s == 0
        cloud.evolve(min(dt_s, self._config.longest_step_s), expected, frame.shape, seen=seen)
        if expected is not None and not seen:
            cloud.recentre(expected, frame.shape)
        self._expected = None
        distances = self._distances(self._model)
        smallest = float(distances.min())
        self._limit.begin(smallest)
        if smallest <= self._limit.value:
            mean, angle_std = self._seen(distances, dt_s)
        else:
            mean, angle_std = self._unseen(dt_s)
        self._result = self._report(mean, angle_std, smallest)
        if self._search_is_due:
            self._reinitialise(frame, t_ns)
        return self._result

    def expect(self, expectation: Expectation) -> None:
        """Say where the next picture should show the target, from a motion model outside the picture.

        A camera on a vehicle that brakes and turns moves the whole picture, and a constant velocity in the picture
        (Teulière 2011, section II-C) is then wrong by more than the particles spread. While the target is seen, they
        move by the expected change; while it is hidden, the coasting ones are put where it is expected.
        """
        self._expected = expectation

    def _learn(self, picture: np.ndarray, state: np.ndarray, aspect: float) -> None:
        """Take what the picture shows at a state (4,) as the reference."""
        config = self._config
        self._model = learn_model(picture, state, aspect, LAYOUTS[config.kernels], config.backend)
        self._lines = OwnLines(picture, state, aspect, config.line_reach_rad)
        self._light = Light(config.light_memory_s)
        self._limit = LossLimit(config)

    def _start(self, state: np.ndarray, frame: np.ndarray, t_ns: int | None) -> None:
        """Spread the particles around a state (4,), at rest."""
        self._cloud.start(state)
        if self._model is not None:
            self._thinning = self._model.kernels.thinning(state, self._config.kernel_pixels)
        self._expected: Expectation | None = None
        self._unseen_s, self._unseen_frames, self._seen_frames = 0.0, 0, 0
        self._frame, self._t_ns = frame, t_ns

    def _start_on(self, found: Found, frame: np.ndarray, t_ns: int) -> None:
        """Start anew where a search found the target."""
        self._light.gain = found.gain
        self._start(found.state, frame, t_ns)
        self.reinitialisations += 1
        report = self._report(found.state, self._config.start_angle, found.distance)
        self._result = replace(report, reinitialised=True)

    @property
    def _search_is_due(self) -> bool:
        """Whether this picture without the target is one after which the whole picture is searched."""
        after, every = self._config.reinitialise_after, self._config.reinitialise_every
        return 0 < after <= self._unseen_frames and (self._unseen_frames - after) % every == 0

    def _reinitialise(self, frame: np.ndarray, t_ns: int) -> None:
        """Search the whole picture, every other time under the gain in force: most come back in the light they left in.

        In between under one of the gains that may undo a change of light.
        """
        expected = self._result
        if expected is None:
            return
        turn = (self._unseen_frames - self._config.reinitialise_after) // self._config.reinitialise_every
        others = self._light.jumps(frame)
        relit = bool(turn % 2 and others)
        gain = others[turn // 2 % len(others)] if relit else self._light.gain
        reach_px = self._cloud.usual_size_px * (1.0 + _REACH_1_S * self._unseen_s)
        heading_known = float(np.interp(self._unseen_s, _HEADING_KNOWN_S, (1.0, 0.0)))
        nearby = Nearby(expected.center_px, reach_px, expected.angle_rad, heading_known)
        found = self._search(frame, gain, nearby)
        if found is not None and found.cost <= self._limit.of_found(relit):
            self._start_on(found, frame, t_ns)

    def _search(self, frame: np.ndarray, gain: np.ndarray, nearby: Nearby | None) -> Found | None:
        """The most likely place in the whole picture; of the usual size, once there is one."""
        if self._model is None:
            raise ValueError("tracker: search before init; show it the target first")
        size_px = None if self._result is None else self._cloud.usual_size_px
        return search(frame, self._model, gain, self._rng, size_px, nearby)

    def _distances(self, model: HistogramModel) -> np.ndarray:
        """Distances (N,) under the light in force, or under another that finds the target when that one does not."""
        distances = model.distances(self._frame, self._cloud.states, self._light.gain, self._thinning)
        if distances.min() <= self._limit.value:
            return distances
        for gain in self._light.jumps(self._frame):
            other = model.distances(self._frame, self._cloud.states, gain, self._thinning)
            if other.min() <= self._limit.value:
                self._light.gain = gain
                return other
        return distances

    def _seen(self, distances: np.ndarray, dt_s: float) -> tuple[np.ndarray, float]:
        """Weigh, estimate, learn motion, limit and light, resample. Returns the mean state and its angle's spread."""
        config, cloud = self._config, self._cloud
        prior = np.exp(-0.5 * (np.log(cloud.states[:, SCALE] * cloud.usual_size_px) / config.size_prior) ** 2)
        weights = likelihood_weights(distances, config.likelihood_lambda) * prior
        weights /= weights.sum()
        mean, angle_std = expected_state(cloud.states, weights)
        smallest = float(distances.min())
        confidence = self._limit.confidence(smallest)
        turn, doubtful = self._turn(mean, confidence)
        if doubtful:
            angle_std = max(angle_std, _DOUBTFUL_RAD)
        mean[PSI] = wrap_angle(mean[PSI] + turn)
        cloud.believe(mean, turn, confidence)
        self._unseen_s, self._unseen_frames = 0.0, 0
        self._seen_frames += 1
        self._limit.follow(smallest, dt_s)
        if self._model is not None:
            self._thinning = self._model.kernels.thinning(mean, config.kernel_pixels)
            self._light.follow(self._model, self._frame, mean, self._thinning + 2, dt_s)
        cloud.resample(weights)
        return mean, angle_std

    def _turn(self, mean: np.ndarray, confidence: float) -> tuple[float, bool]:
        """How far to turn the mean state (4,), rad, and whether the picture does not tell the angle.

        It is turned to where it fits best, and then along the target's own lines. Of a target that is being covered
        neither is to be believed.
        """
        turned = mean.copy()
        if self._model is not None and self._config.turn_sweep_rad > 0.0:
            turned[PSI] += best_turn(
                self._model, self._frame, mean, self._light.gain, self._thinning, self._config.turn_sweep_rad
            )
        along = self._lines.turn(self._frame, turned) if confidence >= _LINES_FROM else None
        if along is not None:
            return float(turned[PSI] - mean[PSI]) + along, False
        if self._lines.usable and confidence < _CLEAR:
            return 0.0, True
        return float(turned[PSI] - mean[PSI]), False

    def _unseen(self, dt_s: float) -> tuple[np.ndarray, float]:
        """Critical mode: no weights, no resampling, the motion alone (section II-D). Returns as `_seen`."""
        if self._unseen_s == 0:
            self._cloud.coast()
        self._unseen_s += dt_s
        self._unseen_frames += 1
        if self.reinitialisations and self._seen_frames < _PROBATION:
            # It was found, and soon not seen any more: that was hardly the target, so the search goes on at once.
            self._unseen_frames = max(self._unseen_frames, self._config.reinitialise_after)
        states = self._cloud.states
        return expected_state(states, np.full(len(states), 1 / len(states)))

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
            score_limit=1.0 - self._limit.value,
            state=state,
            angle_std_rad=angle_std_rad,
        )
