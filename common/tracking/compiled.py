"""Compiled form of the sums in `common.tracking.histogram`: the same figures, twenty and more times as fast.

One row of a kernel's ellipse after the other: where it begins and ends, and the sum of its weights, are known in closed
form, so what is left for each pixel is one parabola and one addition. The additions go to four histograms in turn: a
plain colour fills one bin, and each addition to it would wait for the one before.
"""

# ruff: noqa: RUF046 (floor and ceil give floats in compiled code)

from __future__ import annotations

import math

import numpy as np
from numba import njit

_LANES = 4


@njit(nogil=True)
def _fill_slots(frame, table, slot_of_bin, left, top, right, bottom, slots):  # type: ignore[no-untyped-def]
    for y in range(top, bottom):
        for x in range(left, right):
            slots[y, x] = slot_of_bin[table[0, frame[y, x, 0]] + table[1, frame[y, x, 1]] + table[2, frame[y, x, 2]]]


@njit(nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _taken_coefficient(lanes, mass, root_reference):  # type: ignore[no-untyped-def]
    """Bhattacharyya coefficient of the histogram in the lanes, which are empty afterwards."""
    rho = 0.0
    for c in range(root_reference.shape[0]):
        rho += math.sqrt(lanes[0, c] + lanes[1, c] + lanes[2, c] + lanes[3, c]) * root_reference[c]
    lanes[:] = 0.0
    return rho / math.sqrt(mass)


@njit(nogil=True, error_model="numpy", fastmath={"contract"})
def _fill_distances(slots, states, aspect, centers, half_width, half_height, root_reference, distances):  # type: ignore[no-untyped-def]
    rows, columns = slots.shape
    kernels, size = root_reference.shape
    lanes = np.zeros((_LANES, size))
    for i in range(states.shape[0]):
        width = 1.0 / (states[i, 3] * math.sqrt(aspect))
        height = width * aspect
        cosine, sine = math.cos(states[i, 2]), math.sin(states[i, 2])
        # Inside the ellipse p dx^2 + 2 q dx dy + s dy^2 < 1; the kernel is one minus that.
        a, b = 1.0 / (half_width * width) ** 2, 1.0 / (half_height * height) ** 2
        p = cosine * cosine * a + sine * sine * b
        q = cosine * sine * (a - b)
        s = sine * sine * a + cosine * cosine * b
        skew, curve, inverse = q / p, s - q * q / p, 1.0 / p
        reach = math.sqrt(1.0 / curve)
        total = 0.0
        for k in range(kernels):
            cx = states[i, 0] + centers[k, 0] * width * cosine - centers[k, 1] * height * sine
            cy = states[i, 1] + centers[k, 0] * width * sine + centers[k, 1] * height * cosine
            mass = 0.0
            for y in range(int(math.ceil(cy - reach)), int(math.floor(cy + reach)) + 1):
                dy = y - cy
                middle = cx - skew * dy
                peak = 1.0 - curve * dy * dy  # the kernel's largest value in this row
                if peak <= 0.0:
                    continue
                half = math.sqrt(peak * inverse)
                x, end = int(math.ceil(middle - half)), int(math.floor(middle + half)) + 1
                n = end - x
                if n <= 0:
                    continue
                d = x - middle
                mass += n * peak - p * (n * d * d + d * n * (n - 1) + (n - 1) * n * (2 * n - 1) / 6.0)
                if y < 0 or y >= rows:
                    continue  # outside the picture: it counts in the mass, and has no colour
                x, end = max(x, 0), min(end, columns)
                d = x - middle
                while x + 3 < end:
                    lanes[0, slots[y, x]] += peak - p * d * d
                    lanes[1, slots[y, x + 1]] += peak - p * (d + 1.0) * (d + 1.0)
                    lanes[2, slots[y, x + 2]] += peak - p * (d + 2.0) * (d + 2.0)
                    lanes[3, slots[y, x + 3]] += peak - p * (d + 3.0) * (d + 3.0)
                    x += 4
                    d += 4.0
                while x < end:
                    lanes[0, slots[y, x]] += peak - p * d * d
                    x += 1
                    d += 1.0
            if mass <= 0.0:  # smaller than a pixel: the nearest one is all there is
                mass = 1.0
                x, y = int(math.floor(cx + 0.5)), int(math.floor(cy + 0.5))
                if 0 <= x < columns and 0 <= y < rows:
                    lanes[0, slots[y, x]] = 1.0
            total += math.sqrt(max(0.0, 1.0 - _taken_coefficient(lanes, mass, root_reference[k])))
        distances[i] = total / kernels


# A given signature compiles when the module is imported (and is kept on disk), not when the first target is selected.
@njit(
    "void(u1[:,:,:],u2[:,:,::1],u2[::1],i8,i8,i8,i8,u2[:,::1],f8[:,::1],f8,f8[:,::1],f8,f8,f8[:,::1],f8[:,::1])",
    cache=True,
    nogil=True,
)
def fill_distances(  # type: ignore[no-untyped-def]
    frame, tables, slot_of_bin, left, top, right, bottom, slots,
    states, aspect, centers, half_width, half_height, root_reference, distances,
):  # fmt: skip
    """Mean Bhattacharyya distance of each state under each table of bins (Teulière 2011, eqs 1 to 4).

    Args:
        frame: (H, W, 3) uint8.
        tables: (T, 3, 256) uint16, what each value of a channel adds to the bin's number.
        slot_of_bin: (512,) uint16, column of `root_reference` of each bin.
        left: first column of the window that the states touch.
        top: its first row.
        right: column after its last.
        bottom: row after its last.
        slots: (H, W) uint16, for its own use.
        states: (N, 4), x, y (px), psi (rad), 1/sqrt(A) (1/px).
        aspect: h / w.
        centers: (K, 2) kernel centres in units of (w, h).
        half_width: half-axis of the kernels along the rectangle's x, in units of w.
        half_height: the other one, in units of h.
        root_reference: (K, C) square roots of the reference histograms.
        distances: (T, N), written.
    """
    for t in range(tables.shape[0]):
        _fill_slots(frame, tables[t], slot_of_bin, left, top, right, bottom, slots)
        _fill_distances(slots, states, aspect, centers, half_width, half_height, root_reference, distances[t])
