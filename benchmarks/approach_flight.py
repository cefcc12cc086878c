"""A vehicle flown straight at a wall under helm's pilot: the simulated autopilot, or one that obeys at once."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Protocol

import numpy as np

from common.messages import Obstacle, Obstacles, Quat, Vec3
from onboard.helm.arbiter import Verdict
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.px4 import PX4
from onboard.helm.pilot import Pilot
from onboard.helm.setpoint import LocalSetpoint
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.map import ObstacleMap
from simulation.autopilot.motion import heading
from simulation.autopilot.response import configured, hovering
from simulation.autopilot.setpoints import decode

STEP_S = 0.02
_SENSOR_STEPS = 5  # 10 Hz
_DELAY_NS = 50_000_000
_NOISE_M = 0.02
_LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)


class Vehicle(Protocol):
    """What is flown."""

    noise_m: float
    """Standard deviation of the sensor's distances, m."""

    def start(self) -> Vehicle:
        """The same vehicle at its beginning."""
        ...

    def obey(self, setpoint: LocalSetpoint) -> None:
        """Fly a setpoint for one step."""
        ...

    def estimate(self) -> tuple[Vec3, Vec3, Quat]:
        """Position, velocity and attitude as the autopilot says."""
        ...

    def truth(self) -> tuple[float, float]:
        """Way north, m, and speed north, m/s."""
        ...


class Simulated:
    """The simulated autopilot, hovering.

    Args:
        drag_n_s_m: drag, N per m/s, at 1 kg.
        seed: of the estimate's errors.
    """

    noise_m = _NOISE_M

    def __init__(self, drag_n_s_m: float, seed: int):
        self._vehicle = hovering(configured(drag_n_s_m, seed))
        self._origin_m = self._vehicle.truth.ned_p_m[0]

    def start(self) -> Simulated:
        """A copy that hovers."""
        return copy.deepcopy(self)

    def obey(self, setpoint: LocalSetpoint) -> None:
        """Hand it over as it comes off the wire."""
        fields = SimpleNamespace(**PX4.setpoint(setpoint))
        self._vehicle.take_setpoint(decode(fields, heading(self._vehicle.estimate.ned_q_body)))
        for _ in range(round(STEP_S / self._vehicle.dt_s)):
            self._vehicle.step()

    def estimate(self) -> tuple[Vec3, Vec3, Quat]:
        """Of the autopilot."""
        known = self._vehicle.estimate
        return known.ned_p_m, known.ned_v_m_s, known.ned_q_body

    def truth(self) -> tuple[float, float]:
        """Of the plant."""
        return self._vehicle.truth.ned_p_m[0] - self._origin_m, self._vehicle.truth.ned_v_m_s[0]


class Ideal:
    """Flies every setpoint at once, and knows where it is."""

    noise_m = 0.0

    def __init__(self) -> None:
        self._north_m = self._north_m_s = 0.0

    def start(self) -> Ideal:
        """At rest."""
        return Ideal()

    def obey(self, setpoint: LocalSetpoint) -> None:
        """Fly it."""
        self._north_m_s = setpoint.north_m_s
        self._north_m += setpoint.north_m_s * STEP_S

    def estimate(self) -> tuple[Vec3, Vec3, Quat]:
        """The truth."""
        return (self._north_m, 0.0, -20.0), (self._north_m_s, 0.0, 0.0), _LEVEL

    def truth(self) -> tuple[float, float]:
        """The truth."""
        return self._north_m, self._north_m_s


@dataclass(frozen=True)
class Flight:
    """One approach, every 20 ms."""

    distance_m: np.ndarray
    """True distance to the wall, m, (T,)."""
    speed_m_s: np.ndarray
    """True speed towards it, m/s, (T,)."""
    setpoint_m_s: np.ndarray
    """Speed that the limiter allowed, m/s, (T,)."""
    why: tuple[str, ...]
    """What limited, T."""


def fly(
    vehicle: Vehicle, config: LimiterConfig, speed_m_s: float, duration_s: float, seed: int, start_m: float = 14.0
) -> Flight:
    """Ask for a speed at a wall ahead, all the time.

    Args:
        vehicle: at its beginning; it is left there.
        config: the limiter.
        speed_m_s: asked, m/s.
        duration_s: how long, s.
        seed: of the sensor's noise.
        start_m: distance of the wall at the beginning, m.
    """
    rng = np.random.default_rng(seed)
    flown = vehicle.start()
    pilot, known = Pilot(HelmConfig(), config), ObstacleMap(config)
    verdict = Verdict("operator", (speed_m_s, 0.0, 0.0), 0.0, 0.0)
    rows: list[tuple[float, float, float]] = []
    why: list[str] = []
    waiting: list[tuple[int, Obstacles]] = []
    for index in range(round(duration_s / STEP_S)):
        t_ns = 1_000_000_000 + round(index * STEP_S * 1e9)
        p, v, q = flown.estimate()
        north_m, north_m_s = flown.truth()
        known.follow(p, t_ns)
        if index % _SENSOR_STEPS == 0:
            measured = max(start_m - north_m + vehicle.noise_m * rng.standard_normal(), 0.0)
            wall = Obstacle(distance_m=measured, ned_direction=(1.0, 0.0, 0.0))
            waiting.append((t_ns, Obstacles(obstacles=(wall,))))
        while waiting and waiting[0][0] <= t_ns - (_DELAY_NS if vehicle.noise_m else 0):
            capture_ns, message = waiting.pop(0)
            known.hear("obstacles/depth", message, capture_ns)
        telemetry = _telemetry(p, v, q, t_ns)
        if index == 0:
            pilot.reset(telemetry, t_ns)
        now = pilot.fly(verdict, telemetry, known.now(p, t_ns), t_ns)
        if now is None:
            raise RuntimeError("approach: got no setpoint, expected one in each step")
        flown.obey(now.local)
        rows.append((start_m - north_m, north_m_s, now.local.north_m_s))
        why.append(now.limited.why)
    distance, speed, setpoint = np.array(rows).T
    return Flight(distance, speed, setpoint, tuple(why))


def _telemetry(p: Vec3, v: Vec3, q: Quat, t_ns: int) -> Telemetry:
    return Telemetry(
        found=True,
        attitude=AttitudeSample(t_ns, q, (0.0, 0.0, 0.0)),
        position=PositionSample(t_ns, p, v),
        home_local_m=(0.0, 0.0, 0.0),
        mode="OFFBOARD",
        armed=True,
        in_air=True,
    )
