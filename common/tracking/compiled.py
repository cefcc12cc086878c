"""Compiled form of the sums in `common.tracking.histogram`: the same figures, twenty and more times as fast.

Where the rows of a kernel's ellipse begin and end, and the sum of its weights, are known in closed form and come first,
in a loop without a branch, which the processor does for several rows at once. What is left for each pixel is one
parabola and one addition. The additions go to four histograms in turn: a plain colour fills one bin, and each addition
to it would wait for the one before.
"""

# ruff: noqa: RUF046 (floor and ceil give floats in compiled code)

from __future__ import annotations

import math

import numpy as np
from numba import njit

_LANES = 4


@njit(nogil=True)
def _fill_table(gain, offsets, width, count, table):  # type: ignore[no-untyped-def]
    """As `ColourBins.table`, for one gain (3,)."""
    place = count * count
    for channel in range(3):
        shift = offsets[channel] / width
        for value in range(256):
            table[channel, value] = np.int64(min(value / width * gain[channel] + shift, count - 1.0)) * place
        place //= count


@njit("UniTuple(i8,4)(f8[:,:],f8,f8,f8,i8,i8)", cache=True, nogil=True)
def touched(states, aspect, across, along, columns, rows):  # type: ignore[no-untyped-def]
    """Window of a picture that the kernels of all states (N, 4) touch: left, top, right, bottom, px.

    Args:
        states: (N, 4), x, y (px), psi (rad), 1/sqrt(A) (1/px).
        aspect: h / w.
        across: how far a kernel reaches from the rectangle's centre along its x, in units of w.
        along: the same along its y, in units of h.
        columns: width of the picture, px.
        rows: its height, px.
    """
    width = 1.0 / (states[:, 3].min() * math.sqrt(aspect))
    across, along = across * width, along * width * aspect
    if len(states) == 1:  # the rectangle around the kernels, turned; for many the circle around it
        cosine, sine = abs(math.cos(states[0, 2])), abs(math.sin(states[0, 2]))
        reach_x, reach_y = across * cosine + along * sine + 1.0, across * sine + along * cosine + 1.0
    else:
        reach_x = reach_y = math.hypot(across, along) + 1.0
    left, top = int(max(0.0, states[:, 0].min() - reach_x)), int(max(0.0, states[:, 1].min() - reach_y))
    right, bottom = int(states[:, 0].max() + reach_x) + 1, int(states[:, 1].max() + reach_y) + 1
    return left, top, min(columns, right), min(rows, bottom)


@njit(nogil=True)
def _fill_slots(frame, table, slot_of_bin, left, top, right, bottom, checkered, slots):  # type: ignore[no-untyped-def]
    for y in range(top, bottom):
        odd = y & checkered
        for i in range((left - odd + checkered) >> checkered, (right - odd + checkered) >> checkered):
            x = (i << checkered) + odd
            slots[y, i] = slot_of_bin[table[0, frame[y, x, 0]] + table[1, frame[y, x, 1]] + table[2, frame[y, x, 2]]]


