"""The vehicle behind a client: its state, its parameters, and the way into the air and back.

Whatever a check changes is put back here.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from simulation.conformance.client import Client, Stream
from simulation.conformance.figures import HOLD, LAND, MODE_NAMES, OFFBOARD

HEIGHT_M = 5.0
ARM, TAKEOFF_COMMAND, LAND_COMMAND, SET_MODE, REQUEST_MESSAGE = 400, 22, 21, 176, 512
ACCEPTED, REJECTED = 0, 1
VELOCITY_MASK = 0x5E3
"""Horizontal velocity, height and heading rate of SET_POSITION_TARGET_LOCAL_NED."""
_INT_TYPES = range(1, 9)
_ON_GROUND = 1
_PREARM_BIT = 1 << 28
_FAST_MESSAGES = {mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 25.0, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0}


class CannotFly(Exception):
    """The vehicle could not be brought where a check begins; the text says what it did instead."""


class Vehicle:
    """State and hand of the vehicle under test.

    Args:
        client: the conversation.
    """

    def __init__(self, client: Client):
        self.client = client
        self.takeoffs_failed = 0
        """Takeoffs that were acknowledged and did not climb."""
        self._originals: dict[str, Any] = {}
        self._until_landed: set[str] = set()
        self._fast = False

    # ------------------------------------------------------------ state

    def field(self, kind: str, name: str, default: float = math.nan) -> Any:
        """A field of the newest message of a kind."""
        seen = self.client.latest.get(kind)
        return default if seen is None else getattr(seen.message, name)

    @property
    def armed(self) -> bool:
        """Motors armed, by the newest heartbeat."""
        return bool(int(self.field("HEARTBEAT", "base_mode", 0)) & 128)

    @property
    def landed(self) -> bool:
        """On the ground, by EXTENDED_SYS_STATE; true while nothing is known."""
        return self.field("EXTENDED_SYS_STATE", "landed_state", _ON_GROUND) in (0, _ON_GROUND)

    @property
    def ready(self) -> bool:
        """Readiness to arm: bit 28 of the health field."""
        return bool(int(self.field("SYS_STATUS", "onboard_control_sensors_health", 0)) & _PREARM_BIT)

    @property
    def mode(self) -> int:
        """Custom mode, by whichever of HEARTBEAT and CURRENT_MODE is newer."""
        seen = [s for s in map(self.client.latest.get, ("HEARTBEAT", "CURRENT_MODE")) if s is not None]
        return max(seen, key=lambda s: s.t_s).message.custom_mode if seen else -1

    @property
    def mode_name(self) -> str:
        """Name of the mode."""
        return MODE_NAMES.get(self.mode, hex(self.mode))

    @property
    def ned_p_m(self) -> tuple[float, float, float]:
        """Position in the autopilot's local frame, NED, m."""
        return self._vector("x", "y", "z")

    @property
    def ned_v_m_s(self) -> tuple[float, float, float]:
        """Velocity, NED, m/s."""
        return self._vector("vx", "vy", "vz")

    def _vector(self, *names: str) -> tuple[float, float, float]:
        a, b, c = (self.field("LOCAL_POSITION_NED", name) for name in names)
        return a, b, c

    @property
    def yaw_rad(self) -> float:
        """Heading, rad."""
        return self.field("ATTITUDE", "yaw")

    def autopilot_s(self, t_s: float) -> float:
        """The autopilot's time at a time of ours, s: mapped by the fastest message of the second before."""
        seen = self.client.since(t_s - 1.0, "LOCAL_POSITION_NED")
        return t_s - min((s.t_s - s.message.time_boot_ms * 1e-3 for s in seen), default=math.nan)

    # ------------------------------------------------------------ parameters

    def param(self, name: str) -> float | None:
        """Value of a parameter; None when the autopilot has none of that name."""
        message = self.client.param_read(name)
        return None if message is None else decode(message)

    def set_param(self, name: str, value: float, until_landed: bool = False) -> bool:
        """Write a parameter, remembering what it was; whether it was answered with that value.

        Args:
            name: of the parameter.
            value: its new value.
            until_landed: put it back after the landing instead of after the check.
        """
        if until_landed:
            self._until_landed.add(name)
        before = self.client.param_read(name)
        if before is None:
            return False
        self._originals.setdefault(name, before)
        return self._write(name, value, before.param_type)

    def restore_params(self) -> list[str]:
        """Put changed parameters back; returns the names that did not take it."""
        failed = []
        for name, before in list(self._originals.items()):
            if name in self._until_landed and self.armed:
                continue
            if self._write(name, decode(before), before.param_type):
                del self._originals[name]
            else:
                failed.append(name)
        return failed

    def _write(self, name: str, value: float, wire_type: int) -> bool:
        answer = self.client.param_write(name, encode(value, wire_type), wire_type)
        return answer is not None and math.isclose(decode(answer), value, rel_tol=1e-6, abs_tol=1e-9)

    # ------------------------------------------------------------ flight

    def set_mode(self, custom_mode: int, station: bool = False) -> list[tuple[float, int]]:
        """Command a mode; returns the acknowledgements, the second one included."""
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        return self.client.command(SET_MODE, 1.0, main, sub, station=station, settle_s=0.06)

    def wait_mode(self, custom_mode: int, timeout_s: float) -> bool:
        """Wait for a mode."""
        return self.client.run(timeout_s, lambda: self.mode == custom_mode)

    def hovering(self) -> Stream:
        """Setpoint of no velocity at the height of the checks."""
        return self.velocity(0.0, 0.0)

    def velocity(
        self, north_m_s: float, east_m_s: float, yaw_rate_rad_s: float = 0.0, frame: int = 1, height_m: float = HEIGHT_M
    ) -> Stream:
        """Setpoint of a horizontal velocity at a height, for the stream."""
        return self.setpoint(VELOCITY_MASK, frame, vx=north_m_s, vy=east_m_s, z=-height_m, yaw_rate=yaw_rate_rad_s)

    def setpoint(self, mask: int, frame: int = 1, **fields: float) -> Stream:
        """SET_POSITION_TARGET_LOCAL_NED with a type mask, for the stream."""
        names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        system, component = self.client.address
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, system, component, frame, mask, *(fields.get(n, 0.0) for n in names)
        )
        return lambda: message

    def take_off(self) -> None:
        """Arm, take off and wait for the height; a takeoff that does not climb is tried once more, and counted.

        Raises:
            CannotFly: not ready, not armed, or no climb.
        """
        client = self.client
        if not client.run(15.0, lambda: self.ready):
            raise CannotFly("not ready to arm within 15 s (bit 28 of SYS_STATUS health)")
        if not self.armed and self.mode != HOLD:
            self.set_mode(HOLD)
        for _ in range(2):
            if not self.armed:
                acks = client.command(ARM, 1.0)
                if not acks or acks[-1][1] != ACCEPTED:
                    raise CannotFly(f"arming was answered {[a for _, a in acks]}")
            start_m = self.ned_p_m[2]
            altitude_m = self.field("GLOBAL_POSITION_INT", "alt") * 1e-3 + HEIGHT_M
            client.command(TAKEOFF_COMMAND, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, altitude_m)
            if client.run(6.0, lambda start_m=start_m: start_m - self.ned_p_m[2] > 0.7):
                if client.run(20.0, lambda: -self.ned_p_m[2] > HEIGHT_M - 0.5):
                    return
                raise CannotFly(f"climbed to {-self.ned_p_m[2]:.1f} m only, {HEIGHT_M:.0f} m was commanded")
            self.takeoffs_failed += 1
        raise CannotFly("two takeoffs were acknowledged and did not climb")

    def hover(self) -> None:
        """Bring the vehicle to where each check in the air begins: OFFBOARD, no velocity, 5 m.

        Raises:
            CannotFly: it does not get there.
        """
        client = self.client
        if not self._fast:
            self.watch_closely(True)
        if self.landed or not self.armed:
            client.stream = None
            self.take_off()
        client.stream, client.stream_hz = self.hovering(), 20.0
        if self.mode != OFFBOARD:
            client.run(0.5)
            self.set_mode(OFFBOARD)
            if not self.wait_mode(OFFBOARD, 3.0):
                raise CannotFly(f"OFFBOARD was not entered with a stream of 20 Hz; mode {self.mode_name}")
        client.run(0.3)
        if not client.run(10.0, self._settled):
            raise CannotFly(f"no hover at {HEIGHT_M:.0f} m within 10 s: {self.ned_p_m}, {self.ned_v_m_s}")

    def _settled(self) -> bool:
        vn, ve, vd = self.ned_v_m_s
        level = abs(self.ned_p_m[2] + HEIGHT_M) < 0.12
        return level and math.hypot(vn, ve) < 0.12 and abs(vd) < 0.25 and abs(self.field("ATTITUDE", "yawspeed")) < 0.1

    def watch_closely(self, close: bool) -> None:
        """Ask for modes and positions more often than the link's default, or no longer."""
        for message_id, hz in _FAST_MESSAGES.items():
            self.client.interval(message_id, hz if close else 0.0)
        self._fast = close

    def land(self, timeout_s: float = 60.0) -> float:
        """Land and wait until the motors stop; returns the seconds from touch-down to that.

        Raises:
            CannotFly: still armed after the time.
        """
        client = self.client
        client.stream = None
        if self.mode != LAND or not self.armed:
            client.command(LAND_COMMAND)
        client.run(timeout_s, lambda: self.landed or not self.armed)
        down_s = client.now_s
        if not client.run(10.0, lambda: not self.armed):
            client.command(ARM, 0.0)
            if not client.run(3.0, lambda: not self.armed):
                raise CannotFly("still armed after landing")
        return client.now_s - down_s

    def after_check(self) -> list[str]:
        """Put back what a check may have left; returns the parameters that did not take their old value."""
        client = self.client
        client.station_beats = False
        client.sign(None)
        client.stream_hz = 20.0
        return self.restore_params()

    def clean_up(self) -> None:
        """Leave the vehicle as it was found: landed, disarmed, its parameters and message rates its own.

        Raises:
            CannotFly: the vehicle does not land or disarm.
        """
        client = self.client
        client.stream = None
        client.run(0.1)
        try:
            if self.armed:
                self.land()
        finally:
            failed = self.after_check()
            if self._fast:
                self.watch_closely(False)
            if failed:
                raise CannotFly(f"parameters that were not put back: {', '.join(failed)}")


def decode(message: Any) -> float:
    """Value of a PARAM_VALUE: whole numbers travel bit by bit in the float."""
    if message.param_type in _INT_TYPES:
        return struct.unpack("<i", struct.pack("<f", message.param_value))[0]
    return message.param_value


def encode(value: float, wire_type: int) -> float:
    """The float that carries a value of a MAV_PARAM_TYPE."""
    return struct.unpack("<f", struct.pack("<i", int(value)))[0] if wire_type in _INT_TYPES else value
