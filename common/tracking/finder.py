"""Finds the target anywhere in a picture by its colours (Teulière 2011, section II-E).

Back-projection of the whole target's histogram, CamShift searches from several windows on it, and the multi-kernel
distance (eq. 4) as the judge of what they end on: a thing of the target's colours in another arrangement does not pass.
What it adds to the paper: the back-projection says how much likelier a colour is on the target than in this picture, so
a target with the ground's colours in it is still found; the windows are those whose colours as a whole are most like
the target's; and each place is judged at all headings and several sizes, then refined, since CamShift gives neither
front nor a reliable size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from common.tracking.colour import BINS, bhattacharyya_coefficient, binned
from common.tracking.histogram import PSI, SCALE, HistogramModel

_STRIDE = 2
"""The picture is searched on every second row and column."""
_SEARCHES = 8
"""CamShift searches from so many windows."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)
_HEADINGS = 24
_SIZES = (0.8, 1.0, 1.25)
"""Sizes against the expected one that are tried."""
_ANY_SIZES = (0.07, 0.12, 0.2, 0.34)
"""Sizes that are tried without an expectation, in heights of the picture."""
_REFINED = 4
"""So many of the best places are refined."""
_SPREADS = (0.16, 0.08, 0.04, 0.02)
"""Spread of each refinement's positions, in target sizes; of headings (rad) and sizes (relative) likewise."""
_RESIZED = 1.15
"""Most by which a refinement changes a size: a part of another thing, taken alone, may look like the whole target."""
_DRAWN = 60
"""Hypotheses of each refinement."""
_APART = 0.7
"""Places nearer to each other than this, in target sizes, are one."""
_SAME = 0.3
"""The same for the ends of the searches, before the distance was taken."""
_KERNEL_PIXELS = 700.0
"""Pixels of a kernel that are read, within a factor of 1.4: a little less than tracking reads."""
_AWAY_COST = 0.06
"""Distance (eq. 4) by which a place far from the expected one must look better than one that is there."""
_TURNED_COST = 0.06
"""The same for the opposite heading: what is alike from both ends has not turned round."""


@dataclass(frozen=True)
class Nearby:
    """Where the target is expected."""

    center_px: tuple[float, float]
    """Centre (column, row), px."""
    reach_px: float
    """How far from there it may have come, px."""
    angle_rad: float
    """Rotation, rad."""
    heading_known: float = 1.0
    """How far that rotation still says something, 1 to 0: a target long out of sight may have turned round."""


@dataclass(frozen=True)
class Found:
    """One place that may be the target."""

    state: np.ndarray
    """x, y (px), psi (rad), 1/sqrt(A) (1/px), shape (4,)."""
    distance: float
    """Its distance to the reference, 0 to 1 (eq. 4)."""
    gain: np.ndarray
    """Gain (3,), B, G, R, on the picture's values under which that is so."""
    cost: float
    """The distance, and more for a place far from where the target is expected."""


def back_projection(frame: np.ndarray, model: HistogramModel, gain: float | np.ndarray = 1.0) -> np.ndarray:
    """How likely each pixel's colour belongs to the target rather than to the rest of the picture, (H, W) uint8.

    Args:
        frame: (H, W, 3) uint8.
        model: its reference histograms; their mean is that of the whole object.
        gain: factor on the picture's values before they are binned; one, or (3,) for B, G, R.
    """
    return _likely(binned(np.ascontiguousarray(frame), model.bins.table(gain)), model)


def _likely(bins: np.ndarray, model: HistogramModel) -> np.ndarray:
    """The back-projection, (H, W) uint8, of a picture's bins (H, W)."""
    target = model.reference.mean(axis=0)
    scene = np.bincount(bins.ravel(), minlength=BINS) / bins.size
    share = target / np.maximum(target + scene, 1e-12)
    # A colour that is rare in both says little: it counts by how much of the target it is.
    weight = np.minimum(1.0, target * len(np.flatnonzero(target)))
    return (255.0 * share * weight).astype(np.uint8)[bins]


