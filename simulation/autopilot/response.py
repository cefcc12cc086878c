"""Step responses of the simulated vehicle, measured as PX4's were, and the figures that PX4 showed.

The vehicle takes off and hovers in OFFBOARD; then the setpoint steps, and its true motion is recorded at each cycle.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.control import HOVER_THRUST
from simulation.autopilot.modes import Mode, Verdict
from simulation.autopilot.motion import FREE, NAN, AttitudeSetpoint, MotionSetpoint, Setpoint, heading
from simulation.autopilot.plant import PlantState, Vec3, down_axis
from simulation.autopilot.vehicle import SimulatedVehicle
from simulation.px4_steps import STEPS

DT_S = 0.004
SETTLED_S = 5.0
"""How long a speed is flown before the vehicle is told to stop, s."""
_HEIGHT_M = 20.0
_TAKEOFF_S, _HOVER_S = 22.0, 8.0
_SPEED_M_S, _ROLL_RAD = 2.0, math.radians(10.0)
_DEFAULT, _LOW = 1.0, 0.1  # drag of PX4's built-in quadrotor, and one near a real one, N per m/s
_SHARES = {"t10_s": 0.10, "t50_s": 0.50, "t63_s": 0.63, "t90_s": 0.90}

States = list[PlantState]


@dataclass(frozen=True)
class Band:
    """What PX4 showed: one reading, or the range of several."""

    low: float
    """Least."""
    high: float
    """Greatest; infinite where PX4's figure is a lower bound."""

    @property
    def nominal(self) -> float:
        """The middle, or the lower bound."""
        return (self.low + self.high) / 2.0 if math.isfinite(self.high) else self.low

    def deviation(self, value: float) -> float:
        """Signed distance to the band by its nearer end, relative; 0 inside."""
        if self.low <= value <= self.high:
            return 0.0
        end = self.low if value < self.low else self.high
        return (value - end) / end


def _bands(step: str) -> dict[str, Band]:
    """PX4's readings of a step."""
    return {n: Band(*r) if isinstance(r, tuple) else Band(r, r) for n, r in STEPS[step].items()}


def velocity(north_m_s: float) -> MotionSetpoint:
    """A velocity to the north, with height and heading held."""
    return MotionSetpoint(ned_p_m=(NAN, NAN, -_HEIGHT_M), ned_v_m_s=(north_m_s, 0.0, NAN), yaw_rad=0.0)


@dataclass(frozen=True)
class StepCase:
    """One step of the setpoint, and what PX4 did."""

    name: str
    """Ending of the figures' names."""
    doc: str
    """The step in words."""
    drag_n_s_m: float
    """Drag, N per m/s."""
    duration_s: float
    """How long the response is watched, s."""
    setpoint: Setpoint
    """What is asked from the step on."""
    response: Callable[[PlantState], float]
    """What answers: speed, m/s, or angle, rad."""
    size: float
    """Height of the step, in the response's unit, signed."""
    px4: Mapping[str, Band]
    """PX4's figures: times to a share of the step (`t10_s` …) and others by name."""
    before: MotionSetpoint | None = None
    """What is flown for 5 s before the step; None for the hover."""


