"""The horizon: gyroscopes take fast errors out of the attitude, accelerometers slow ones; biases, jumps and gaps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.geometry.rotation import quat_conjugate, quat_exp, quat_from_euler, quat_multiply, quat_rotate
from ground.pursuit.horizon import Horizon

DT_S, NOISE_RAD, NOISE_S = 0.02, 0.0087, 1.0
BIAS_RAD_S = np.array([0.0004, -0.0005, 0.0003])


def _errors(horizon: Horizon, seconds: float, jump_rad: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Angles between truth and what the filter says, and between truth and the estimate, rad, of a rocking vehicle."""
    rng = np.random.default_rng(3)
    truth, noise, keep = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), math.exp(-DT_S / NOISE_S)
    ours, raw = [], []
    for index in range(round(seconds / DT_S)):
        t_s = index * DT_S
        rates = np.array([0.6 * math.sin(1.9 * t_s), 0.5 * math.cos(1.3 * t_s), 0.3 * math.sin(0.4 * t_s)])
        middle = t_s - DT_S / 2
        mean = np.array([0.6 * math.sin(1.9 * middle), 0.5 * math.cos(1.3 * middle), 0.3 * math.sin(0.4 * middle)])
        if index:
            truth = quat_multiply(truth, quat_exp(mean * DT_S))
        noise = keep * noise + rng.normal(0.0, NOISE_RAD * math.sqrt(1.0 - keep**2), 3)
        estimate = quat_multiply(truth, quat_exp(noise))
        if index * 2 > seconds / DT_S:
            estimate = quat_multiply(quat_from_euler(0.0, 0.0, jump_rad), estimate)
        measured = rates + BIAS_RAD_S + rng.normal(0.0, 0.002, 3)
        said = horizon.update(estimate, measured, round(t_s * 1e9))
        for errors, attitude in ((ours, said), (raw, estimate)):
            errors.append(2.0 * np.linalg.norm(quat_multiply(quat_conjugate(truth), attitude)[1:]))
    return np.array(ours), np.array(raw)


def test_the_error_is_much_smaller_than_the_estimate_s_with_noise_and_bias_in_the_gyroscopes() -> None:
    ours, raw = _errors(Horizon(NOISE_RAD, NOISE_S), 60.0)
    assert np.sqrt(np.mean(ours[1000:] ** 2)) < np.sqrt(np.mean(raw[1000:] ** 2)) / 1.6


def _tilt_errors(told: bool, yaw_rate_rad_s: float) -> np.ndarray:
    """Tilt errors (N, 2), rad, over the last half of a minute of an estimate that leans by 0.6 degrees, to and fro."""
    rng = np.random.default_rng(5)
    horizon, keep, v_noise = Horizon(NOISE_RAD, NOISE_S), math.exp(-DT_S), np.zeros(3)
    velocity, errors, before = np.zeros(3), [], quat_from_euler(0.0, 0.1, 0.0)
    for index in range(3000):
        t_s = index * DT_S
        acceleration = np.array([1.5 * math.sin(1.1 * t_s), 1.0 * math.cos(0.7 * t_s), 0.0])
        velocity = velocity + acceleration * DT_S
        rocking = 0.1 * math.sin(1.1 * t_s), 0.1 * math.cos(0.7 * t_s)
        truth = quat_from_euler(*rocking, yaw_rate_rad_s * t_s)
        force = quat_rotate(quat_conjugate(truth), acceleration - np.array([0.0, 0.0, 9.80665]))
        v_noise = keep * v_noise + rng.normal(0.0, 0.03 * math.sqrt(1.0 - keep**2), 3)
        turn = quat_multiply(quat_conjugate(before), truth)
        rates, before = 2.0 * turn[1:] / DT_S, truth
        estimate = quat_multiply(truth, quat_exp(0.01 * math.sin(0.15 * t_s) * np.array([1.0, -1.0, 0.0])))
        said = horizon.update(
            estimate, rates, round(t_s * 1e9), velocity + v_noise, force + rng.normal(0.0, 0.05, 3) if told else None
        )
        errors.append(2.0 * quat_multiply(quat_conjugate(truth), said)[1:3])
    return np.array(errors[1500:])


@pytest.mark.parametrize("yaw_rate_rad_s", [0.0, 0.3])
def test_accelerometers_tell_an_estimate_that_leans_for_long(yaw_rate_rad_s: float) -> None:
    blind, told = (np.sqrt(np.mean(_tilt_errors(told, yaw_rate_rad_s) ** 2)) for told in (False, True))
    assert told < min(0.0015, 0.7 * blind)


def test_without_doubt_the_estimate_is_taken_as_it_is() -> None:
    ours, raw = _errors(Horizon(0.0, NOISE_S), 2.0)
    assert ours == pytest.approx(raw, abs=1e-12)


def test_a_jump_of_the_estimate_is_followed() -> None:
    ours, _ = _errors(Horizon(NOISE_RAD, NOISE_S), 20.0, jump_rad=0.4)
    assert abs(ours[-1] - 0.4) < 0.04


def test_a_gap_in_the_telemetry_begins_anew() -> None:
    horizon, level = Horizon(NOISE_RAD, NOISE_S), np.array([1.0, 0.0, 0.0, 0.0])
    for index in range(100):
        horizon.update(level, np.zeros(3), index * 20_000_000)
    tilted = quat_from_euler(0.3, 0.0, 0.0)
    assert horizon.update(tilted, np.zeros(3), 5_000_000_000) == pytest.approx(tilted)


def test_it_lasts_for_hours() -> None:
    rng = np.random.default_rng(7)
    horizon, yaw_rad, step_s = Horizon(NOISE_RAD, NOISE_S), 0.0, 0.1
    truth = said = np.zeros(4)
    for index in range(6000):
        rate_rad_s = 0.6 * math.sin(0.02 * index)
        yaw_rad += (rate_rad_s + 0.6 * math.sin(0.02 * (index - 1))) / 2 * step_s
        truth = quat_from_euler(0.0, 0.0, yaw_rad)
        estimate = quat_multiply(truth, quat_exp(rng.normal(0.0, NOISE_RAD, 3)))
        rates, force = np.array([0.0, 0.0, rate_rad_s]), np.array([0.0, 0.0, -9.80665]) + rng.normal(0.0, 0.05, 3)
        said = horizon.update(estimate, rates, round(index * step_s * 1e9), rng.normal(0.0, 0.03, 3), force)
        assert np.isfinite(said).all(), f"after {index * step_s:.0f} s"
    assert 2.0 * np.linalg.norm(quat_multiply(quat_conjugate(truth), said)[1:]) < NOISE_RAD / 2
