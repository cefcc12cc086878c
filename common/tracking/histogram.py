"""Colour histograms under several kernels, and their distance to a reference for many states at once.

Source: Teulière 2011, section II-B, eqs 1 to 4, over every pixel of the kernels as they are written. A large target is
read on a lattice that leaves out pixels, so that a step's time does not grow with it. The NumPy form here is
the reference; `common.tracking.compiled` gives the same figures at speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np

from common.tracking import compiled
from common.tracking.colour import BIN_WIDTH, BINS, BINS_PER_CHANNEL, ColourBins, binned, place_bins

X, Y, PSI, SCALE = range(4)
"""Entries of a state: x, y (px), psi (rad), 1/sqrt(A) (1/px) (Teulière 2011, section II-B)."""

Backend = Literal["compiled", "numpy"]
"""Which form does the sums."""


@dataclass(frozen=True)
class Kernels:
    """Identical Epanechnikov kernels in the target's rectangle, in units of its sides, from its centre."""

    centers: tuple[tuple[float, float], ...]
    """Centres (n_h of them)."""
    half_axes: tuple[float, float]
    """Half-axes of each one's ellipse."""

    @cached_property
    def reach(self) -> tuple[float, float]:
        """Farthest that a kernel reaches from the rectangle's centre along its x and y, in units of its sides."""
        across, along = (max(abs(center[i]) for center in self.centers) + self.half_axes[i] for i in (0, 1))
        return across, along

    def thinning(self, state: np.ndarray, pixels: float) -> int:
        """How often every other pixel is left out: about `pixels` of a kernel are read at the size of a state (4,)."""
        covered = math.pi * self.half_axes[0] * self.half_axes[1] / float(state[SCALE]) ** 2
        return max(0, round(math.log2(covered / pixels)))


LAYOUTS: dict[str, Kernels] = {
    "whole": Kernels(((0.0, 0.0),), (0.5, 0.5)),
    "halves": Kernels(((-0.25, 0.0), (0.25, 0.0)), (0.25, 0.5)),
    "quarters": Kernels(((-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)), (0.3, 0.3)),
    "five": Kernels(((0.0, 0.0), (-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)), (0.3, 0.3)),
    "nine": Kernels(tuple((x / 3, y / 3) for y in (-1, 0, 1) for x in (-1, 0, 1)), (1 / 6, 1 / 6)),
}
"""Those of `five` overlap and reach 5 % over the edge: the rim of ground tells a shrunken box from a fitting one."""


def state_histograms(
    frame_bins: np.ndarray, state: np.ndarray, aspect: float, kernels: Kernels, checkered: bool = False
) -> np.ndarray:
    """Histograms of one state (4,) under each kernel, (n_h, 512) (eq. 1).

    A row sums to one inside the picture, and to less where the kernel reaches out of it.

    Args:
        frame_bins: (H, W) bin of each pixel.
        state: x, y, psi, 1/sqrt(A).
        aspect: r = h / w.
        kernels: the kernels.
        checkered: whether those pixels alone count whose column and row are both even or both odd.
    """
    width = 1.0 / (state[SCALE] * math.sqrt(aspect))
    height = width * aspect
    cosine, sine = math.cos(state[PSI]), math.sin(state[PSI])
    a, b = kernels.half_axes[0] * width, kernels.half_axes[1] * height
    reach_x, reach_y = math.hypot(a * cosine, b * sine), math.hypot(a * sine, b * cosine)
    histograms = np.zeros((len(kernels.centers), BINS))
    for histogram, (u, v) in zip(histograms, kernels.centers, strict=True):
        cx = state[X] + u * width * cosine - v * height * sine
        cy = state[Y] + u * width * sine + v * height * cosine
        columns = np.arange(math.ceil(cx - reach_x), math.floor(cx + reach_x) + 1)
        rows = np.arange(math.ceil(cy - reach_y), math.floor(cy + reach_y) + 1)[:, None]
        dx, dy = columns - cx, rows - cy
        weights = 1.0 - ((cosine * dx + sine * dy) / a) ** 2 - ((cosine * dy - sine * dx) / b) ** 2
        if checkered:
            weights[(columns + rows) % 2 == 1] = 0.0
        if not (weights > 0).any():  # smaller than a pixel: the nearest one is all there is
            column, row = math.floor(cx + 0.5), math.floor(cy + 0.5)
            if checkered:
                column = column // 2 * 2 + row % 2
            columns, rows, weights = np.array([column]), np.array([[row]]), np.ones((1, 1))
        inside_x = (columns >= 0) & (columns < frame_bins.shape[1])
        inside_y = ((rows >= 0) & (rows < frame_bins.shape[0]))[:, 0]
        weights = np.maximum(0.0, weights)
        counted = frame_bins[rows[inside_y], columns[inside_x]].ravel()
        histogram += np.bincount(counted, weights[inside_y][:, inside_x].ravel(), BINS) / weights.sum()
    return histograms


