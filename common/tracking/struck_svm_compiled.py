"""Compiled steps of sequential minimal optimisation on the dual of Struck (Platt 1998; Bordes et al. 2007)."""

from __future__ import annotations

from numba import njit

_LEAST_GAIN = 1e-5
ZERO = 1e-8
"""A coefficient nearer to zero than this counts as zero."""


# The signatures compile when the module is imported (and are kept on disk), not when the first target is selected.
@njit("void(i8,i8,i8,f8,i8[::1],f8[::1],f8[::1],f8[:,::1])", cache=True, nogil=True)
def step(positive, negative, count, cost, choice, beta, gradient, kernel):  # type: ignore[no-untyped-def]
    """One step on two coefficients of a pattern: as much from the second to the first as gains most.

    Args:
        positive: index of the coefficient that grows.
        negative: of the one that falls by as much.
        count: support vectors in use.
        cost: C, the bound of a target's coefficient; that of any other box is 0.
        choice: (n,) int64, number of each one's box within its pattern, 0 for the target.
        beta: (n,) float64, coefficients; changed.
        gradient: (n,) float64, of the dual; changed.
        kernel: (n, n) float64, of the support vectors.
    """
    gain = gradient[positive] - gradient[negative]
    if positive == negative or gain < _LEAST_GAIN:
        return
    curvature = max(2.0 - 2.0 * kernel[positive, negative], ZERO)
    bound = (cost if choice[positive] == 0 else 0.0) - beta[positive]
    move = min(gain / curvature, bound)
    beta[positive] += move
    beta[negative] -= move
    for i in range(count):
        gradient[i] -= move * (kernel[i, positive] - kernel[i, negative])


@njit("void(i8[::1],i8,f8,i8[::1],i8[::1],f8[::1],f8[::1],f8[:,::1])", cache=True, nogil=True)
def optimise(picks, count, cost, pattern, choice, beta, gradient, kernel):  # type: ignore[no-untyped-def]
    """Steps over known support vectors: for each pick the best pair of its pattern.

    Args:
        picks: (k,) int64, indices of support vectors; the pattern of each is improved.
        count: support vectors in use.
        cost: see `step`.
        pattern: (n,) int64, number of each one's pattern.
        choice: see `step`.
        beta: see `step`.
        gradient: see `step`.
        kernel: see `step`.
    """
    for pick in picks:
        positive = negative = -1
        for i in range(count):
            if pattern[i] != pattern[pick]:
                continue
            room = beta[i] < (cost if choice[i] == 0 else 0.0) - ZERO
            if room and (positive < 0 or gradient[i] > gradient[positive]):
                positive = i
            if negative < 0 or gradient[i] < gradient[negative]:
                negative = i
        if positive >= 0:
            step(positive, negative, count, cost, choice, beta, gradient, kernel)
