"""A scripted ArduCopter on a real UDP link: what a client can observe of it, written from ArduPilot's documentation.

It stands in for ArduPilot, which is not part of this repository: mode numbers, GUIDED, takeoff, what it refuses, its
setpoint masks and GUID_TIMEOUT, parameters as plain floats, messages only where they are asked for. The vehicle is a
point with a lag. Sources: "Copter Commands in Guided Mode" and "Get and Set Parameters" of ArduPilot's developer
pages, `ArduCopter/mode_guided.cpp`, `GCS_MAVLink_Copter.cpp`.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

STABILIZE, GUIDED, LOITER, LAND, BRAKE = 0, 4, 5, 9, 17
_ARMABLE = (STABILIZE, GUIDED, LOITER)
_STANDING = (GUIDED, LOITER, BRAKE)
_SENSORS = mavlink.MAV_SYS_STATUS_AHRS | mavlink.MAV_SYS_STATUS_SENSOR_GPS
_POSITION, _VELOCITY, _ACCELERATION = 0x007, 0x038, 0x1C0
_YAW_RATE_IGNORED = 0x800
_QUERIES = (512, 520)  # what MAVSDK asks by itself: a message, the capabilities
_ORIGIN = (473977420, 85455940, 488_000)
_HOME_FROM_ORIGIN_M = (3.0, -2.0, 0.4)  # the local frame does not begin at home
_DEG_E7_M = math.radians(1e-7) * 6378100.0
_PERIOD_S = 0.01
_LAG_S = 0.3
_CLIMB_M_S = 1.5
_DISARM_DELAY_S = 10.0


class ArduCopter:
    """One vehicle on a thread of its own, until closed.

    Args:
        port: where helm listens on 127.0.0.1.
        autopilot: MAV_AUTOPILOT that it claims to be.
        vehicle_type: MAV_TYPE that it claims to be.
    """

    def __init__(self, port: int, autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, vehicle_type: int = 2):
        self._to = ("127.0.0.1", port)
        self._identity = (vehicle_type, autopilot)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._start_s = self._now_s = time.monotonic()
        self.mode = STABILIZE
        self.armed = False
        self.p = list(_HOME_FROM_ORIGIN_M)
        self.v = [0.0, 0.0, 0.0]
        self.yaw_rad = 0.3
        self.commands: list[tuple[int, tuple[float, ...]]] = []
        """Commands received, with their parameters (questions apart)."""
        self.setpoints = 0
        self.invalid_setpoints = 0
        self.ignored_setpoints = 0
        """Setpoints that came in another mode than GUIDED."""
        self.parameters: dict[str, list[float]] = {  # value, MAV_PARAM_TYPE
            "GUID_TIMEOUT": [3.0, mavlink.MAV_PARAM_TYPE_REAL32],
            "FS_EKF_ACTION": [2.0, mavlink.MAV_PARAM_TYPE_INT8],
        }
        self._takeoff_z: float | None = None
        self._target: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
        self._target_s = -math.inf
        self._armed_s = 0.0
        self._senders = {
            0: self._heartbeat,
            1: self._sys_status,
            31: self._attitude,
            32: self._position,
            49: self._origin,
            147: self._battery,
            242: self._home,
            245: self._landed_state,
        }
        self.intervals_s: dict[int, float] = {0: 1.0}
        """Message id and period; without a request only the heartbeat."""
        self._sent_s: dict[int, float] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="arducopter", daemon=True)
        self._thread.start()

    @property
    def height_m(self) -> float:
        """Height above home, m."""
        return _HOME_FROM_ORIGIN_M[2] - self.p[2]

    @property
    def _target_is_fresh(self) -> bool:
        return self._now_s - self._target_s < self.parameters["GUID_TIMEOUT"][0]

    @property
    def landed(self) -> bool:
        """On the ground."""
        return self.height_m <= 0.0

    def close(self) -> None:
        """End the thread and the link."""
        self._stop.set()
        self._thread.join(2.0)
        self._socket.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            now_s = time.monotonic()
            self._move(now_s - self._now_s)
            self._now_s = now_s
            self._hear()
            for message, period_s in list(self.intervals_s.items()):
                if now_s - self._sent_s.get(message, -math.inf) >= period_s:
                    self._sent_s[message] = now_s
                    self._senders[message]()
            self._stop.wait(_PERIOD_S)

    # ------------------------------------------------------------ motion

    def _move(self, dt_s: float) -> None:
        wanted = [0.0, 0.0, 0.0]
        if not self.armed:
            pass
        elif self.mode == LAND:
            wanted[2] = 1.0
        elif self._takeoff_z is not None and self.mode in (GUIDED, LOITER):
            wanted[2] = max(self._takeoff_z - self.p[2], -_CLIMB_M_S)
        elif self.mode == GUIDED and not self.landed and self._target_is_fresh:
            wanted = list(self._target[:3])
            self.yaw_rad += self._target[3] * dt_s
        for i in range(3):
            self.v[i] += (wanted[i] - self.v[i]) * min(dt_s / _LAG_S, 1.0)
            self.p[i] += self.v[i] * dt_s
        if self.p[2] >= _HOME_FROM_ORIGIN_M[2] and self.v[2] >= 0.0:
            self.p[2], self.v = _HOME_FROM_ORIGIN_M[2], [0.0, 0.0, 0.0]
            idle = self._takeoff_z is None and self._now_s - self._armed_s > _DISARM_DELAY_S
            if self.mode == LAND or idle:
                self.armed = False

    # ------------------------------------------------------------ what it hears

    def _hear(self) -> None:
        while True:
            try:
                data = self._socket.recv(2048)
            except BlockingIOError:
                return
            for message in self._mav.parse_buffer(data) or ():
                handler = {
                    "COMMAND_LONG": self._command,
                    "SET_POSITION_TARGET_LOCAL_NED": self._setpoint,
                    "PARAM_REQUEST_READ": self._read_parameter,
                    "PARAM_SET": self._set_parameter,
                }.get(message.get_type())
                if handler is not None:
                    handler(message)

    def _command(self, m: Any) -> None:
        params = tuple(getattr(m, f"param{i}") for i in range(1, 8))
        result = mavlink.MAV_RESULT_UNSUPPORTED
        if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = self._set_interval(int(params[0]), params[1])
        elif m.command not in _QUERIES:
            self.commands.append((m.command, params))
            if m.command == mavlink.MAV_CMD_DO_SET_MODE:
                result = self._set_mode(int(params[0]), int(params[1]))
            elif m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                result = self._arm(params[0] == 1.0, params[1])
            elif m.command == mavlink.MAV_CMD_NAV_TAKEOFF:
                result = self._take_off(params[6])
        sender = (m.get_srcSystem(), m.get_srcComponent())
        self._send(mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, *sender))

    def _set_interval(self, message: int, interval_us: float) -> int:
        if message not in self._senders:
            return mavlink.MAV_RESULT_FAILED
        self.intervals_s[message] = max(interval_us, 1000.0) / 1e6
        return mavlink.MAV_RESULT_ACCEPTED

    def _set_mode(self, base_mode: int, number: int) -> int:
        if not base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or number not in (*_ARMABLE, LAND, BRAKE):
            return mavlink.MAV_RESULT_FAILED
        self.switch(number)
        return mavlink.MAV_RESULT_ACCEPTED

    def switch(self, number: int) -> None:
        """Change the flight mode, as a pilot's switch does too."""
        if number != self.mode:  # the mode that is there already is not begun anew
            self.mode, self._takeoff_z, self._target_s = number, None, -math.inf

    def _arm(self, arm: bool, force: float) -> int:
        if force or (arm and not (self._ready and self.mode in _ARMABLE)) or (not arm and not self.landed):
            return mavlink.MAV_RESULT_FAILED
        self.armed, self._armed_s = arm, self._now_s
        self._home()  # home is where it was armed, and all are told
        return mavlink.MAV_RESULT_ACCEPTED

    def _take_off(self, height_m: float) -> int:
        if not (self.armed and self.landed and self.mode in (GUIDED, LOITER) and height_m > 0.0):
            return mavlink.MAV_RESULT_FAILED
        self._takeoff_z = _HOME_FROM_ORIGIN_M[2] - height_m
        return mavlink.MAV_RESULT_ACCEPTED

    def _setpoint(self, m: Any) -> None:
        """Any ignored axis ignores all three; what leaves nothing to do stops the vehicle."""
        if self.mode != GUIDED:
            self.ignored_setpoints += 1
            return
        self.setpoints += 1
        velocity = not m.type_mask & _VELOCITY
        others_left_out = m.type_mask & _POSITION and m.type_mask & _ACCELERATION
        valid = velocity and others_left_out and m.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
        self.invalid_setpoints += not valid
        rate = 0.0 if m.type_mask & _YAW_RATE_IGNORED else m.yaw_rate
        self._target = (m.vx, m.vy, m.vz, rate) if valid else (0.0, 0.0, 0.0, 0.0)
        self._target_s = self._now_s
        if not self.landed:
            self._takeoff_z = None

    def _read_parameter(self, m: Any) -> None:
        if m.param_id in self.parameters:  # an unknown name gets no answer
            value, kind = self.parameters[m.param_id]
            self._send(mavlink.MAVLink_param_value_message(m.param_id.encode(), value, int(kind), 2, 0xFFFF))

    def _set_parameter(self, m: Any) -> None:
        if m.param_id in self.parameters:
            self.parameters[m.param_id][0] = m.param_value
            self._read_parameter(m)

    # ------------------------------------------------------------ what it says

    @property
    def _ready(self) -> bool:
        return self._now_s - self._start_s > 1.5

    @property
    def _boot_ms(self) -> int:
        return int((self._now_s - self._start_s) * 1e3)

    def _send(self, message: Any) -> None:
        self._socket.sendto(message.pack(self._mav), self._to)

    def _heartbeat(self) -> None:
        base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        status = mavlink.MAV_STATE_STANDBY if self.landed else mavlink.MAV_STATE_ACTIVE
        self._send(mavlink.MAVLink_heartbeat_message(*self._identity, base_mode, self.mode, status, 3))

    def _sys_status(self) -> None:
        health = _SENSORS | (mavlink.MAV_SYS_STATUS_PREARM_CHECK if self._ready else 0)
        present = _SENSORS | mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self._send(mavlink.MAVLink_sys_status_message(present, present, health, 200, 16000, 800, 90, 0, 0, 0, 0, 0, 0))

    def _attitude(self) -> None:
        half = self.yaw_rad / 2
        self._send(
            mavlink.MAVLink_attitude_quaternion_message(
                self._boot_ms, math.cos(half), 0.0, 0.0, math.sin(half), 0.0, 0.0, self._target[3]
            )
        )

    def _position(self) -> None:
        self._send(mavlink.MAVLink_local_position_ned_message(self._boot_ms, *self.p, *self.v))

    def _origin(self) -> None:
        self._send(mavlink.MAVLink_gps_global_origin_message(*_ORIGIN))

    def _home(self) -> None:
        """Latitude and longitude count; the local place is left zero."""
        north, east, down = _HOME_FROM_ORIGIN_M
        place = (
            _ORIGIN[0] + round(north / _DEG_E7_M),
            _ORIGIN[1] + round(east / _DEG_E7_M / math.cos(math.radians(_ORIGIN[0] * 1e-7))),
            _ORIGIN[2] - round(down * 1000),
        )
        self._send(mavlink.MAVLink_home_position_message(*place, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))

    def _battery(self) -> None:
        self._send(mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [16000] + [65535] * 9, 800, -1, -1, 90))

    def _landed_state(self) -> None:
        state = mavlink.MAV_LANDED_STATE_IN_AIR
        if self.landed:
            state = mavlink.MAV_LANDED_STATE_ON_GROUND
        elif self.mode == LAND:
            state = mavlink.MAV_LANDED_STATE_LANDING
        elif self._takeoff_z is not None:
            state = mavlink.MAV_LANDED_STATE_TAKEOFF
        self._send(mavlink.MAVLink_extended_sys_state_message(0, state))