class HistogramModel:
    """Reference histograms of a target under several kernels, and the distance of many states to them at once.

    Args:
        reference: (n_h, 512), the rows normalised.
        bins: the colour bins that it was taken with.
        aspect: r = h / w of the target's rectangle.
        kernels: its kernels, n_h of them.
        backend: which form does the sums.
    """

    def __init__(
        self, reference: np.ndarray, bins: ColourBins, aspect: float, kernels: Kernels, backend: Backend = "compiled"
    ):
        self.reference = reference
        self.bins = bins
        self.aspect = aspect
        self.kernels = kernels
        self._sums: _Sums = _CompiledSums(self) if backend == "compiled" else _NumpySums(self)

    def distances(
        self, frame: np.ndarray, states: np.ndarray, gain: float | np.ndarray = 1.0, thinning: int = 0
    ) -> np.ndarray:
        """Mean Bhattacharyya distance of each state to the reference (eq. 4).

        Args:
            frame: (H, W, 3) uint8.
            states: (N, 4) rows of x, y (px), psi (rad), 1/sqrt(A) (1/px).
            gain: factor on the picture's values before they are binned; one, or (3,) for B, G, R.
            thinning: how often every other pixel is left out: 1 for a checkerboard, 2 for every second row and column.

        Returns:
            (N,), 0 to 1.
        """
        gains = np.empty((1, 3))
        gains[:] = gain
        return self._sums.distances(*_thinned(frame, states, thinning), gains)[0]

    def relit(self, frame: np.ndarray, state: np.ndarray, gains: np.ndarray, thinning: int = 0) -> np.ndarray:
        """Mean Bhattacharyya distance (G,) of one state (4,) under each of the gains (G, 3)."""
        return self._sums.distances(*_thinned(frame, state[None], thinning), gains)[:, 0]


def _thinned(frame: np.ndarray, states: np.ndarray, thinning: int) -> tuple[np.ndarray, np.ndarray, bool]:
    """Some rows and columns of a picture, the states (N, 4) in its pixels, and whether every other one is left out."""
    stride = 1 << thinning // 2
    if stride > 1:
        frame, states = frame[::stride, ::stride], states * [1 / stride, 1 / stride, 1.0, stride]
    return frame, states, thinning % 2 == 1


class _Sums(Protocol):
    def distances(self, frame: np.ndarray, states: np.ndarray, checkered: bool, gains: np.ndarray) -> np.ndarray:
        """Distances (T, N) of states (N, 4) under gains (T, 3) on the picture's values, over all pixels or half."""
        ...


class _NumpySums:
    """The equations as they are written, state by state."""

    def __init__(self, model: HistogramModel):
        self._model = model
        self._root_reference = np.sqrt(model.reference)

    def distances(self, frame: np.ndarray, states: np.ndarray, checkered: bool, gains: np.ndarray) -> np.ndarray:
        model = self._model
        rows, columns = frame.shape[:2]
        left, top, right, bottom = compiled.touched(states, model.aspect, *model.kernels.reach, columns, rows)
        frame_bins = np.zeros(frame.shape[:2], np.uint16)
        result = np.empty((len(gains), len(states)))
        for distances, table in zip(result, model.bins.table(gains), strict=True):
            if right > left and bottom > top:
                frame_bins[top:bottom, left:right] = binned(frame[top:bottom, left:right], table)
            for i, state in enumerate(states):
                found = state_histograms(frame_bins, state, model.aspect, model.kernels, checkered)
                rho = (self._root_reference * np.sqrt(found)).sum(axis=1)
                distances[i] = np.sqrt(np.maximum(0.0, 1.0 - rho)).mean()
        return result