CASES: tuple[StepCase, ...] = (
    StepCase(
        "start_default",
        "0 to 2 m/s, drag 1 N per m/s",
        _DEFAULT,
        9.0,
        velocity(_SPEED_M_S),
        lambda s: s.ned_v_m_s[0],
        _SPEED_M_S,
        _bands("start_default"),
    ),
    StepCase(
        "stop_default",
        "2 to 0 m/s, drag 1 N per m/s",
        _DEFAULT,
        6.0,
        velocity(0.0),
        lambda s: s.ned_v_m_s[0],
        -_SPEED_M_S,
        _bands("stop_default"),
        before=velocity(_SPEED_M_S),
    ),
    StepCase(
        "start_low",
        "0 to 2 m/s, drag 0.1 N per m/s",
        _LOW,
        9.0,
        velocity(_SPEED_M_S),
        lambda s: s.ned_v_m_s[0],
        _SPEED_M_S,
        _bands("start_low"),
    ),
    StepCase(
        "stop_low",
        "2 to 0 m/s, drag 0.1 N per m/s",
        _LOW,
        6.0,
        velocity(0.0),
        lambda s: s.ned_v_m_s[0],
        -_SPEED_M_S,
        _bands("stop_low"),
        before=velocity(_SPEED_M_S),
    ),
    StepCase(
        "climb",
        "up 1 m/s",
        _DEFAULT,
        4.0,
        MotionSetpoint(ned_v_m_s=(0.0, 0.0, -1.0), yaw_rad=0.0),
        lambda s: -s.ned_v_m_s[2],
        1.0,
        _bands("climb"),
    ),
    StepCase(
        "yaw",
        "yaw 90 degrees",
        _DEFAULT,
        3.0,
        MotionSetpoint(ned_p_m=(NAN, NAN, -_HEIGHT_M), ned_v_m_s=(0.0, 0.0, NAN), yaw_rad=math.pi / 2),
        lambda s: heading(s.ned_q_body),
        math.pi / 2,
        _bands("yaw"),
    ),
    StepCase(
        "roll",
        "roll 10 degrees",
        _DEFAULT,
        1.5,
        AttitudeSetpoint((math.cos(_ROLL_RAD / 2), math.sin(_ROLL_RAD / 2), 0.0, 0.0), FREE, HOVER_THRUST),
        lambda s: _roll(s),
        _ROLL_RAD,
        _bands("roll"),
    ),
)


def configured(drag_n_s_m: float, seed: int | None = None, wind_ned_m_s: Vec3 = (0.0, 0.0, 0.0)) -> AutopilotSimConfig:
    """Configuration of a measurement.

    Args:
        drag_n_s_m: drag, N per m/s.
        seed: of the estimate's errors at their default size; None for an estimate without errors.
        wind_ned_m_s: mean velocity of the air, NED, m/s.
    """
    parameters: dict[str, int | float] = {"MIS_TAKEOFF_ALT": _HEIGHT_M, "COM_DISARM_PRFLT": 0.0}
    if seed is not None:
        return AutopilotSimConfig(drag_n_s_m=drag_n_s_m, wind_ned_m_s=wind_ned_m_s, seed=seed, parameters=parameters)
    return AutopilotSimConfig(
        drag_n_s_m=drag_n_s_m,
        wind_ned_m_s=wind_ned_m_s,
        position_noise_m=0.0,
        velocity_noise_m_s=0.0,
        climb_noise_m_s=0.0,
        attitude_noise_rad=0.0,
        parameters=parameters,
    )


def hovering(config: AutopilotSimConfig) -> SimulatedVehicle:
    """A vehicle that has taken off to 20 m and hovers in OFFBOARD.

    Raises:
        RuntimeError: it refused a command.
    """
    vehicle = SimulatedVehicle(config, DT_S)
    record(vehicle, config.ready_after_s + 0.1, None)
    verdicts = [vehicle.arm(), vehicle.command(Mode.TAKEOFF)]
    record(vehicle, _TAKEOFF_S, None)
    vehicle.take_setpoint(velocity(0.0))
    verdicts.append(vehicle.command(Mode.OFFBOARD))
    if any(verdict is not Verdict.ACCEPTED for verdict in verdicts):
        raise RuntimeError(f"step response: arm, takeoff, OFFBOARD gave {[v.name for v in verdicts]}")
    record(vehicle, _HOVER_S, velocity(0.0))
    return vehicle


def record(vehicle: SimulatedVehicle, duration_s: float, setpoint: Setpoint | None) -> States:
    """True states while a setpoint is streamed, the first one at the moment of the step."""
    states = [vehicle.truth]
    for _ in range(round(duration_s / DT_S)):
        if setpoint is not None:
            vehicle.take_setpoint(setpoint)
        vehicle.step()
        states.append(vehicle.truth)
    return states


