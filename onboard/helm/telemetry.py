"""What the autopilot says, decoded: MAVLink messages as JSON in, one snapshot for the control loop out."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any

from common.clock import ClockMap
from common.messages import Quat, Vec3
from onboard.helm.dialect.base import UNKNOWN, Dialect, Role

LINK_AGED_S = 1.0
"""Without telemetry for this long, estimates are stale, s."""
LINK_LOST_S = 3.0
"""Without telemetry for this long, the autopilot counts as lost, s (as MAVSDK counts)."""

_FORCE_AGED_NS = 100_000_000  # by arrival; at 50 Hz five of them have stayed away

_ACCELEROMETERS = 0b111  # of HIGHRES_IMU's fields_updated: without them its accelerations are old, or zeros
_ARMED_FLAG = 128
_CRITICAL = 5
_AUTOPILOT_INVALID = 8
_LANDED = {1: False, 2: True, 3: True, 4: True}


@dataclass(frozen=True)
class AttitudeSample:
    """One ATTITUDE_QUATERNION."""

    stamp_ns: int
    """When it was true, vehicle clock, ns."""
    ned_q_body: Quat
    """Attitude."""
    body_rates_rad_s: Vec3
    """Angular velocity in the body frame (FRD), rad/s."""
    body_f_m_s2: Vec3 | None = None
    """Specific force in the body frame (FRD), m/s²; None when the accelerometers were not told lately."""

    @property
    def yaw_rad(self) -> float:
        """Heading from north, clockwise, rad."""
        w, x, y, z = self.ned_q_body
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@dataclass(frozen=True)
class PositionSample:
    """One LOCAL_POSITION_NED, in the autopilot's local frame (not from home)."""

    stamp_ns: int
    """When it was true, vehicle clock, ns."""
    local_p_m: Vec3
    """Position from the local origin, NED, m."""
    ned_v_m_s: Vec3
    """Velocity, NED, m/s."""


@dataclass(frozen=True)
class Telemetry:
    """All that helm knows of the autopilot at one instant."""

    found: bool = False
    """An autopilot has been seen on this link."""
    dialect: Dialect = UNKNOWN
    """What it speaks."""
    unfit: str = ""
    """Why helm cannot fly what it hears; empty when it can, or hears nothing."""
    attitude: AttitudeSample | None = None
    """Newest attitude."""
    attitudes: tuple[AttitudeSample, ...] = ()
    """Every attitude since the last look, oldest first."""
    position: PositionSample | None = None
    """Newest position and velocity."""
    home_local_m: Vec3 | None = None
    """Home in the local frame, NED, m."""
    mode: str = ""
    """Flight mode; empty before the first heartbeat."""
    mode_ns: int = 0
    """When the mode was last reported, vehicle clock, ns."""
    armed: bool = False
    """Motors armed."""
    armed_known: bool = False
    """Whether a heartbeat has said so, either way."""
    in_air: bool = False
    """The autopilot reports flight."""
    landed_known: bool = False
    """Whether it has said so, either way."""
    ready: bool = False
    """Its own pre-arm checks pass."""
    critical: bool = False
    """It is in a failsafe of its own."""
    battery_fraction: float = -1.0
    """Remaining charge, 0 to 1; -1 when unknown."""
    heard_ns: int = 0
    """Newest heartbeat or attitude, vehicle clock, ns."""

    def age_s(self, t_ns: int) -> float:
        """Time since the autopilot was last heard, s; infinite when never."""
        return (t_ns - self.heard_ns) / 1e9 if self.found and self.heard_ns else math.inf

    def estimate_age_s(self, t_ns: int) -> float:
        """Age of the older one of attitude and position, s; infinite without both."""
        if self.attitude is None or self.position is None:
            return math.inf
        return (t_ns - min(self.attitude.stamp_ns, self.position.stamp_ns)) / 1e9

    def ned_p_m(self) -> Vec3 | None:
        """Position from home, NED, m; from the local origin while home is unknown."""
        if self.position is None:
            return None
        home = self.home_local_m or (0.0, 0.0, 0.0)
        p = self.position.local_p_m
        return (p[0] - home[0], p[1] - home[1], p[2] - home[2])

    @property
    def roles(self) -> frozenset[Role]:
        """What the flight mode means to helm."""
        return self.dialect.roles(self.mode)

    @property
    def height_m(self) -> float:
        """Height above home, m; NaN without a position."""
        p = self.ned_p_m()
        return math.nan if p is None else -p[2]