class _CompiledSums:
    """The same in compiled code, over the bins alone that the reference holds: some tens instead of 512."""

    def __init__(self, model: HistogramModel):
        self._model = model
        self._centers = np.array(model.kernels.centers)
        held = np.flatnonzero(model.reference.max(axis=0) > 0)
        # The last slot takes every colour that the reference does not hold.
        self._slot_of_bin = np.full(BINS, len(held), np.uint16)
        self._slot_of_bin[held] = np.arange(len(held), dtype=np.uint16)
        self._root_reference = np.zeros((len(self._centers), len(held) + 1))
        self._root_reference[:, :-1] = np.sqrt(model.reference[:, held])
        self._offsets = np.array(model.bins.offsets, np.int64)
        self._slots: dict[tuple[int, ...], np.ndarray] = {}

    def distances(self, frame: np.ndarray, states: np.ndarray, checkered: bool, gains: np.ndarray) -> np.ndarray:
        model = self._model
        if frame.shape not in self._slots:
            self._slots[frame.shape] = np.zeros(frame.shape[:2], np.uint16)
        result = np.empty((len(gains), len(states)))
        compiled.fill_distances(
            frame, gains, self._offsets, BIN_WIDTH, BINS_PER_CHANNEL, self._slot_of_bin, int(checkered),
            self._slots[frame.shape], np.ascontiguousarray(states), model.aspect, *model.kernels.reach, self._centers,
            *model.kernels.half_axes, self._root_reference, result,
        )  # fmt: skip
        return result


def learn_model(
    frame: np.ndarray, state: np.ndarray, aspect: float, kernels: Kernels, backend: Backend = "compiled"
) -> HistogramModel:
    """Model of what the picture shows at a state (4,), with colour bins placed for it.

    Args:
        frame: (H, W, 3) uint8.
        state: the target's state.
        aspect: r = h / w.
        kernels: its kernels.
        backend: which form does the sums of the model's distances.

    Raises:
        ValueError: less than half of a kernel lies in the picture.
    """
    grid = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 96), np.linspace(-0.9, 0.9, 96)), axis=-1).reshape(-1, 2)
    u, v = (grid[:, None] - np.array(kernels.centers)).transpose(2, 0, 1)
    a, b = kernels.half_axes
    weights = np.maximum(0.0, 1.0 - (u / a) ** 2 - (v / b) ** 2).sum(axis=1)
    inside_kernels = weights > 0
    target, seen = _pixels(frame, state, aspect, grid[inside_kernels])
    if not seen.any():
        raise ValueError("box: got a target outside the picture; draw the box around what can be seen")
    surroundings, _ = _pixels(frame, state, aspect, grid[np.abs(grid).max(axis=1) > 0.6])
    bins = place_bins(target, weights[inside_kernels][seen], surroundings)
    reference = state_histograms(bins.of(frame), state, aspect, kernels)
    mass = reference.sum(axis=1, keepdims=True)
    if mass.min() < 0.5:
        raise ValueError("box: got a target that is partly outside the picture; draw the box around what can be seen")
    return HistogramModel(reference / mass, bins, aspect, kernels, backend)


def _pixels(frame: np.ndarray, state: np.ndarray, aspect: float, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 3) nearest to points (M, 2) in units of the rectangle's sides, and which points are in the picture."""
    width = 1.0 / (state[SCALE] * math.sqrt(aspect))
    cosine, sine = math.cos(state[PSI]), math.sin(state[PSI])
    dx, dy = points[:, 0] * width, points[:, 1] * width * aspect
    columns = np.rint(state[X] + cosine * dx - sine * dy).astype(int)
    rows = np.rint(state[Y] + sine * dx + cosine * dy).astype(int)
    inside = (columns >= 0) & (columns < frame.shape[1]) & (rows >= 0) & (rows < frame.shape[0])
    return frame[rows[inside], columns[inside]], inside
