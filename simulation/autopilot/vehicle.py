"""The simulated vehicle without sockets: plant, estimate, control and modes advanced by one call a cycle."""

from __future__ import annotations

import math
import random
from collections import deque

from simulation.autopilot import battery as battery_model
from simulation.autopilot import plant
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.control import Controller, Limits
from simulation.autopilot.estimator import Estimator, Fault, Sensor
from simulation.autopilot.guidance import Guidance
from simulation.autopilot.manual import ManualFlight
from simulation.autopilot.modes import Mode, ModeMachine, Situation, Verdict
from simulation.autopilot.motion import AttitudeSetpoint, MotionSetpoint, Setpoint
from simulation.autopilot.noise import Wind
from simulation.autopilot.parameters import Parameters
from simulation.autopilot.plant import Airframe, PlantState, Vec3
from simulation.autopilot.sticks import StickReader

_NOISE_PERIOD_S = 0.02  # noise and gusts are slower than the cycle
_LIFTED_S = 0.1  # off the ground for this long: in the air
_LANDED_S = 1.0  # on the ground with little thrust for this long: landed
_LANDED_THRUST = 0.8  # of the hover thrust
_IDLE_SPEED = 0.15  # of the fastest rotor speed
_SLOW_START_S = 2.3  # PX4 was ready at 4.5 s, sometimes at 6.8 s


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
        self.t_s = 0.0
        """Autopilot time since the start, s."""
        yaw = config.start_yaw_rad
        self.truth = PlantState(ned_q_body=(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))
        """True motion."""
        self.battery = battery_model.full(config.battery_start)
        """Charge and load."""
        self._luck = random.Random(f"{config.seed}/takeoff")
        self._slow_start = random.Random(f"{config.seed}/ready")
        self._hover_n = self.airframe.mass_kg * plant.GRAVITY_M_S2
        period_s = max(_NOISE_PERIOD_S, dt_s)
        self._wind = Wind(config.wind_ned_m_s, config.gust_std_m_s, config.gust_time_s, period_s, config.seed)
        self._boot()

    def _boot(self) -> None:
        """Bring the autopilot, not the vehicle, to the state in which it starts."""
        config = self.config
        self.t_s = 0.0
        self.modes = ModeMachine(self.parameters)
        self.controller = Controller(self.airframe)
        self.landed = True
        """Whether the land detector says landed."""
        self.setpoint = MotionSetpoint()
        """The motion setpoint in force, for telemetry; all free while an attitude is steered."""
        self.attitude_setpoint: AttitudeSetpoint | None = None
        """The attitude setpoint in force, None while motion is steered."""
        slow = self._slow_start.random() < config.slow_start_probability
        self._ready_at_s = config.ready_after_s + (_SLOW_START_S if slow else 0.0)
        self._guidance = Guidance(self.parameters)
        self._manual = ManualFlight(self.parameters)
        self.pilot = StickReader(self.parameters)
        """The pilot's sticks."""
        self.ground_station_at_s = -math.inf
        """When a ground station was heard last, autopilot time, s."""
        self._outside, self._warning, self._link_lost = False, 0, False
        self._failures = deque(sorted(config.failures, key=lambda failure: failure.at_s))
        self._queue: deque[tuple[float, Setpoint]] = deque()
        self._offboard: Setpoint | None = None
        self._stream_at_s = -math.inf
        self._stream_of_motion = True
        self._contact_changed_s = 0.0
        self._lift_at_s: float | None = None
        self._stuck = False
        self._flown_mode, self._entries = Mode.HOLD, -1
        self._revision = -1
        self._noise_at_s = 0.0
        self.wind_m_s: Vec3 = self._wind.update()
        self.estimator = Estimator(config, max(_NOISE_PERIOD_S, self.dt_s), 1e-6 * self.parameters["EKF2_NOAID_TOUT"])
        """Errors of the estimate, and the sensors' faults."""
        n, e, _ = self.truth.ned_p_m
        self.estimator.ned_origin_m = (n, e, 0.0)
        self.estimate = self.estimator.estimate(self.truth, self.landed)
        """The autopilot's estimate of its motion."""

    def reboot(self) -> None:
        """Start the autopilot anew: clock, modes, estimate and links' state; parameters and the vehicle's place stay.

        The local frame begins where the vehicle stands now, as in PX4, whose estimator starts again too.
        """
        self._boot()

    def coast(self) -> None:
        """Advance the vehicle by `dt_s` while its autopilot is off: the rotors stop."""
        self.truth = plant.step(self.airframe, self.truth, (0.0, 0.0, 0.0, 0.0), self.dt_s, self.wind_m_s)

    @property
    def situation(self) -> Situation:
        """What the modes know of the vehicle now."""
        done = self.modes.mode is Mode.TAKEOFF and self._guidance.takeoff_done(self.estimate)
        ready = self.t_s >= self._ready_at_s
        pilot, estimator = self.pilot, self.estimator
        lost = pilot.lost(self.t_s)
        return Situation(
            self.t_s,
            ready,
            self.landed,
            self.t_s - self._stream_at_s,
            done,
            estimator.position_valid,
            estimator.height_valid,
            lost,
            not lost and pilot.moved(self.t_s),
            math.nan if lost else pilot.sticks.throttle,
            self._link_lost,
            self._warning,
            self._outside,
            self._stream_of_motion,
        )

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Receive an OFFBOARD setpoint; it acts after `setpoint_delay_s`, and only in OFFBOARD."""
        if not self.modes.stream_alive(self.situation):
            self._offboard = None  # what an earlier stream asked for must not be flown again
        self._stream_at_s = self.t_s
        self._stream_of_motion = isinstance(setpoint, MotionSetpoint)
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
            self.wind_m_s = self._wind.update()
            self._watch()
        if self._revision != self.parameters.revision:
            self._take_limits()
        self.estimate = self.estimator.estimate(self.truth, self.landed)
        while self._queue and self._queue[0][0] <= self.t_s:
            self._offboard = self._queue.popleft()[1]
        self.modes.update(self.situation)
        if self._entries != self.modes.entries:
            self._guidance.enter(self.modes.mode, self.estimate, self._flown_mode)
            self._manual.enter(self.estimate)
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

    def _watch(self) -> None:
        """What changes slowly: wind, errors of the estimate, failures of the configuration, fence, battery, link."""
        p = self.parameters
        self.wind_m_s = self._wind.update()
        while self._failures and self._failures[0].at_s <= self.t_s:
            failure = self._failures.popleft()
            self.estimator.faults[Sensor[failure.sensor.upper()]] = Fault[failure.kind.upper()]
        self.estimator.drift()
        n, e, d = self.estimate.ned_p_m
        across, above = p["GF_MAX_HOR_DIST"], p["GF_MAX_VER_DIST"]
        self._outside = self.estimator.position_valid and (0 < across < math.hypot(n, e) or 0 < above < -d)
        self._warning = battery_model.warning(self.battery, p)
        silence_s = self.t_s - self.ground_station_at_s
        self._link_lost = p["NAV_DLL_ACT"] > 0 and silence_s > p["COM_DL_LOSS_T"]

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
        if not self.modes.armed:
            self._lift_at_s = None
            self.controller.reset()
            self.attitude_setpoint = None
            return 0.0, 0.0, 0.0, 0.0
        asked = self._asked()
        if isinstance(asked, AttitudeSetpoint):
            self.setpoint, self.attitude_setpoint = MotionSetpoint(), asked
            self._lift_at_s = None if self.landed else -math.inf  # a motion setpoint in the air may climb at once
            return self._idle() if self._spooling_up() else self.controller.steer(self.estimate, asked, self.dt_s)
        self.setpoint, self.attitude_setpoint = asked, None
        if self.landed and not self._wants_lift():
            self._lift_at_s = None
            self.controller.reset()
            return self._idle()
        if self._lift_at_s is None:
            self._lift_at_s = self.t_s
        ramp_s = max(float(self.parameters["MPC_TKO_RAMP_T"]), 0.1)
        self.controller.climb_share = min((self.t_s - self._lift_at_s) / ramp_s, 1.0)
        return self.controller.update(self.estimate, self.setpoint, self.dt_s)

    def _asked(self) -> Setpoint:
        """The setpoint of the mode that flies."""
        mode = self.modes.mode
        if mode is Mode.OFFBOARD:
            return self._offboard or MotionSetpoint(ned_v_m_s=(0.0, 0.0, 0.0))
        if mode.manual:
            return self._manual.setpoint(mode, self.pilot.sticks, self.estimate, self.dt_s)
        return self._guidance.setpoint(mode, self.estimate, self.dt_s)

    def _idle(self) -> plant.Rotors:
        idle = _IDLE_SPEED * self.airframe.rotor_max_rad_s
        return idle, idle, idle, idle

    def _spooling_up(self) -> bool:
        return self.t_s - self.modes.armed_at_s < self.parameters["COM_SPOOLUP_TIME"]

    def _wants_lift(self) -> bool:
        """Whether the vehicle on the ground is asked to leave it, and its motors have spun up."""
        if self._spooling_up():
            return False
        if self.modes.mode is Mode.TAKEOFF:
            return not self._stuck
        if self.modes.mode is not Mode.OFFBOARD and not self.modes.mode.manual:
            return False
        down, sink = self.setpoint.ned_p_m[2], self.setpoint.ned_v_m_s[2]
        return down < self.estimate.ned_p_m[2] - 0.3 or sink < -0.1 or self.setpoint.ned_a_m_s2[2] < -1.0

    def _detect_landing(self) -> None:
        pressed = self.truth.on_ground and (
            self.controller.thrust_fraction * self.controller.thrust_max_n < _LANDED_THRUST * self._hover_n
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
        rotors_w = 0.0
        if self.modes.armed:
            load = self.controller.thrust_fraction * self.controller.thrust_max_n / self._hover_n
            rotors_w = self.config.hover_power_w * max(load, 0.05) ** 1.5
        self.battery = battery_model.drained(self.battery, self.config.battery_wh, rotors_w, self.dt_s)
