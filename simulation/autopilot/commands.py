"""The commands that the autopilot knows (COMMAND_LONG, COMMAND_INT), and how it acknowledges them, as PX4 does."""

from __future__ import annotations

import heapq
import logging
import math
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from simulation.autopilot.estimator import Fault, Sensor
from simulation.autopilot.link import UdpLink
from simulation.autopilot.modes import Mode, Verdict
from simulation.autopilot.rates import FIRST_S
from simulation.autopilot.telemetry import Message, Telemetry
from simulation.autopilot.vehicle import SimulatedVehicle

log = logging.getLogger(__name__)

CUSTOM_MODE_FLAG = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
_FORCE_MAGIC = 21196
_SECOND_ACK_S = 0.008
_REBOOT_DELAY_S = 0.4  # PX4 shuts down this long after it has acknowledged
_REBOOT = 1
_PX4_MODES: dict[tuple[int, ...], Mode] = {mode.value: mode for mode in Mode}
_RATTITUDE = 8  # known to PX4, and no longer flown

Parameters7 = Sequence[float]


class Commands:
    """Runs commands and acknowledges them on the link that they came from.

    Args:
        vehicle: what the commands act on.
        telemetry: builds the messages that are asked for.
    """

    def __init__(self, vehicle: SimulatedVehicle, telemetry: Telemetry):
        self._vehicle, self._telemetry = vehicle, telemetry
        self._order = 0
        self._table: dict[int, Callable[[UdpLink, Parameters7], Verdict]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._takeoff,
            mavlink.MAV_CMD_NAV_LAND: lambda link, p: vehicle.command(Mode.LAND),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda link, p: vehicle.command(Mode.RETURN),
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_INJECT_FAILURE: self._inject_failure,
            mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: self._request_version,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._request_version,
        }
        self.restart()

    def restart(self) -> None:
        """Forget what is still to be answered."""
        self._later: list[tuple[float, int, UdpLink, Message]] = []
        self.reboot_at_s = math.inf
        """When the autopilot falls silent to start anew, autopilot time, s; infinite while nobody asked."""

    def update(self) -> None:
        """Send second acknowledgements that are due."""
        while self._later and self._later[0][0] <= self._vehicle.t_s:
            _, _, link, message = heapq.heappop(self._later)
            link.send(message)

    def take_long(self, link: UdpLink, m: Any) -> None:
        """React to a COMMAND_LONG."""
        values = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._run(link, m, m.command, values)

    def take_int(self, link: UdpLink, m: Any) -> None:
        """React to a COMMAND_INT."""
        unknown = -(2**31), 2**31 - 1
        x, y = (math.nan if v in unknown else v * 1e-7 for v in (m.x, m.y))
        self._run(link, m, m.command, (m.param1, m.param2, m.param3, m.param4, x, y, m.z))

    def _run(self, link: UdpLink, m: Any, command: int, values: Parameters7) -> None:
        handler = self._table.get(command)
        if handler is None:
            log.info("command %d is not known", command)
            verdict = Verdict.UNSUPPORTED
        else:
            verdict = handler(link, values)
        offboard = command == mavlink.MAV_CMD_DO_SET_MODE and values[1] == Mode.OFFBOARD.value[0]
        if offboard and verdict is Verdict.TEMPORARILY_REJECTED:
            # PX4 accepts the command first, and takes it back when the mode cannot be entered
            self._acknowledge(link, m, command, Verdict.ACCEPTED)
            self._acknowledge(link, m, command, verdict, _SECOND_ACK_S)
        else:
            self._acknowledge(link, m, command, verdict)

    def _acknowledge(self, link: UdpLink, m: Any, command: int, verdict: Verdict, delay_s: float = 0.0) -> None:
        ack = mavlink.MAVLink_command_ack_message(command, int(verdict), 0, 0, m.get_srcSystem(), m.get_srcComponent())
        if delay_s > 0.0:
            self._order += 1
            heapq.heappush(self._later, (self._vehicle.t_s + delay_s, self._order, link, ack))
        else:
            link.send(ack)

    def _arm_disarm(self, link: UdpLink, p: Parameters7) -> Verdict:
        force = p[1] == _FORCE_MAGIC
        if p[0] == 1.0:
            return self._vehicle.arm(force)
        return self._vehicle.disarm(force) if p[0] == 0.0 else Verdict.UNSUPPORTED

    def _takeoff(self, link: UdpLink, p: Parameters7) -> Verdict:
        height_m = p[6] - self._vehicle.config.home_alt_m
        return self._vehicle.command(Mode.TAKEOFF, height_m if math.isfinite(height_m) else None)

    def _set_mode(self, link: UdpLink, p: Parameters7) -> Verdict:
        if not math.isfinite(p[0]) or not math.isfinite(p[1]) or not int(p[0]) & CUSTOM_MODE_FLAG:
            return Verdict.DENIED
        return self.change_mode(int(p[1]), int(p[2]) if math.isfinite(p[2]) else 0)

    def change_mode(self, main: int, sub: int) -> Verdict:
        """Command the mode of PX4's main and sub numbers."""
        mode = _PX4_MODES.get((main, sub if main == Mode.HOLD.value[0] else 0))
        if mode is not None:
            return self._vehicle.command(mode)
        return Verdict.TEMPORARILY_REJECTED if main == _RATTITUDE else Verdict.DENIED

    def _reposition(self, link: UdpLink, p: Parameters7) -> Verdict:
        """Hold here, which is how a ground station pauses; going elsewhere is not supported."""
        return Verdict.UNSUPPORTED if math.isfinite(p[4]) or math.isfinite(p[5]) else self._vehicle.command(Mode.HOLD)

    def _set_interval(self, link: UdpLink, p: Parameters7) -> Verdict:
        if not math.isfinite(p[0]) or not math.isfinite(p[1]) or not self._telemetry.knows(int(p[0])):
            return Verdict.DENIED
        link.set_interval(int(p[0]), p[1], self._vehicle.t_s)
        return Verdict.ACCEPTED

    def _get_interval(self, link: UdpLink, p: Parameters7) -> Verdict:
        if not math.isfinite(p[0]):
            return Verdict.DENIED
        message_id = int(p[0])
        interval_us = link.interval_us(message_id) if self._telemetry.knows(message_id) else 0
        link.send(mavlink.MAVLink_message_interval_message(message_id & 0xFFFF, interval_us))
        return Verdict.ACCEPTED

    def _request_message(self, link: UdpLink, p: Parameters7) -> Verdict:
        if not math.isfinite(p[0]) or not self._telemetry.knows(int(p[0])):
            return Verdict.DENIED
        if self._vehicle.t_s < FIRST_S.get(int(p[0]), 0.0):
            return Verdict.TEMPORARILY_REJECTED  # not there yet: no home, no position
        message = self._telemetry.build(int(p[0]))
        if message is None:
            return Verdict.TEMPORARILY_REJECTED
        link.send(message)
        return Verdict.ACCEPTED

    def _request_version(self, link: UdpLink, p: Parameters7) -> Verdict:
        link.send(self._telemetry.autopilot_version())
        return Verdict.ACCEPTED

    def _inject_failure(self, link: UdpLink, p: Parameters7) -> Verdict:
        """Let a sensor fail or heal; only where SYS_FAILURE_EN lets it."""
        if not self._vehicle.parameters["SYS_FAILURE_EN"]:
            return Verdict.DENIED
        try:
            sensor, fault = Sensor(p[0]), Fault(p[1])
        except ValueError:
            return Verdict.UNSUPPORTED
        self._vehicle.estimator.faults[sensor] = fault
        log.info("injected failure: %s %s", sensor.name, fault.name)
        return Verdict.ACCEPTED

    def _reboot(self, link: UdpLink, p: Parameters7) -> Verdict:
        """Start anew. Denied while armed; PX4 does not read the force field (param6), and neither do we."""
        if p[0] == 0.0:
            return Verdict.ACCEPTED
        if p[0] != _REBOOT or self._vehicle.modes.armed:
            return Verdict.DENIED
        self.reboot_at_s = self._vehicle.t_s + _REBOOT_DELAY_S
        return Verdict.ACCEPTED
