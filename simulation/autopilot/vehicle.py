"""The simulated vehicle without sockets: plant, estimate, control and modes advanced by one call a cycle."""

from __future__ import annotations

import math
import random
from collections import deque
from typing import NamedTuple

from simulation.autopilot import plant
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.control import Controller, Estimate, Limits, MotionSetpoint
from simulation.autopilot.guidance import Guidance
from simulation.autopilot.modes import Mode, ModeMachine, Situation, Verdict
from simulation.autopilot.noise import GaussMarkov
from simulation.autopilot.parameters import Parameters
from simulation.autopilot.plant import Airframe, PlantState, Vec3

_NOISE_PERIOD_S = 0.02  # noise and gusts are slower than the cycle
_LIFTED_S = 0.1  # off the ground for this long: in the air
_LANDED_S = 1.0  # on the ground with little thrust for this long: landed
_LANDED_THRUST = 0.8  # of the hover thrust
_IDLE_SPEED = 0.15  # of the fastest rotor speed


class Battery(NamedTuple):
    """Charge and load of the battery."""

    fraction: float
    """Remaining charge, 0 to 1."""
    voltage_v: float
    """Terminal voltage, V."""
    current_a: float
    """Current drawn, A."""


class SimulatedVehicle:
    """A multirotor with its autopilot; deterministic for a seed and a sequence of calls.

    Args:
        config: vehicle, weather, noise, parameters.
        dt_s: duration of a cycle, s (at most 4 ms keeps to the fitted response).
    """

    def __init__(self, config: AutopilotSimConfig, dt_s: float = 0.004):
        self.config = config
        self.dt_s = dt_s
        self.parameters = Parameters(config.parameters)
        self.airframe = Airframe(mass_kg=config.mass_kg, drag_n_s_m=config.drag_n_s_m)
        self.modes = ModeMachine(self.parameters)
        self.controller = Controller(self.airframe)
        self.t_s = 0.0
        """Autopilot time since the start, s."""
        yaw = config.start_yaw_rad
        self.truth = PlantState(ned_q_body=(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))
        """True motion."""
        self.landed = True
        """Whether the land detector says landed."""
        self.setpoint = MotionSetpoint()
        """The setpoint in force, for telemetry."""
        self.battery = Battery(config.battery_start, 16.8, 0.0)
        self._guidance = Guidance(self.parameters)
        self._queue: deque[tuple[float, MotionSetpoint]] = deque()
        self._offboard: MotionSetpoint | None = None
        self._stream_at_s = -math.inf
        self._contact_changed_s = 0.0
        self._lift_at_s: float | None = None
        self._stuck = False
        self._flown_mode, self._entries = Mode.HOLD, -1
        self._hover_n = self.airframe.mass_kg * plant.GRAVITY_M_S2
        self._thrust_max_n = 4.0 * self.airframe.thrust_n_s2 * self.airframe.rotor_max_rad_s**2
        self._revision = -1
        self._make_noise()
        self.estimate = self._estimate()
        """The autopilot's estimate of its motion."""

    @property
    def situation(self) -> Situation:
        """What the modes know of the vehicle now."""
        done = self.modes.mode is Mode.TAKEOFF and self._guidance.takeoff_done(self.estimate)
        ready = self.t_s >= self.config.ready_after_s
        return Situation(self.t_s, ready, self.landed, self.t_s - self._stream_at_s, done)

    def take_setpoint(self, setpoint: MotionSetpoint) -> None:
        """Receive an OFFBOARD setpoint; it acts after `setpoint_delay_s`, and only in OFFBOARD."""
        if not self.modes.stream_alive(self.situation):
            self._offboard = None  # what an earlier stream asked for must not be flown again
        self._stream_at_s = self.t_s
        self._queue.append((self.t_s + self.config.setpoint_delay_s, setpoint))

    def command(self, mode: Mode, takeoff_height_m: float | None = None) -> Verdict:
        """Command a mode.

        Args:
            mode: the mode.
            takeoff_height_m: for a takeoff, height above home, m; None for MIS_TAKEOFF_ALT.
        """
        if mode is Mode.TAKEOFF:
            default = float(self.parameters["MIS_TAKEOFF_ALT"])
            self._guidance.takeoff_height_m = default if takeoff_height_m is None else takeoff_height_m
            self._stuck = self.landed and self._luck.random() < self.config.takeoff_failure_probability
        return self.modes.command(mode, self.situation)

    def arm(self, force: bool = False) -> Verdict:
        """Arm the motors; `force` skips the checks."""
        return self.modes.arm(self.situation, force)

    def disarm(self, force: bool = False) -> Verdict:
        """Stop the motors; refused in the air unless `force`."""
        return self.modes.disarm(self.situation, force)

    def step(self) -> None:
        """Advance by `dt_s`: noise, estimate, modes, control, plant."""
        dt_s = self.dt_s
        self.t_s += dt_s
        if self.t_s >= self._noise_at_s:
            self._noise_at_s += _NOISE_PERIOD_S
            self._weather()
        if self._revision != self.parameters.revision:
            self._take_limits()
        self.estimate = self._estimate()
        while self._queue and self._queue[0][0] <= self.t_s:
            self._offboard = self._queue.popleft()[1]
        self.modes.update(self.situation)
        if self._entries != self.modes.entries:
            self._guidance.enter(self.modes.mode, self.estimate, self._flown_mode)
            self._entries, self._flown_mode = self.modes.entries, self.modes.mode
        rotors = self._rotors()
        self.truth = plant.step(self.airframe, self.truth, rotors, dt_s, self.wind_m_s)
        self._detect_landing()
        self._drain()

    def body_acceleration(self) -> Vec3:
        """What an ideal accelerometer reads: specific force in the body frame, m/s² (−g along z at rest)."""
        w, x, y, z = self.truth.ned_q_body
        fn, fe, fd = self.truth.ned_a_m_s2
        fd -= plant.GRAVITY_M_S2
        return (
            (1 - 2 * (y * y + z * z)) * fn + 2 * (x * y + w * z) * fe + 2 * (x * z - w * y) * fd,
            2 * (x * y - w * z) * fn + (1 - 2 * (x * x + z * z)) * fe + 2 * (y * z + w * x) * fd,
            2 * (x * z + w * y) * fn + 2 * (y * z - w * x) * fe + (1 - 2 * (x * x + y * y)) * fd,
        )

    def _make_noise(self) -> None:
        config, dt_s = self.config, max(_NOISE_PERIOD_S, self.dt_s)

        def process(name: str, std: float, time_s: float) -> GaussMarkov:
            return GaussMarkov(std, time_s, dt_s, random.Random(f"{config.seed}/{name}"))

        self._luck = random.Random(f"{config.seed}/takeoff")
        gust = config.gust_std_m_s
        self._gusts = [process(f"gust{i}", s, config.gust_time_s) for i, s in enumerate((gust, gust, gust / 2))]
        time_s = config.noise_time_s
        self._p_noise = [process(f"position{i}", config.position_noise_m, time_s) for i in range(3)]
        self._v_noise = [process(f"velocity{i}", config.velocity_noise_m_s, time_s) for i in range(2)]
        self._v_noise.append(process("climb", config.climb_noise_m_s, config.climb_noise_time_s))
        self._q_noise = [process(f"attitude{i}", config.attitude_noise_rad, time_s) for i in range(3)]
        self._noise_at_s = 0.0
        self._weather()

    def _weather(self) -> None:
        """Update gusts and estimate errors."""
        mean = self.config.wind_ned_m_s
        gusts = [g.update() for g in self._gusts]
        self.wind_m_s: Vec3 = (mean[0] + gusts[0], mean[1] + gusts[1], mean[2] + gusts[2])
        for process in (*self._p_noise, *self._v_noise, *self._q_noise):
            process.update()

    def _estimate(self) -> Estimate:
        truth = self.truth
        pn, pe, pd = truth.ned_p_m
        vn, ve, vd = truth.ned_v_m_s
        w, x, y, z = truth.ned_q_body
        p, v, q = self._p_noise, self._v_noise, self._q_noise
        a, b, c = 0.5 * q[0].value, 0.5 * q[1].value, 0.5 * q[2].value  # a small rotation: its norm needs no repair
        quat = (
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
        )
        return Estimate(
            (pn + p[0].value, pe + p[1].value, pd + p[2].value),
            # a vehicle that stands on the ground knows that it stands
            (vn + v[0].value, ve + v[1].value, vd + v[2].value) if not self.landed else (vn, ve, vd),
            quat,
            truth.body_rates_rad_s,
        )

    def _take_limits(self) -> None:
        p = self.parameters
        self._revision = p.revision
        self.controller.limits = Limits(
            speed_m_s=float(p["MPC_XY_VEL_MAX"]),
            climb_m_s=float(p["MPC_Z_VEL_MAX_UP"]),
            sink_m_s=float(p["MPC_Z_VEL_MAX_DN"]),
            tilt_rad=math.radians(min(max(p["MPC_TILTMAX_AIR"], 5.0), 75.0)),
        )

    def _rotors(self) -> plant.Rotors:
        """Rotor commands of this cycle."""
        mode = self.modes.mode
        if not self.modes.armed:
            self._lift_at_s = None
            self.controller.reset()
            return 0.0, 0.0, 0.0, 0.0
        if mode is Mode.OFFBOARD:
            self.setpoint = self._offboard or MotionSetpoint(ned_v_m_s=(0.0, 0.0, 0.0))
        else:
            self.setpoint = self._guidance.setpoint(mode, self.estimate, self.dt_s)
        if self.landed and not self._wants_lift():
            self._lift_at_s = None
            self.controller.reset()
            idle = _IDLE_SPEED * self.airframe.rotor_max_rad_s
            return idle, idle, idle, idle
        if self._lift_at_s is None:
            self._lift_at_s = self.t_s
        ramp_s = max(float(self.parameters["MPC_TKO_RAMP_T"]), 0.1)
        self.controller.climb_share = min((self.t_s - self._lift_at_s) / ramp_s, 1.0)
        return self.controller.update(self.estimate, self.setpoint, self.dt_s)

    def _wants_lift(self) -> bool:
        """Whether the vehicle on the ground is asked to leave it, and its motors have spun up."""
        if self.t_s - self.modes.armed_at_s < self.parameters["COM_SPOOLUP_TIME"]:
            return False
        if self.modes.mode is Mode.TAKEOFF:
            return not self._stuck
        if self.modes.mode is not Mode.OFFBOARD:
            return False
        down, sink = self.setpoint.ned_p_m[2], self.setpoint.ned_v_m_s[2]
        return down < self.estimate.ned_p_m[2] - 0.3 or sink < -0.1 or self.setpoint.ned_a_m_s2[2] < -1.0

    def _detect_landing(self) -> None:
        pressed = self.truth.on_ground and (
            self.controller.thrust_fraction * self._thrust_max_n < _LANDED_THRUST * self._hover_n
        )
        if pressed is self.landed:
            self._contact_changed_s = self.t_s
            return
        if self.landed and self.truth.on_ground:
            self._contact_changed_s = self.t_s
        elif self.t_s - self._contact_changed_s >= (_LIFTED_S if self.landed else _LANDED_S):
            self.landed = pressed
            self._contact_changed_s = self.t_s

    def _drain(self) -> None:
        power_w = 5.0
        if self.modes.armed:
            load = self.controller.thrust_fraction * self._thrust_max_n / self._hover_n
            power_w += self.config.hover_power_w * max(load, 0.05) ** 1.5
        fraction = max(self.battery.fraction - power_w * self.dt_s / 3600.0 / self.config.battery_wh, 0.0)
        voltage = 14.0 + 2.8 * fraction  # four lithium cells, 3.5 V to 4.2 V each
        self.battery = Battery(fraction, voltage, power_w / voltage)
