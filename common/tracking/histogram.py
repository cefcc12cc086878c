"""Colour histograms under several kernels, and their distance to a reference for many states at once.

Source: Teulière 2011, section II-B. Equation 1 sums over every pixel of the rectangle; for hundreds of particles that
is millions of pixels a picture. So each kernel is sampled on a fixed grid instead: `grid` x `grid` points over the
kernel's bounding rectangle, those inside the ellipse kept, each with the kernel's value there as its weight. The grid
moves, turns and scales with the state, and the nearest pixel is read. The histogram keeps its meaning (a weighted
share of colours), and its cost no longer depends on the size of the target. A test holds it against the sum over
every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.tracking.colour import BINS, ColourBins, place_bins

X, Y, PSI, SCALE = range(4)
"""Entries of a state: x, y (px), psi (rad), 1/sqrt(A) (1/px) (Teulière 2011, section II-B)."""
OUTSIDE = BINS
"""Bin of points outside the picture: no colour's, so that a rectangle that leaves the picture loses mass."""

LAYOUTS: dict[str, tuple[tuple[tuple[float, float], ...], tuple[float, float]]] = {
    "whole": (((0.0, 0.0),), (0.5, 0.5)),
    "halves": (((-0.25, 0.0), (0.25, 0.0)), (0.25, 0.5)),
    "quarters": (((-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)), (0.3, 0.3)),
    "five": (((0.0, 0.0), (-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)), (0.3, 0.3)),
    "nine": (tuple((x / 3, y / 3) for y in (-1, 0, 1) for x in (-1, 0, 1)), (1 / 6, 1 / 6)),
}
"""Kernel centres and half-axes in units of the rectangle's sides, from its centre; kernels of a layout are identical.
Those of `five` overlap and reach 5 % over the edge: the rim of ground tells a shrunken rectangle from a fitting one."""

_GATHER_FROM = 2.0
"""Pixels per point from which it is quicker to look up each point by itself."""


@dataclass(frozen=True)
class KernelGrid:
    """The sampling points of all kernels in the rectangle's own units, and their weights."""

    points: np.ndarray
    """(n_h * m, 2) offsets from the centre in units of (width, height), kernel after kernel."""
    weights: np.ndarray
    """(n_h * m,) Epanechnikov weights; those of each kernel sum to one."""
    kernels: int
    """n_h."""


def kernel_grid(layout: str, grid: int) -> KernelGrid:
    """Sampling points of a layout of `LAYOUTS` with `grid` x `grid` points over each kernel's bounding rectangle."""
    centers, half_axes = LAYOUTS[layout]
    axis = (2 * np.arange(grid) + 1) / grid - 1
    u, v = (a.ravel() for a in np.meshgrid(axis, axis))
    weight = 1 - u**2 - v**2  # Epanechnikov: parabola over the unit disc, nothing outside it
    keep = weight > 0
    unit = np.stack([u[keep] * half_axes[0], v[keep] * half_axes[1]], axis=1)
    points = np.concatenate([unit + np.array(center) for center in centers])
    return KernelGrid(points, np.tile(weight[keep] / weight[keep].sum(), len(centers)), len(centers))