@dataclass
class TelemetryDecoder:
    """Turns messages into the snapshot. One thread calls it: the control loop."""

    dialect: Dialect = UNKNOWN
    """What the autopilot speaks."""
    clock: ClockMap = field(default_factory=ClockMap)
    """Autopilot clock to vehicle clock."""
    now: Telemetry = Telemetry()
    """Newest state, without the attitudes of this look."""
    malformed: int = 0
    """Messages that could not be read."""
    heartbeats: int = 0
    """Heartbeats of the autopilot so far."""

    _home: dict[str, Any] | None = None
    _origin: dict[str, Any] | None = None
    _force: tuple[Vec3, int] | None = None  # the newest HIGHRES_IMU's, and when it arrived

    def __post_init__(self) -> None:
        self.now = replace(self.now, dialect=self.dialect)

    def forget(self) -> None:
        """Start anew: what speaks next may be another vehicle, one that restarted, or one whose clock stood still."""
        self.now = Telemetry(dialect=self.dialect)
        self.clock = ClockMap()
        self._home = self._origin = self._force = None

    def feed(self, name: str, fields_json: str, arrival_ns: int) -> AttitudeSample | None:
        """Take one message; returns the attitude if it was one. A malformed message is counted and ignored."""
        try:
            return self._take(name, json.loads(fields_json), arrival_ns)
        except (ValueError, KeyError, TypeError):
            self.malformed += 1
            return None

    def _take(self, name: str, m: dict[str, Any], arrival_ns: int) -> AttitudeSample | None:
        if name == "ATTITUDE_QUATERNION":
            return self._attitude(m, arrival_ns)
        if name == "LOCAL_POSITION_NED":
            numbers = _numbers(m, "x", "y", "z", "vx", "vy", "vz")
            stamp_ns = self.clock.update(int(m["time_boot_ms"]) * 1_000_000, arrival_ns)
            self.now = replace(self.now, position=PositionSample(stamp_ns, numbers[:3], numbers[3:]))
        elif name == "HIGHRES_IMU":
            x, y, z = _numbers(m, "xacc", "yacc", "zacc")
            if int(m["fields_updated"]) & _ACCELEROMETERS == _ACCELEROMETERS:
                self._force = (x, y, z), arrival_ns
        elif name == "HEARTBEAT":
            self._heartbeat(m, arrival_ns)
        elif name == "CURRENT_MODE":
            self.now = replace(self.now, mode=self.dialect.mode_name(int(m["custom_mode"])), mode_ns=arrival_ns)
        elif name == "EXTENDED_SYS_STATE" and int(m["landed_state"]) in _LANDED:
            self.now = replace(self.now, in_air=_LANDED[int(m["landed_state"])], landed_known=True)
        elif name == "SYS_STATUS":
            self.now = replace(self.now, ready=self.dialect.ready(m))
        elif name == "BATTERY_STATUS" and int(m.get("id", 0)) == 0:  # the others feed no motor
            percent = int(m["battery_remaining"])
            self.now = replace(self.now, battery_fraction=percent / 100.0 if 0 <= percent <= 100 else -1.0)
        elif name == "HOME_POSITION":
            self._place_home(m, self._origin)
        elif name == "GPS_GLOBAL_ORIGIN":
            self._place_home(self._home, m)
        return None

    def _place_home(self, home: dict[str, Any] | None, origin: dict[str, Any] | None) -> None:
        """A home that moves in flight would move the frame under the vehicle: it counts on the ground only."""
        place = None if home is None else self.dialect.home_local_m(home, origin)
        self._home, self._origin = home, origin
        if place is not None and not (self.now.in_air and self.now.home_local_m):
            self.now = replace(self.now, home_local_m=place)

    def _attitude(self, m: dict[str, Any], arrival_ns: int) -> AttitudeSample:
        w, x, y, z, roll, pitch, yaw = _numbers(m, "q1", "q2", "q3", "q4", "rollspeed", "pitchspeed", "yawspeed")
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if abs(norm - 1.0) > 1e-2:
            raise ValueError(f"quaternion of norm {norm}")
        stamp_ns = self.clock.update(int(m["time_boot_ms"]) * 1_000_000, arrival_ns)
        force = None
        if self._force is not None and arrival_ns - self._force[1] <= _FORCE_AGED_NS:
            force = self._force[0]
        sample = AttitudeSample(stamp_ns, (w / norm, x / norm, y / norm, z / norm), (roll, pitch, yaw), force)
        self.now = replace(self.now, attitude=sample, heard_ns=max(self.now.heard_ns, arrival_ns), found=True)
        return sample

    def _heartbeat(self, m: dict[str, Any], arrival_ns: int) -> None:
        if int(m["autopilot"]) == _AUTOPILOT_INVALID:  # a ground station's, forwarded
            return
        self.heartbeats += 1
        self.now = replace(
            self.now,
            found=True,
            mode=self.dialect.mode_name(int(m["custom_mode"])),
            mode_ns=arrival_ns,
            armed=bool(int(m["base_mode"]) & _ARMED_FLAG),
            armed_known=True,
            critical=int(m["system_status"]) == _CRITICAL,
            heard_ns=max(self.now.heard_ns, arrival_ns),
        )


def _numbers(m: dict[str, Any], *names: str) -> tuple[Any, ...]:
    """Finite numbers of a message, in order (JSON has null for NaN).

    Raises:
        ValueError: one is missing or not finite.
    """
    values = tuple(float(m[name]) if m[name] is not None else math.nan for name in names)
    if not all(math.isfinite(v) for v in values):
        raise ValueError(f"not finite: {m}")
    return values