def windows(
    likely: np.ndarray, bins: np.ndarray, model: HistogramModel, side_px: float, count: int
) -> list[tuple[int, int, int, int]]:
    """The windows (x, y, w, h) of a size that look most like the whole target (eq. 2), best first, none on another.

    Those that hold most of the back-projection are others: a roof in one of the target's colours fills a window as the
    target does not, but lacks its other colours.

    Args:
        likely: back-projection (H, W) uint8; windows without any of it are left out.
        bins: bin of each pixel (H, W).
        model: what the target looks like.
        side_px: side of a window, px.
        count: so many at most.
    """
    rows, columns = likely.shape
    side = max(3, min(round(side_px), rows, columns))
    step = max(1, side // 2)
    sums = cv2.integral(likely)
    xs, ys = (a.ravel() for a in np.meshgrid(range(0, columns - side + 1, step), range(0, rows - side + 1, step)))
    held = sums[ys + side, xs + side] - sums[ys, xs + side] - sums[ys + side, xs] + sums[ys, xs]
    xs, ys = xs[held > 0], ys[held > 0]
    inside = [
        np.bincount(bins[y : y + side, x : x + side].ravel(), minlength=BINS) for x, y in zip(xs, ys, strict=True)
    ]
    target = model.reference.mean(axis=0)
    alike = bhattacharyya_coefficient(target, np.array(inside).reshape(-1, BINS) / side**2)
    chosen: list[tuple[int, int, int, int]] = []
    for i in np.argsort(-alike, kind="stable"):
        x, y = int(xs[i]), int(ys[i])
        if all(max(abs(x - other), abs(y - at)) >= side for other, at, _, _ in chosen):
            chosen.append((x, y, side, side))
        if len(chosen) == count:
            break
    return chosen


def search(
    frame: np.ndarray,
    model: HistogramModel,
    gain: np.ndarray,
    rng: np.random.Generator,
    size_px: float | None = None,
    nearby: Nearby | None = None,
) -> Found | None:
    """The place in a picture that most likely is the target; None where nothing has its colours.

    Args:
        frame: (H, W, 3) uint8.
        model: what the target looks like.
        gain: (3,) factor on the picture's values that undoes the light.
        rng: source of the refinement's randomness.
        size_px: expected square root of the target's area, px; None when any size will do.
        nearby: where it is expected: of two places that look alike the nearer one is taken.
    """
    judge = _Judge(frame, model, gain, nearby)
    coarse = np.ascontiguousarray(frame[::_STRIDE, ::_STRIDE])
    bins = binned(coarse, model.bins.table(gain))
    likely = _likely(bins, model)
    sizes_px = [size_px] if size_px is not None else [share * frame.shape[0] for share in _ANY_SIZES]
    rough: list[Found] = []
    for expected_px in sizes_px:
        side_px = expected_px / _STRIDE
        starts = windows(likely, bins, model, side_px, _SEARCHES)
        rough += [judge.at(center * _STRIDE, expected_px) for center in _centers(likely, starts, side_px)]
    fine = [judge.refined(place, rng) for place in _best(rough, _REFINED)]
    return min(fine, key=lambda place: place.cost, default=None)


class _Judge:
    """Takes the multi-kernel distance of hypotheses in one picture."""

    def __init__(self, frame: np.ndarray, model: HistogramModel, gain: np.ndarray, nearby: Nearby | None):
        self._frame, self._model, self._gain, self._nearby = frame, model, gain, nearby

    def at(self, center_px: np.ndarray, size_px: float) -> Found:
        """The best of all headings and some sizes at a place."""
        headings = np.arange(_HEADINGS) * (2 * math.pi / _HEADINGS) - math.pi
        return self._nearest(
            np.array([[*center_px, heading, 1 / (size_px * size)] for size in _SIZES for heading in headings])
        )

    def refined(self, place: Found, rng: np.random.Generator) -> Found:
        """The best near a place."""
        low, high = place.state[SCALE] / _RESIZED, place.state[SCALE] * _RESIZED
        for spread in _SPREADS:
            size_px = 1 / place.state[SCALE]
            steps = rng.normal(size=(_DRAWN, 4)) * spread * np.array([size_px, size_px, 1.0, place.state[SCALE]])
            steps[0] = 0.0
            states = place.state + steps
            states[:, SCALE] = states[:, SCALE].clip(low, high)
            place = self._nearest(states)
        return place

    def _nearest(self, states: np.ndarray) -> Found:
        thinning = self._model.kernels.thinning(states[0], _KERNEL_PIXELS)
        distances = self._model.distances(self._frame, states, self._gain, thinning)
        best = int(distances.argmin())
        distance = float(distances[best])
        return Found(states[best], distance, self._gain, distance + self._away_cost(states[best]))

    def _away_cost(self, state: np.ndarray) -> float:
        if self._nearby is None:
            return 0.0
        away_px = math.dist(state[:PSI], self._nearby.center_px)
        turned = self._nearby.heading_known * (1.0 - math.cos(state[PSI] - self._nearby.angle_rad)) / 2
        return _AWAY_COST * min(1.0, away_px / self._nearby.reach_px) + _TURNED_COST * turned


def _centers(likely: np.ndarray, starts: list[tuple[int, int, int, int]], side_px: float) -> list[np.ndarray]:
    """Where CamShift ends from some windows, and where these are, px of the back-projection."""
    ends: list[np.ndarray] = []
    for x, y, width, height in starts:
        (center, size, _), _ = cv2.CamShift(likely, (x, y, width, height), _STOP)
        reached = [np.array(center)] if min(size) > 0 else []
        # Beside a large thing of like colour CamShift runs away to that: the window itself is a place, too.
        for end in [*reached, np.array([x + width / 2, y + height / 2])]:
            if all(math.dist(end, other) > _SAME * side_px for other in ends):
                ends.append(end)
    return ends


def _best(places: list[Found], count: int) -> list[Found]:
    """The best places, none near a better one."""
    kept: list[Found] = []
    for place in sorted(places, key=lambda p: p.cost):
        apart_px = _APART / place.state[SCALE]
        if all(math.dist(place.state[:PSI], other.state[:PSI]) > apart_px for other in kept):
            kept.append(place)
        if len(kept) == count:
            break
    return kept