def fly(case: StepCase, vehicle: SimulatedVehicle) -> States:
    """True states from the step on.

    Args:
        case: the step.
        vehicle: one that hovers, of the case's drag; it is left as it is.
    """
    flown = copy.deepcopy(vehicle)
    if case.before is not None:
        record(flown, SETTLED_S, case.before)
    return record(flown, case.duration_s, case.setpoint)


def shares(case: StepCase, states: States) -> list[float]:
    """The response at each cycle as a share of the step, 0 at its beginning.

    A stop's step is the speed that the vehicle had: with much drag it has not reached the 2 m/s.
    """
    values = [case.response(state) for state in states]
    size = -values[0] if case.before is not None else case.size
    return [(value - values[0]) / size for value in values]


def measured(case: StepCase, states: States) -> dict[str, float]:
    """The figures that PX4 has for this step, of these states."""
    response = shares(case, states)
    return {name: _figure(name, response, states) for name in case.px4}


def crossing_s(response: list[float], share: float) -> float:
    """Time at which a response first reaches a share of its step, s; infinite when it never does."""
    before = 0.0
    for index, now in enumerate(response):
        if now >= share:
            return (index - (now - share) / (now - before)) * DT_S if index else 0.0
        before = now
    return math.inf


def largest_tilt_deg(states: States) -> float:
    """Largest angle between the body's z axis and the vertical, degrees."""
    return max(math.degrees(math.acos(min(down_axis(s.ned_q_body)[2], 1.0))) for s in states)


def fitted_loop(case: StepCase, mass_kg: float = 1.0) -> list[float]:
    """Speed at each cycle of the loop that fits PX4's horizontal steps within 2 to 4 %, m/s.

    It starts at rest and flies `before` first. Acceleration setpoint 1.8 e + 0.4 ∫e − 0.2 dv/dt, through two lags of
    0.14 s in series, then dv/dt = a − (k_drag/m) v.

    Raises:
        TypeError: the step is no velocity.
    """
    parts = [(case.before, SETTLED_S)] if case.before is not None else []
    speed = integral = lag_1 = lag_2 = change = 0.0
    out: list[float] = []
    for setpoint, duration_s in [*parts, (case.setpoint, case.duration_s)]:
        if not isinstance(setpoint, MotionSetpoint):
            raise TypeError(f"{case.name}: the fitted loop flies velocities only")
        target = setpoint.ned_v_m_s[0]
        out = [speed]
        for _ in range(round(duration_s / DT_S)):
            error = target - speed
            integral += error * DT_S
            wanted = 1.8 * error + 0.4 * integral - 0.2 * change
            lag_1 += (wanted - lag_1) * DT_S / 0.14
            lag_2 += (lag_1 - lag_2) * DT_S / 0.14
            change = lag_2 - case.drag_n_s_m / mass_kg * speed
            speed += change * DT_S
            out.append(speed)
    return out


def _figure(name: str, response: list[float], states: States) -> float:
    if name in _SHARES:
        return crossing_s(response, _SHARES[name])
    return {
        "overshoot_percent": lambda: 100.0 * (max(response) - 1.0),
        "tilt_deg": lambda: largest_tilt_deg(states),
        "speed_2s_m_s": lambda: states[round(2.0 / DT_S)].ned_v_m_s[0],
        "speed_5s_m_s": lambda: states[round(5.0 / DT_S)].ned_v_m_s[0],
        "stop_distance_m": lambda: max(s.ned_p_m[0] for s in states) - states[0].ned_p_m[0],
        "yaw_rate_deg_s": lambda: max(math.degrees(s.body_rates_rad_s[2]) for s in states),
    }[name]()


def _roll(state: PlantState) -> float:
    w, x, y, z = state.ned_q_body
    return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
