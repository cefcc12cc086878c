"""Signals of a second-order system and faulty sources that measure them (Echeverri 2016, section 4.5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RATE_HZ = 25.0
_DAMPING = (0.4, 1.0)
_NATURAL_RAD_S = (1.0, 2.5)
_HOLD_S = (2.0, 5.0)
_STEP = 1.0
_NOISE, _HEAVY_NOISE = (0.05, 0.12), (0.15, 0.25)
SOURCES = ("noise", "spikes", "drift", "shocks")
"""What is wrong with each source: heavier Gaussian noise, or one of the thesis's faults on top of a lighter one."""
_SPIKE_SHARE, _SPIKES = 0.03, (0.8, 3.0)
_DRIFT_S, _DRIFT_PER_S = (4.0, 8.0), (0.15, 0.5)
_SHOCK_S, _SHOCKS = (1.0, 3.0), (0.5, 2.0)
_FAULT_EVERY_S = 12.0


@dataclass(frozen=True)
class Signals:
    """One run."""

    t_ns: np.ndarray
    """Stamps, (T,), ns."""
    truth: np.ndarray
    """The signal, (T,)."""
    measured: np.ndarray
    """What each source says, (T, 4), in the order of `SOURCES`."""
    noise: np.ndarray
    """Standard deviation of each source's Gaussian noise, (4,)."""


def second_order(rng: np.random.Generator, count: int) -> np.ndarray:
    """Response (T,) of y'' = ω² (r - y) - 2 ζ ω y' to a reference r that steps at random times."""
    damping, natural = rng.uniform(*_DAMPING), rng.uniform(*_NATURAL_RAD_S)
    dt_s = 1.0 / RATE_HZ
    value = rate = reference = 0.0
    next_step_s = 0.0
    signal = np.empty(count)
    for index in range(count):
        if index * dt_s >= next_step_s:
            reference = rng.uniform(-_STEP, _STEP)
            next_step_s += rng.uniform(*_HOLD_S)
        for _ in range(4):
            rate += (natural**2 * (reference - value) - 2 * damping * natural * rate) * dt_s / 4
            value += rate * dt_s / 4
        signal[index] = value
    return signal


def make(seed: tuple[int, int], duration_s: float) -> Signals:
    """A run of its own for each seed: system, reference, noise levels, times and sizes of the faults."""
    rng = np.random.default_rng(seed)
    count = round(duration_s * RATE_HZ)
    truth = second_order(rng, count)
    noise = np.concatenate([rng.uniform(*_HEAVY_NOISE, 1), rng.uniform(*_NOISE, len(SOURCES) - 1)])
    measured = truth[:, None] + noise * rng.normal(size=(count, len(SOURCES)))
    spikes = rng.random(count) < _SPIKE_SHARE
    measured[spikes, 1] += _signs(rng, int(spikes.sum())) * rng.uniform(*_SPIKES, int(spikes.sum()))
    measured[:, 2] += _faults(rng, count, _DRIFT_S, _DRIFT_PER_S, ramp=True)
    measured[:, 3] += _faults(rng, count, _SHOCK_S, _SHOCKS, ramp=False)
    return Signals(np.round(np.arange(count) * 1e9 / RATE_HZ).astype(np.int64), truth, measured, noise)


def _faults(
    rng: np.random.Generator, count: int, length_s: tuple[float, float], size: tuple[float, float], ramp: bool
) -> np.ndarray:
    """Offsets (T,): one fault in each stretch of the run, a ramp of so many units/s or a constant of so many units."""
    offsets = np.zeros(count)
    stretch = round(_FAULT_EVERY_S * RATE_HZ)
    for begin in range(0, count, stretch):
        length = round(rng.uniform(*length_s) * RATE_HZ)
        first = begin + int(rng.integers(0, max(1, stretch - length)))
        span = np.arange(first, min(first + length, count))
        shape = (span - first + 1) / RATE_HZ if ramp else np.ones(len(span))
        offsets[span] += _signs(rng, 1) * rng.uniform(*size) * shape
    return offsets


def _signs(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.choice([-1.0, 1.0], count)