def sample_pixels(states: np.ndarray, aspect: float, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest pixel of each sampling point for each state.

    Args:
        states: (N, 4) rows of x, y (px), psi (rad), 1/sqrt(A) (1/px).
        aspect: r = h / w.
        points: (M, 2) offsets in units of (w, h).

    Returns:
        Columns and rows, each (N, M) int32; outside the picture where the rectangle is.
    """
    width = 1.0 / (states[:, SCALE] * np.sqrt(aspect))
    height = width * aspect
    cosine, sine = np.cos(states[:, PSI]), np.sin(states[:, PSI])
    # floor(value + 0.5) is the nearest pixel; float32 halves the cost of the product and is exact to 1e-4 px here.
    basis = np.concatenate([np.ones((1, len(points))), points.T]).astype(np.float32)
    x_terms = np.stack([states[:, X] + 0.5, cosine * width, -sine * height], axis=1).astype(np.float32)
    y_terms = np.stack([states[:, Y] + 0.5, sine * width, cosine * height], axis=1).astype(np.float32)
    return np.floor(x_terms @ basis).astype(np.int32), np.floor(y_terms @ basis).astype(np.int32)


def state_histograms(
    frame: np.ndarray, state: np.ndarray, aspect: float, grid: KernelGrid, bins: ColourBins
) -> np.ndarray:
    """Histograms of one state (4,) under each kernel, (n_h, 512) (eq. 1).

    A row sums to one inside the picture, and to less where the kernel reaches out of it.
    """
    found = _bins_at(frame, *sample_pixels(state[None], aspect, grid.points), bins, 1.0).reshape(grid.kernels, -1)
    weights = grid.weights.reshape(grid.kernels, -1)
    return np.stack([np.bincount(b, w, BINS + 1)[:BINS] for b, w in zip(found, weights, strict=True)])


class HistogramModel:
    """Reference histograms of a target under several kernels, and the distance of many states to them at once.

    Only the bins that the reference holds enter the sum of eq. 2, so the histograms of the states are built over
    those bins alone (some tens instead of 512), in one `bincount` over all states and kernels.

    Args:
        reference: (n_h, 512), the rows normalised.
        bins: the colour bins that it was taken with.
        aspect: r = h / w of the target's rectangle.
    """

    def __init__(self, reference: np.ndarray, bins: ColourBins, aspect: float):
        self.reference = reference
        self.bins = bins
        self.aspect = aspect
        held = np.flatnonzero(reference.max(axis=0) > 0)
        self._columns = len(held) + 1  # the last one takes every colour that the reference does not hold
        self._column_of_bin = np.full(BINS + 1, len(held), np.int16)
        self._column_of_bin[held] = np.arange(len(held), dtype=np.int16)
        self._root_reference = np.zeros((len(reference), self._columns))
        self._root_reference[:, :-1] = np.sqrt(reference[:, held])

    def distances(
        self, frame: np.ndarray, states: np.ndarray, grid: KernelGrid, gain: float | np.ndarray = 1.0
    ) -> np.ndarray:
        """Mean Bhattacharyya distance of each state to the reference (eq. 4).

        Args:
            frame: (H, W, 3) uint8.
            states: (N, 4), as in `sample_pixels`.
            grid: sampling points, with as many kernels as the reference has rows.
            gain: factor on the picture's values before they are binned; one, or (3,) for B, G, R.

        Returns:
            (N,), 0 to 1.
        """
        columns, rows = sample_pixels(states, self.aspect, grid.points)
        return self._to_reference(_bins_at(frame, columns, rows, self.bins, gain), grid)

    def relit(self, frame: np.ndarray, state: np.ndarray, grid: KernelGrid, gains: np.ndarray) -> np.ndarray:
        """Mean Bhattacharyya distance (G,) of one state (4,) under each of the gains (G, 3)."""
        columns, rows = sample_pixels(state[None], self.aspect, grid.points)
        pixels, outside = _gathered(frame, columns, rows)
        bins = np.concatenate([self.bins.of(pixels, gain) for gain in gains])
        bins[:, outside[0]] = OUTSIDE
        return self._to_reference(bins, grid)

    def _to_reference(self, bins: np.ndarray, grid: KernelGrid) -> np.ndarray:
        """Mean distance (N,) of the histograms of bins (N, n_h * m) at the grid's points."""
        count, points = bins.shape
        slots = self._column_of_bin[bins].astype(np.int64)  # the type that bincount does not copy
        slots += np.repeat(np.arange(grid.kernels) * self._columns, points // grid.kernels)
        slots += (np.arange(count) * (grid.kernels * self._columns))[:, None]
        weights = np.broadcast_to(grid.weights, (count, points))
        histograms = np.bincount(slots.ravel(), weights.ravel(), count * grid.kernels * self._columns)
        roots = np.sqrt(histograms, out=histograms).reshape(count, grid.kernels, self._columns)
        rho = np.einsum("nkc,kc->nk", roots, self._root_reference)
        return np.sqrt(np.maximum(0.0, 1.0 - rho)).mean(axis=1)


def learn_model(frame: np.ndarray, state: np.ndarray, aspect: float, grid: KernelGrid) -> HistogramModel:
    """Model of what the picture shows at a state (4,), with colour bins placed for it.

    Args:
        frame: (H, W, 3) uint8.
        state: the target's state.
        aspect: r = h / w.
        grid: sampling points; the more the better, this is done once.

    Raises:
        ValueError: less than half of a kernel lies in the picture.
    """
    target, weights = _pixels(frame, state, aspect, grid.points, grid.weights)
    around = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 48), np.linspace(-0.9, 0.9, 48)), axis=-1).reshape(-1, 2)
    around = around[np.abs(around).max(axis=1) > 0.6]
    surroundings, _ = _pixels(frame, state, aspect, around, np.ones(len(around)))
    if weights.sum() <= 0.5 * grid.kernels:
        raise ValueError("box: got a target that is mostly outside the picture; draw the box around what can be seen")
    bins = place_bins(target, weights, surroundings)
    reference = state_histograms(frame, state, aspect, grid, bins)
    mass = reference.sum(axis=1, keepdims=True)
    if mass.min() < 0.5:
        raise ValueError("box: got a target that is partly outside the picture; draw the box around what can be seen")
    return HistogramModel(reference / mass, bins, aspect)


def _pixels(
    frame: np.ndarray, state: np.ndarray, aspect: float, points: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 3) under the points of a state that lie in the picture, and their weights (N,)."""
    columns, rows = (a[0] for a in sample_pixels(state[None], aspect, points))
    inside = (columns >= 0) & (columns < frame.shape[1]) & (rows >= 0) & (rows < frame.shape[0])
    return frame[rows[inside], columns[inside]], weights[inside]


def _bins_at(
    frame: np.ndarray, columns: np.ndarray, rows: np.ndarray, bins: ColourBins, gain: float | np.ndarray
) -> np.ndarray:
    """Bin of each point (N, M), OUTSIDE beyond the picture.

    Whichever is less is binned: the part of the picture that the points touch, or each point by itself.
    """
    left, top = max(0, int(columns.min())), max(0, int(rows.min()))
    right = max(left, min(frame.shape[1], int(columns.max()) + 1))
    bottom = max(top, min(frame.shape[0], int(rows.max()) + 1))
    if (right - left) * (bottom - top) > _GATHER_FROM * columns.size:
        pixels, outside = _gathered(frame, columns, rows)
        found = bins.of(pixels, gain)
        found[outside] = OUTSIDE
        return found
    window = np.full((bottom - top + 2, right - left + 2), OUTSIDE, np.int16)
    if right > left and bottom > top:
        window[1:-1, 1:-1] = bins.of(frame[top:bottom, left:right], gain)
    index = np.clip(rows - (top - 1), 0, window.shape[0] - 1)
    index *= window.shape[1]
    index += np.clip(columns - (left - 1), 0, window.shape[1] - 1)
    return window.ravel()[index]


def _gathered(frame: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, M, 3) at points, and which of them (N, M) lie outside the picture (their pixel is one at the edge)."""
    x, y = columns.clip(0, frame.shape[1] - 1), rows.clip(0, frame.shape[0] - 1)
    return frame[y, x], (x != columns) | (y != rows)
