"""The messages that tell the autopilot's state: mode, health, battery, in the air or not."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mavlink

from simulation.autopilot.battery import CELLS, WARNING_CRITICAL
from simulation.autopilot.estimator import Fault, Sensor
from simulation.autopilot.flight_modes import Mode
from simulation.autopilot.vehicle import SimulatedVehicle

Message = mavlink.MAVLink_message

_SENSORS = 1 | 2 | 4 | 8 | 32  # gyroscope, accelerometer, magnetometer, barometer, GPS (MAV_SYS_STATUS_SENSOR)
_CONTROLS = 1024 | 2048 | 4096 | 8192 | 16384 | 32768 | 2097152 | 33554432
_RECEIVER = 65536
_XY_CONTROL, _AHRS, _BATTERY = 16384, 2097152, 33554432
_PREARM = 1 << 28
_SENSOR_BITS = {Sensor.MAG: 4, Sensor.BARO: 8, Sensor.GPS: 32}
_CHARGE_STATES = (1, 2, 3, 4)  # MAV_BATTERY_CHARGE_STATE by level of warning
# MAV_STANDARD_MODE; the others have none
_STANDARD_MODES = {Mode.POSITION: 1, Mode.ALTITUDE: 3, Mode.RETURN: 5, Mode.LAND: 7, Mode.TAKEOFF: 8}
_CUSTOM, _STABILISED, _MANUAL, _ARMED = 1, 16, 64, 128  # MAV_MODE_FLAG
_AUTOMATIC = 4 | 8 | 16


def heartbeat(vehicle: SimulatedVehicle) -> Message:
    """HEARTBEAT with PX4's base mode, custom mode and system status."""
    modes = vehicle.modes
    base = _CUSTOM | (_ARMED if modes.armed else 0)
    if modes.mode.automatic:
        base |= _AUTOMATIC
    elif modes.mode.manual:
        base |= _MANUAL
    asked = vehicle.attitude_setpoint
    if modes.mode is not Mode.ACRO and (asked is None or asked.ned_q_body is not None):
        base |= _STABILISED
    if modes.terminated:
        status = 8
    elif modes.failsafe:
        status = 5
    elif modes.armed:
        status = 4
    else:
        status = 3 if vehicle.situation.ready else 0
    return mavlink.MAVLink_heartbeat_message(2, 12, base, modes.mode.custom_mode, status, 3)


def sys_status(vehicle: SimulatedVehicle) -> Message:
    """SYS_STATUS: sensors healthy until they fail, the arming check (bit 28) while it may be armed."""
    now = vehicle.situation
    present = _SENSORS | _CONTROLS | _PREARM | (0 if now.sticks_lost else _RECEIVER)
    health = present
    for sensor, bit in _SENSOR_BITS.items():
        if vehicle.estimator.faults[sensor] is Fault.OFF:
            health &= ~bit
    if not now.position_ok:
        health &= ~(_XY_CONTROL | _AHRS)
    if now.battery_warning >= WARNING_CRITICAL:
        health &= ~_BATTERY
    if not (now.ready and now.position_ok and now.battery_warning == 0 and not now.link_lost):
        health &= ~_PREARM
    b = vehicle.battery
    return mavlink.MAVLink_sys_status_message(
        present,
        present,
        health,
        200,
        int(b.voltage_v * 1e3),
        int(b.current_a * 1e2),
        round(b.fraction * 100),
        0,
        0,
        0,
        0,
        0,
        0,
    )


def battery_status(vehicle: SimulatedVehicle) -> Message:
    """BATTERY_STATUS of the one battery."""
    b = vehicle.battery
    cells = [round(b.voltage_v / CELLS * 1e3)] * CELLS + [65535] * (10 - CELLS)
    return mavlink.MAVLink_battery_status_message(
        0,
        0,
        1,
        2500,
        cells,
        round(b.current_a * 1e2),
        -1,
        -1,
        round(b.fraction * 100),
        0,
        _CHARGE_STATES[vehicle.situation.battery_warning],
    )


def extended_sys_state(vehicle: SimulatedVehicle) -> Message:
    """EXTENDED_SYS_STATE: on the ground, in the air, taking off or landing."""
    if vehicle.landed:
        state = 1
    else:
        state = {Mode.TAKEOFF: 3, Mode.LAND: 4, Mode.DESCEND: 4}.get(vehicle.modes.mode, 2)
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def current_mode(vehicle: SimulatedVehicle) -> Message:
    """CURRENT_MODE: the mode that flies and the one that was asked for."""
    modes = vehicle.modes
    standard = _STANDARD_MODES.get(modes.mode, 0)
    return mavlink.MAVLink_current_mode_message(standard, modes.mode.custom_mode, modes.intended.custom_mode)
