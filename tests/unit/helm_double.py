"""A point-mass vehicle behind helm's link interface: for unit tests of helm, never for system tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from common.config import Config
from common.messages import CameraInfo, Command, HelmStatus, Message, Obstacle, Obstacles, Request, Setpoint, Track
from common.node import CommandCall, Output, ScriptedRun
from onboard.helm.actions import Action, ActionResult, Kind
from onboard.helm.dialect.base import Dialect, Role
from onboard.helm.dialect.px4 import PX4
from onboard.helm.node import HelmNode
from onboard.helm.setpoint import LocalSetpoint
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry

STEP_NS = 20_000_000
_LAG_S = 0.3
START_NS = 10_000_000_000
SECTIONS = {
    "bus": "common.session:BusConfig",
    "helm": "onboard.helm.config:HelmConfig",
    "limiter": "onboard.limiter.config:LimiterConfig",
}
INFO = CameraInfo(
    camera="down",
    width=640,
    height=480,
    fx_px=500,
    fy_px=500,
    cx_px=320,
    cy_px=240,
    body_q_camera=(1, 0, 0, 0),
    body_p_camera_m=(0, 0, 0),
    rate_hz=20,
)


@dataclass
class VehicleDouble:
    """Flies as told: velocity follows the setpoint with a lag of 0.3 s, modes change at once when commanded.

    It speaks the dialect given: its modes, its takeoff and what it does when setpoints stay away.
    """

    dialect: Dialect = PX4
    p: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    v: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    yaw: float = 0.0
    mode: str = ""
    armed: bool = False
    silent: bool = False
    frozen_estimate: bool = False
    critical: bool = False
    takeoffs_that_fail: int = 0
    refuses: tuple[Kind, ...] = ()
    ignores: tuple[Kind, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)
    home: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    battery: float = 0.9
    t_ns: int = START_NS
    sent: list[LocalSetpoint] = field(default_factory=list)
    sent_ns: list[int] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    told: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    _climb_to_m: float | None = None
    _results: list[ActionResult] = field(default_factory=list)
    _heard: Telemetry = field(default_factory=Telemetry)
    _closed_with_hold: bool | None = None

    def __post_init__(self) -> None:
        self.mode = self.mode or self.mode_for(Role.HOLD)
        for name in self.dialect.parameters:  # as they come from the factory, all different from what helm wants
            self.parameters.setdefault(name, 0.5)

    def mode_for(self, role: Role) -> str:
        """A mode that has a role, the dialect's own control mode for that."""
        if role is Role.CONTROL:
            return self.dialect.control_mode
        return next(mode for mode, roles in self.dialect.mode_roles.items() if role in roles)

    @property
    def height_m(self) -> float:
        return -self.p[2]

    def advance(self, t_ns: int) -> None:
        """Move to t."""
        dt = (t_ns - self.t_ns) / 1e9
        self.t_ns = t_ns
        wanted = [0.0, 0.0, 0.0]
        roles = self.dialect.roles(self.mode)
        if self._climb_to_m is not None and Role.TAKEOFF in roles and self.armed:
            wanted[2] = -min(1.0, self._climb_to_m - self.height_m)
            if self.height_m > self._climb_to_m - 0.1:
                self._climb_to_m = None
                if self.dialect.after_takeoff:
                    self.mode = self.mode_for(Role.HOLD)
        elif Role.CONTROL in roles and self.sent:
            if t_ns - self.sent_ns[-1] < 1_000_000_000:
                last = self.sent[-1]
                wanted = self._asked(last)
                self.yaw += last.yaw_rate_rad_s * dt
            elif self.dialect.after_silence:
                self.mode = self.mode_for(Role.HOLD)
        elif Role.LAND in roles:
            wanted[2] = 0.7
        for i in range(3):
            self.v[i] += (wanted[i] - self.v[i]) * min(dt / _LAG_S, 1.0) if self.armed else -self.v[i]
            self.p[i] += self.v[i] * dt
        if self.p[2] >= 0.0 and self.v[2] >= 0.0:
            self.p[2] = self.v[2] = 0.0
            if Role.LAND in self.dialect.roles(self.mode):
                self.armed = False

    def _asked(self, setpoint: LocalSetpoint) -> list[float]:
        """Velocity that the dialect's own message asks for, or that gives the acceleration which it asks for."""
        fields = self.dialect.setpoint(setpoint)
        mask = fields["type_mask"]
        down = fields["vz"] if mask & 0x004 else fields["z"] - self.p[2]
        if not mask & 0x040:
            return [self.v[0] + _LAG_S * fields["afx"], self.v[1] + _LAG_S * fields["afy"], down]
        return [fields["vx"], fields["vy"], down]

    def poll(self, t_ns: int) -> Telemetry:
        if self.silent:
            self._heard = replace(self._heard, attitudes=())
            return self._heard
        stamp_ns = self._heard.attitude.stamp_ns if self.frozen_estimate and self._heard.attitude else t_ns - 5_000_000
        half = self.yaw / 2
        attitude = AttitudeSample(stamp_ns, (math.cos(half), 0.0, 0.0, math.sin(half)), (0.0, 0.0, 0.0))
        x, y, z = self.p
        vx, vy, vz = self.v
        self._heard = Telemetry(
            found=True,
            dialect=self.dialect,
            attitude=attitude,
            attitudes=(attitude,),
            position=PositionSample(stamp_ns, (x, y, z), (vx, vy, vz)),
            home_local_m=self.home,
            mode=self.mode,
            mode_ns=t_ns,
            armed=self.armed,
            armed_known=True,
            in_air=self.height_m > 0.05,
            landed_known=True,
            ready=True,
            critical=self.critical,
            battery_fraction=self.battery,
            heard_ns=t_ns,
        )
        return self._heard

    def send(self, setpoint: LocalSetpoint) -> bool:
        self._climb_to_m = None  # a setpoint ends a takeoff
        self.sent.append(setpoint)
        self.sent_ns.append(self.t_ns)
        return True

    def tell(self, name: str, fields: Mapping[str, Any]) -> bool:
        self.told.append((name, dict(fields)))
        return True

    def submit(self, action: Action) -> None:
        self.actions.append(action)
        if action.kind in self.ignores:
            self._results.append(ActionResult(action, True))
        elif action.kind in self.refuses:
            self._results.append(ActionResult(action, False, "DENIED", dict(self.parameters)))
        else:
            self._results.append(self._act(action))

    def _act(self, action: Action) -> ActionResult:
        if action.kind is Kind.PARAMETERS:
            if action.write:
                self.parameters.update(action.parameters)
            return ActionResult(action, True, "", {k: self.parameters[k] for k in action.parameters})
        if action.kind is Kind.ARM:
            self.armed = True
        elif action.kind is Kind.DISARM:
            self.armed = False
        elif action.kind is Kind.TAKEOFF and self.takeoffs_that_fail > 0:
            self.takeoffs_that_fail -= 1
        else:
            self.mode = self.mode_for(Role(action.kind.value))
            if action.kind is Kind.TAKEOFF:
                self._climb_to_m = self.parameters.get(self.dialect.takeoff_parameter, action.height_m)
        return ActionResult(action, True)

    def results(self) -> list[ActionResult]:
        out, self._results = self._results, []
        return out

    def metrics(self) -> dict[str, float]:
        return {}

    def close(self, hold: bool) -> None:
        self._closed_with_hold = hold


