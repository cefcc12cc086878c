"""Signals, sources and a textbook filter that the tests of the fusion share."""

from __future__ import annotations

import numpy as np

from onboard.fusion.config import FusionConfig
from onboard.fusion.source import Source

PERIOD_NS = 50_000_000


def line(count: int, seed: int = 0, noise: float = 0.1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [np.array([k * 0.05, 1.0 - k * 0.02]) + rng.normal(0.0, noise, 2) for k in range(count)]


def standard(values: list[np.ndarray], noise: float, config: FusionConfig) -> np.ndarray:
    """State of a textbook Kalman filter, written out, after these measurements."""
    size, dt_s = len(values[0]), PERIOD_NS * 1e-9
    a, h = transition(size, dt_s), np.eye(size, 2 * size)
    q = process_noise(np.full(size, config.acceleration**2), dt_s)
    x = np.concatenate([values[0], np.zeros(size)])
    p = np.diag([noise**2] * size + [config.start_rate**2] * size)
    for value in values[1:]:
        x, p = a @ x, a @ p @ a.T + q
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + noise**2 * np.eye(size))
        x, p = x + gain @ (value - h @ x), (np.eye(2 * size) - gain @ h) @ p
        p = (p + p.T) / 2
    return x


def transition(size: int, dt_s: float) -> np.ndarray:
    """Transition A, (2N, 2N), of N values above their N rates over a time (eq. 4.1, where it is one frame)."""
    return np.eye(2 * size) + dt_s * np.eye(2 * size, k=size)


def process_noise(density: np.ndarray, dt_s: float) -> np.ndarray:
    """Covariance R_ww, (2N, 2N), that white acceleration of a spectral density (N,), units²/s³, adds over a time."""
    q = np.diag(density)
    return np.block([[dt_s**3 / 3 * q, dt_s**2 / 2 * q], [dt_s**2 / 2 * q, dt_s * q]])


def control_matrix(size: int, dt_s: float) -> np.ndarray:
    """Control B, (2N, N), of a known acceleration over a time."""
    return np.vstack([np.eye(size) * (dt_s**2 / 2), np.eye(size) * dt_s])


def sources(count: int, noise: float = 0.1, size: int = 2, threshold: float = 0.0) -> list[Source]:
    return [Source(f"s{i}", (noise,) * size, threshold) for i in range(count)]