@njit(nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _taken_coefficient(lanes, mass, root_reference):  # type: ignore[no-untyped-def]
    """Bhattacharyya coefficient of the histogram in the lanes, which are empty afterwards."""
    rho = 0.0
    for c in range(root_reference.shape[0]):
        found = lanes[0, c] + lanes[1, c] + lanes[2, c] + lanes[3, c]
        rho += (
            math.sqrt(max(found, 0.0)) * root_reference[c]
        )  # rounding at an ellipse's edge may leave less than nothing
    lanes[:] = 0.0
    return rho / math.sqrt(mass)


@njit(nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nnan", "ninf", "nsz"})
def _fill_rows(top, count, cx, cy, skew, curve, p, checkered, starts, ends, middles, peaks):  # type: ignore[no-untyped-def]
    """Each row of an ellipse: first column, column after the last, and the parabola. Returns the sum of all weights."""
    mass, inverse, narrower = 0.0, 1.0 / p, 1.0 / (1 + checkered)
    for r in range(count):
        dy = (top + r) - cy
        middle = (cx - skew * dy - ((top + r) & checkered)) * narrower
        peak = max(1.0 - curve * dy * dy, 0.0)  # the kernel's largest value in this row
        half = math.sqrt(peak * inverse)
        first, last = np.ceil(middle - half), np.floor(middle + half)
        n, d = max(last - first + 1.0, 0.0), first - middle
        mass += n * (peak - p * (d * d + d * (n - 1.0) + (n - 1.0) * (2.0 * n - 1.0) * (1.0 / 6.0)))
        starts[r], ends[r], middles[r], peaks[r] = np.int64(first), np.int64(last) + 1, middle, peak
    return mass


@njit(nogil=True, error_model="numpy", fastmath={"contract"})
def _fill_distances(
    slots, columns, checkered, states, aspect, centers, half_width, half_height, root_reference, distances
):  # type: ignore[no-untyped-def]
    rows = slots.shape[0]
    kernels, size = root_reference.shape
    lanes = np.zeros((_LANES, size))
    tallest = 2.0 * max(half_width, half_height * aspect) / (states[:, 3].min() * math.sqrt(aspect))
    starts, ends = np.empty(int(tallest) + 3, np.int64), np.empty(int(tallest) + 3, np.int64)
    middles, peaks = np.empty(int(tallest) + 3), np.empty(int(tallest) + 3)
    for i in range(states.shape[0]):
        width = 1.0 / (states[i, 3] * math.sqrt(aspect))
        height = width * aspect
        cosine, sine = math.cos(states[i, 2]), math.sin(states[i, 2])
        # Inside the ellipse p dx^2 + 2 q dx dy + s dy^2 < 1; the kernel is one minus that.
        a, b = 1.0 / (half_width * width) ** 2, 1.0 / (half_height * height) ** 2
        p = cosine * cosine * a + sine * sine * b
        q = cosine * sine * (a - b)
        s = sine * sine * a + cosine * cosine * b
        skew, curve = q / p, s - q * q / p
        reach = math.sqrt(1.0 / curve)
        p *= (1 + checkered) ** 2  # from here on in columns of `slots`
        total = 0.0
        for k in range(kernels):
            cx = states[i, 0] + centers[k, 0] * width * cosine - centers[k, 1] * height * sine
            cy = states[i, 1] + centers[k, 0] * width * sine + centers[k, 1] * height * cosine
            top = int(math.ceil(cy - reach))
            count = int(math.floor(cy + reach)) + 1 - top
            mass = _fill_rows(top, count, cx, cy, skew, curve, p, checkered, starts, ends, middles, peaks)
            # Outside the picture a pixel counts in the mass, and has no colour.
            for r in range(max(0, -top), min(count, rows - top)):
                row, peak = slots[top + r], peaks[r]
                x, end = max(starts[r], 0), min(ends[r], (columns - ((top + r) & checkered) + checkered) >> checkered)
                d = x - middles[r]
                while x + 3 < end:
                    lanes[0, row[x]] += peak - p * d * d
                    lanes[1, row[x + 1]] += peak - p * (d + 1.0) * (d + 1.0)
                    lanes[2, row[x + 2]] += peak - p * (d + 2.0) * (d + 2.0)
                    lanes[3, row[x + 3]] += peak - p * (d + 3.0) * (d + 3.0)
                    x += 4
                    d += 4.0
                while x < end:
                    lanes[0, row[x]] += peak - p * d * d
                    x += 1
                    d += 1.0
            if mass <= 0.0:  # smaller than a pixel: the nearest one is all there is
                mass = 1.0
                x, y = int(math.floor(cx + 0.5)), int(math.floor(cy + 0.5))
                if 0 <= x < columns and 0 <= y < rows:
                    lanes[0, slots[y, x >> checkered]] = 1.0
            total += math.sqrt(max(0.0, 1.0 - _taken_coefficient(lanes, mass, root_reference[k])))
        distances[i] = total / kernels


# A given signature compiles when the module is imported (and is kept on disk), not when the first target is selected.
@njit(
    "void(u1[:,:,:],f8[:,::1],i8[::1],i8,i8,u2[::1],i8,u2[:,::1],f8[:,::1],f8,f8,f8,f8[:,::1],f8,f8,f8[:,::1],f8[:,::1])",
    cache=True,
    nogil=True,
)
def fill_distances(  # type: ignore[no-untyped-def]
    frame, gains, offsets, bin_width, bins, slot_of_bin, checkered, slots,
    states, aspect, across, along, centers, half_width, half_height, root_reference, distances,
):  # fmt: skip
    """Mean Bhattacharyya distance of each state under each gain (Teulière 2011, eqs 1 to 4).

    Args:
        frame: (H, W, 3) uint8.
        gains: (T, 3), B, G, R: factors on the picture's values before they are binned.
        offsets: (3,) shift of each channel's bins, grey levels.
        bin_width: width of a bin, grey levels.
        bins: how many there are in each channel.
        slot_of_bin: (512,) uint16, column of `root_reference` of each bin.
        checkered: 1 for every other pixel of a row, one further on in the next one; 0 for every pixel.
        slots: (H, W) uint16, for its own use.
        states: (N, 4), x, y (px), psi (rad), 1/sqrt(A) (1/px).
        aspect: h / w.
        across: how far a kernel reaches from the rectangle's centre along its x, in units of w.
        along: the same along its y, in units of h.
        centers: (K, 2) kernel centres in units of (w, h).
        half_width: half-axis of the kernels along the rectangle's x, in units of w.
        half_height: the other one, in units of h.
        root_reference: (K, C) square roots of the reference histograms.
        distances: (T, N), written.
    """
    left, top, right, bottom = touched(states, aspect, across, along, frame.shape[1], frame.shape[0])
    table = np.empty((3, 256), np.uint16)
    for t in range(gains.shape[0]):
        _fill_table(gains[t], offsets, bin_width, bins, table)
        _fill_slots(frame, table, slot_of_bin, left, top, right, bottom, checkered, slots)
        _fill_distances(
            slots,
            frame.shape[1],
            checkered,
            states,
            aspect,
            centers,
            half_width,
            half_height,
            root_reference,
            distances[t],
        )