class Desk:
    """A helm node on a vehicle double, stepped at 50 Hz of made-up time."""

    def __init__(self, vehicle: VehicleDouble | None = None, camera: bool = True, **helm: object):
        self.vehicle = vehicle or VehicleDouble()
        limiter = helm.pop("limiter", {})
        self.node = HelmNode(Config({"helm": helm, "limiter": limiter}, SECTIONS), "helm", self.vehicle)
        self.run = ScriptedRun(self.node)
        self.t_ns = START_NS
        self.camera = camera
        self.pursuit: Request | None = None
        self.operator: Request | None = None
        self.approach: Request | None = None
        self.search: Request | None = None
        self.follow: Request | None = None
        self.tracking: str | None = None
        self.obstacles: list[Obstacle] | None = None
        self.setpoints: list[Setpoint] = []
        self.outputs: list[Output] = []
        self.status: HelmStatus | None = None

    @property
    def state(self) -> str:
        return self.node.flight.state.value

    @property
    def counters(self) -> dict[str, int]:
        return self.node.flight.machine.counters

    def feed(self, topic: str, message: Message) -> None:
        self.run.feed(topic, message, self.t_ns)

    def step(self) -> list[Output]:
        self.t_ns += STEP_NS
        self.vehicle.advance(self.t_ns)
        if self.camera:
            self.feed("camera/down/info", INFO)
        if self.pursuit is not None:
            self.feed("helm/request/pursuit", self.pursuit)
        if self.operator is not None:
            self.feed("helm/request/operator", self.operator)
        if self.follow is not None:
            self.feed("helm/request/follow", self.follow)
        if self.approach is not None:
            self.feed("helm/request/approach", self.approach)
        if self.search is not None:
            self.feed("helm/request/search", self.search)
        if self.tracking is not None:
            self.feed("pursuit/track", Track(state="tracking" if self.tracking == "tracking" else "lost"))
        if self.obstacles is not None:
            self.feed("obstacles/depth", Obstacles(obstacles=tuple(self.obstacles)))
        outputs = self.run.step(self.t_ns)
        for output in outputs:
            if isinstance(output.message, Setpoint):
                self.setpoints.append(output.message)
            elif isinstance(output.message, HelmStatus):
                self.status = output.message
        self.outputs = outputs
        return outputs

    def go(self, seconds: float, until: str | None = None) -> bool:
        for _ in range(round(seconds * 50)):
            self.step()
            if until is not None and self.state == until:
                return True
        return until is None

    def call(self, name: str, **fields: object) -> CommandCall:
        call, _ = self.run.call(f"helm/do/{name}", Command(**fields), self.t_ns)  # type: ignore[arg-type]
        return call

    def fly(self, height_m: float = 4.0) -> Desk:
        """Take off into hold."""
        self.go(1.0)
        self.call("takeoff", height_m=height_m)
        if not self.go(20.0, until="hold"):
            raise RuntimeError(f"no takeoff: {self.state}, {self.node.flight.machine.reason}")
        self.go(2.0)
        return self

    def chase(self, vector: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Desk:
        """Start a chase that asks for a velocity in NED."""
        self.pursuit, self.tracking = Request(frame="ned", vector=vector), "tracking"
        self.step()
        self.call("chase")
        return self
