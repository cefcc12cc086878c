"""The messages that the autopilot sends, each built from the vehicle at the moment of sending."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from simulation.autopilot import status
from simulation.autopilot.estimator import Fault, Sensor
from simulation.autopilot.motion import heading
from simulation.autopilot.plant import GRAVITY_M_S2, Quat, Vec3
from simulation.autopilot.vehicle import SimulatedVehicle

Message = mavlink.MAVLink_message

EARTH_RADIUS_M = 6371000.0
_MAG_NED_GAUSS = (0.21, 0.01, 0.43)  # central Europe
_HOME_SET_S = 2.4
_NO_COVARIANCE = (math.nan,) + (0.0,) * 20


class Telemetry:
    """Builds outgoing messages by MAVLink identifier.

    Args:
        vehicle: the vehicle to report on.
    """

    def __init__(self, vehicle: SimulatedVehicle):
        self._vehicle = vehicle
        config = vehicle.config
        self._lat_deg, self._lon_deg = config.home_lat_deg, config.home_lon_deg
        self._deg_per_north_m = math.degrees(1.0 / EARTH_RADIUS_M)
        self._deg_per_east_m = self._deg_per_north_m / math.cos(math.radians(config.home_lat_deg))
        self._last_fix: Message | None = None
        self._rng = random.Random(f"{config.seed}/imu")
        m = mavlink
        self._builders: dict[int, Callable[[], Message | None]] = {
            m.MAVLINK_MSG_ID_HEARTBEAT: lambda: status.heartbeat(vehicle),
            m.MAVLINK_MSG_ID_SYS_STATUS: lambda: status.sys_status(vehicle),
            m.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            m.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw_int,
            m.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self.attitude_quaternion,
            m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self.local_position_ned,
            m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position_int,
            m.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self.servo_output_raw,
            m.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            m.MAVLINK_MSG_ID_ATTITUDE_TARGET: self.attitude_target,
            m.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self.position_target,
            m.MAVLINK_MSG_ID_HIGHRES_IMU: self.highres_imu,
            m.MAVLINK_MSG_ID_TIMESYNC: self.timesync,
            m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: self.hil_state_quaternion,
            m.MAVLINK_MSG_ID_ALTITUDE: self.altitude,
            m.MAVLINK_MSG_ID_BATTERY_STATUS: lambda: status.battery_status(vehicle),
            m.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            m.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda: status.extended_sys_state(vehicle),
            m.MAVLINK_MSG_ID_ODOMETRY: self.odometry,
            m.MAVLINK_MSG_ID_CURRENT_MODE: lambda: status.current_mode(vehicle),
        }

    def knows(self, message_id: int) -> bool:
        """Whether this message can be built."""
        return message_id in self._builders

    def build(self, message_id: int) -> Message | None:
        """The message now; None while there is nothing to say, as of a position that is not known.

        Raises:
            KeyError: a message that is not known.
        """
        return self._builders[message_id]()

    @property
    def time_us(self) -> int:
        """Autopilot time since the start, µs."""
        return int(self._vehicle.t_s * 1e6)

    @property
    def time_ms(self) -> int:
        """Autopilot time since the start, ms."""
        return int(self._vehicle.t_s * 1e3)

    def system_time(self) -> Message:
        """SYSTEM_TIME; UTC is unknown to the simulated receiver."""
        return mavlink.MAVLink_system_time_message(0, self.time_ms)

    def gps_raw_int(self) -> Message | None:
        """GPS_RAW_INT of a receiver with a 3-D fix; the last one of a receiver that is stuck, None of a silent one."""
        fault = self._vehicle.estimator.faults[Sensor.GPS]
        if fault is Fault.OFF:
            return None
        if fault is Fault.STUCK:
            return self._last_fix
        lat, lon, alt = self._global(self._vehicle.estimate.ned_p_m, self._origin)
        vn, ve, _ = self._vehicle.estimate.ned_v_m_s
        course = round(math.degrees(math.atan2(ve, vn)) * 100) % 36000
        self._last_fix = mavlink.MAVLink_gps_raw_int_message(
            self.time_us, 3, lat, lon, alt, 70, 90, _centi(math.hypot(vn, ve)), course, 14, alt, 700, 900, 300, 0
        )
        return self._last_fix

    def attitude(self) -> Message:
        """ATTITUDE of the estimate."""
        e = self._vehicle.estimate
        return mavlink.MAVLink_attitude_message(self.time_ms, *_euler(e.ned_q_body), *e.body_rates_rad_s)

    def attitude_quaternion(self) -> Message:
        """ATTITUDE_QUATERNION of the estimate."""
        e = self._vehicle.estimate
        return mavlink.MAVLink_attitude_quaternion_message(self.time_ms, *e.ned_q_body, *e.body_rates_rad_s)

    def local_position_ned(self) -> Message | None:
        """LOCAL_POSITION_NED of the estimate, origin at home; None while the position is not valid."""
        if not self._vehicle.estimator.position_valid:
            return None
        e = self._vehicle.estimate
        return mavlink.MAVLink_local_position_ned_message(self.time_ms, *e.ned_p_m, *e.ned_v_m_s)

    def global_position_int(self) -> Message | None:
        """GLOBAL_POSITION_INT of the estimate; None while the position is not valid."""
        if not self._vehicle.estimator.position_valid:
            return None
        e = self._vehicle.estimate
        lat, lon, alt = self._global(e.ned_p_m, self._origin)
        vn, ve, vd = e.ned_v_m_s
        course = round(math.degrees(heading(e.ned_q_body)) * 100) % 36000
        return mavlink.MAVLink_global_position_int_message(
            self.time_ms, lat, lon, alt, round(-e.ned_p_m[2] * 1e3), _centi(vn), _centi(ve), _centi(vd), course
        )

    def servo_output_raw(self) -> Message:
        """SERVO_OUTPUT_RAW: rotor speeds as pulses of 1000 to 2000 µs."""
        top = self._vehicle.airframe.rotor_max_rad_s
        p1, p2, p3, p4 = (1000 + round(1000 * r / top) for r in self._vehicle.truth.rotors_rad_s)
        return mavlink.MAVLink_servo_output_raw_message(self.time_us & 0xFFFFFFFF, 0, p1, p2, p3, p4, 0, 0, 0, 0)

    def vfr_hud(self) -> Message:
        """VFR_HUD of the estimate."""
        v = self._vehicle
        vn, ve, vd = v.estimate.ned_v_m_s
        course = round(math.degrees(heading(v.estimate.ned_q_body))) % 360
        speed = math.hypot(vn, ve)
        throttle = round(100 * v.controller.thrust_fraction) if v.modes.armed else 0
        alt = v.config.home_alt_m - v.estimate.ned_p_m[2]
        return mavlink.MAVLink_vfr_hud_message(speed, speed, course, throttle, alt, -vd)

    def attitude_target(self) -> Message:
        """ATTITUDE_TARGET: what the attitude loop is asked for."""
        c = self._vehicle.controller
        quat = _pointing(c.target_down, c.target_yaw_rad)
        return mavlink.MAVLink_attitude_target_message(self.time_ms, 0, quat, *c.target_rates_rad_s, c.thrust_fraction)

    def position_target(self) -> Message:
        """POSITION_TARGET_LOCAL_NED: the motion setpoint in force; what is free is NaN and masked."""
        s = self._vehicle.setpoint
        values = (*s.ned_p_m, *s.ned_v_m_s, *s.ned_a_m_s2, s.yaw_rad, s.yaw_rate_rad_s)
        mask = sum(1 << (bit if bit < 9 else bit + 1) for bit, value in enumerate(values) if value != value)
        return mavlink.MAVLink_position_target_local_ned_message(self.time_ms, 1, mask, *values)

    def highres_imu(self) -> Message:
        """HIGHRES_IMU: true motion as noisy sensors see it."""
        v, noise = self._vehicle, self._rng.gauss
        ax, ay, az = (a + noise(0.0, v.config.accel_noise_m_s2) for a in v.body_acceleration())
        p, q, r = (rate + noise(0.0, v.config.gyro_noise_rad_s) for rate in v.truth.body_rates_rad_s)
        field = _into_body(v.truth.ned_q_body, _MAG_NED_GAUSS)
        alt = v.config.home_alt_m - v.truth.ned_p_m[2]
        pressure_hpa = 1013.25 * (1.0 - 2.25577e-5 * alt) ** 5.25588  # standard atmosphere
        return mavlink.MAVLink_highres_imu_message(
            self.time_us, ax, ay, az, p, q, r, *field, pressure_hpa, 0.0, alt, 25.0, 0x1FFF
        )

    def timesync(self) -> Message:
        """TIMESYNC request."""
        return mavlink.MAVLink_timesync_message(0, self.time_us * 1000)

    def hil_state_quaternion(self) -> Message:
        """HIL_STATE_QUATERNION: the true motion. As in PX4 its time stays 0 and positions step 1.1 cm (degE7).

        Accelerations are NED, mG, as the message defines them (PX4 sends whole m/s² there).
        """
        s = self._vehicle.truth
        lat, lon, alt = self._global(s.ned_p_m)
        vn, ve, vd = s.ned_v_m_s
        an, ae, ad = (min(max(round(a * 1e3 / GRAVITY_M_S2), -32768), 32767) for a in s.ned_a_m_s2)
        return mavlink.MAVLink_hil_state_quaternion_message(
            0, s.ned_q_body, *s.body_rates_rad_s, lat, lon, alt, _centi(vn), _centi(ve), _centi(vd), 0, 0, an, ae, ad
        )

    def altitude(self) -> Message:
        """ALTITUDE of the estimate over sea level, home and ground."""
        height = -self._vehicle.estimate.ned_p_m[2]
        amsl = self._vehicle.config.home_alt_m + height
        return mavlink.MAVLink_altitude_message(self.time_us, amsl, amsl, height, height, math.nan, height)

    def autopilot_version(self) -> Message:
        """AUTOPILOT_VERSION: MAVLink 2, float and INT32 parameters, COMMAND_INT, local position setpoints; 1.17.0."""
        none = [0] * 8
        uid = int(self._vehicle.parameters["MAV_SYS_ID"])
        return mavlink.MAVLink_autopilot_version_message(
            2 | 8 | 16 | 128 | 8192, 1 << 24 | 17 << 16 | 255, 0, 0, 0, none, none, none, 0, 0, uid
        )

    def home_position(self) -> Message:
        """HOME_POSITION: the take-off point."""
        lat, lon, alt = self._global((0.0, 0.0, 0.0), self._origin)
        return mavlink.MAVLink_home_position_message(
            lat, lon, alt, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0), math.nan, math.nan, math.nan, int(_HOME_SET_S * 1e6)
        )

    def odometry(self) -> Message:
        """ODOMETRY of the estimate: position NED, velocity in the body frame, covariances unknown."""
        e = self._vehicle.estimate
        return mavlink.MAVLink_odometry_message(
            self.time_us,
            1,
            12,
            *e.ned_p_m,
            e.ned_q_body,
            *_into_body(e.ned_q_body, e.ned_v_m_s),
            *e.body_rates_rad_s,
            _NO_COVARIANCE,
            _NO_COVARIANCE,
            0,
            8,
            100,
        )

    @property
    def _origin(self) -> Vec3:
        return self._vehicle.estimator.ned_origin_m

    def _global(self, ned_p_m: Vec3, origin_m: Vec3 = (0.0, 0.0, 0.0)) -> tuple[int, int, int]:
        """Latitude and longitude in degE7 and altitude over sea level in mm, of a place counted from an origin."""
        n, e, d = (place + start for place, start in zip(ned_p_m, origin_m, strict=True))
        lat = self._lat_deg + n * self._deg_per_north_m
        lon = self._lon_deg + e * self._deg_per_east_m
        return round(lat * 1e7), round(lon * 1e7), round((self._vehicle.config.home_alt_m - d) * 1e3)


def _centi(value_m_s: float) -> int:
    """Velocity in cm/s within 16 bits."""
    return min(max(round(value_m_s * 100.0), -32768), 32767)


def _euler(quat: Quat) -> Vec3:
    """Roll, pitch and yaw of an attitude, rad."""
    w, x, y, z = quat
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
    return roll, pitch, heading(quat)


def _into_body(quat: Quat, ned: Vec3) -> Vec3:
    """A NED vector in the body frame: R^T v."""
    w, x, y, z = quat
    n, e, d = ned
    return (
        (1 - 2 * (y * y + z * z)) * n + 2 * (x * y + w * z) * e + 2 * (x * z - w * y) * d,
        2 * (x * y - w * z) * n + (1 - 2 * (x * x + z * z)) * e + 2 * (y * z + w * x) * d,
        2 * (x * z + w * y) * n + 2 * (y * z - w * x) * e + (1 - 2 * (x * x + y * y)) * d,
    )


def _pointing(down: Vec3, yaw_rad: float) -> Quat:
    """Attitude whose z axis is `down` (NED), turned by `yaw_rad` before it is tilted."""
    dn, de, dd = down
    # tilt: the shortest rotation of (0, 0, 1) to `down`
    w = math.sqrt(max((1.0 + dd) / 2.0, 1e-9))
    x, y = -de / (2.0 * w), dn / (2.0 * w)
    c, s = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    return w * c, x * c + y * s, y * c - x * s, w * s
