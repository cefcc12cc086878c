"""What the autopilot answers: commands, parameters, setpoints and the other conversations of MAVLink, as PX4 does."""

from __future__ import annotations

import heapq
import logging
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from simulation.autopilot.control import heading
from simulation.autopilot.link import UdpLink
from simulation.autopilot.modes import Mode, Verdict
from simulation.autopilot.parameters import from_wire, to_wire
from simulation.autopilot.rates import FIRST_S
from simulation.autopilot.setpoints import SetpointRefused, decode
from simulation.autopilot.telemetry import Message, Telemetry
from simulation.autopilot.vehicle import SimulatedVehicle

log = logging.getLogger(__name__)

_FORCE_MAGIC = 21196
_SECOND_ACK_S = 0.008
_GROUND_STATION = 6  # MAV_TYPE_GCS
_CUSTOM_MODE_FLAG = 1
_PX4_MODES: dict[tuple[int, int], Mode] = {mode.value: mode for mode in Mode}
_MANUAL_MAIN_MODES = (1, 2, 3, 5, 7, 8)  # they need a pilot's sticks, which are not there
_MISSION_UNSUPPORTED = 3

Parameters7 = Sequence[float]


class Protocol:
    """The autopilot's side of every conversation; the links carry it.

    Args:
        vehicle: what the commands act on.
        telemetry: builds the messages that are asked for.
        links: all links; the heartbeats of the peers of `shared` links are forwarded among these.
        shared: links to companion computers and ground stations.
    """

    def __init__(
        self, vehicle: SimulatedVehicle, telemetry: Telemetry, links: Sequence[UdpLink], shared: Sequence[UdpLink]
    ):
        self._vehicle, self._telemetry = vehicle, telemetry
        self._links, self._shared = links, shared
        self._later: list[tuple[float, int, UdpLink, Message]] = []
        self._order = 0
        self._listing: dict[str, tuple[UdpLink, int]] = {}
        self.counters: Counter[str] = Counter()
        """Setpoints flown and refused by reason (`setpoints`, `setpoints_incomplete`, …), unknown commands."""
        self._commands: dict[int, Callable[[UdpLink, Parameters7], Verdict]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._takeoff,
            mavlink.MAV_CMD_NAV_LAND: lambda link, p: vehicle.command(Mode.LAND),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda link, p: vehicle.command(Mode.RETURN),
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: self._request_version,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._request_version,
        }
        self._handlers: dict[str, Callable[[UdpLink, Any], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "COMMAND_LONG": self._on_command_long,
            "COMMAND_INT": self._on_command_int,
            "SET_MODE": self._on_set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "PARAM_REQUEST_LIST": self._on_param_list,
            "PARAM_REQUEST_READ": self._on_param_read,
            "PARAM_SET": self._on_param_set,
            "MISSION_REQUEST_LIST": self._on_mission_list,
            "MISSION_COUNT": self._on_mission_count,
            "MISSION_CLEAR_ALL": self._on_mission_clear,
            "TIMESYNC": self._on_timesync,
        }

    def handle(self, link: UdpLink, message: Message) -> None:
        """React to one message of a link's peer; messages for other systems or components are ignored."""
        handler = self._handlers.get(message.get_type())
        if handler is None:
            return
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system in (0, self._system_id) and component in (0, 1):
            handler(link, message)

    def update(self) -> None:
        """Send what is due by itself: second acknowledgements, parameter lists, notices to ground stations."""
        t_s = self._vehicle.t_s
        while self._later and self._later[0][0] <= t_s:
            _, _, link, message = heapq.heappop(self._later)
            link.send(message)
        for name, (link, index) in list(self._listing.items()):
            names = self._vehicle.parameters.names
            self._send_parameter(link, names[index], index)
            if index + 1 < len(names):
                self._listing[name] = (link, index + 1)
            else:
                del self._listing[name]
        notices = self._vehicle.modes.notices
        while notices:
            severity, text = notices.popleft()
            log.info("%s", text)
            for link in self._shared:
                if link.peer_is_ground_station:
                    link.send(mavlink.MAVLink_statustext_message(severity, text.encode()[:50]))

    @property
    def _system_id(self) -> int:
        return int(self._vehicle.parameters["MAV_SYS_ID"])

    # ------------------------------------------------------------ commands

    def _on_command_long(self, link: UdpLink, m: Any) -> None:
        values = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._run(link, m, m.command, values)

    def _on_command_int(self, link: UdpLink, m: Any) -> None:
        unknown = -(2**31), 2**31 - 1
        x, y = (math.nan if v in unknown else v * 1e-7 for v in (m.x, m.y))
        self._run(link, m, m.command, (m.param1, m.param2, m.param3, m.param4, x, y, m.z))

    def _run(self, link: UdpLink, m: Any, command: int, values: Parameters7) -> None:
        handler = self._commands.get(command)
        if handler is None:
            self.counters[f"unknown_command_{command}"] += 1
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
        if not math.isfinite(p[0]) or not math.isfinite(p[1]) or not int(p[0]) & _CUSTOM_MODE_FLAG:
            return Verdict.DENIED
        return self._change_mode(int(p[1]), int(p[2]) if math.isfinite(p[2]) else 0)

    def _change_mode(self, main: int, sub: int) -> Verdict:
        mode = _PX4_MODES.get((main, 0 if main == Mode.OFFBOARD.value[0] else sub))
        if mode is not None:
            return self._vehicle.command(mode)
        return Verdict.TEMPORARILY_REJECTED if main in _MANUAL_MAIN_MODES else Verdict.DENIED

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
        link.send(self._telemetry.build(int(p[0])))
        return Verdict.ACCEPTED

    def _request_version(self, link: UdpLink, p: Parameters7) -> Verdict:
        link.send(self._telemetry.autopilot_version())
        return Verdict.ACCEPTED

    # ------------------------------------------------------------ streams and modes

    def _on_heartbeat(self, link: UdpLink, m: Any) -> None:
        link.peer_is_ground_station = m.type == _GROUND_STATION
        if link in self._shared:
            for other in self._shared:
                if other is not link:
                    other.forward(bytes(m.get_msgbuf()))

    def _on_set_mode(self, link: UdpLink, m: Any) -> None:
        if m.base_mode & _CUSTOM_MODE_FLAG:
            self._change_mode(m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF)

    def _on_setpoint(self, link: UdpLink, m: Any) -> None:
        try:
            setpoint = decode(m, heading(self._vehicle.estimate.ned_q_body))
        except SetpointRefused as refusal:
            self.counters[f"setpoints_{refusal}"] += 1
            return
        self.counters["setpoints"] += 1
        self._vehicle.take_setpoint(setpoint)

    def _on_timesync(self, link: UdpLink, m: Any) -> None:
        if m.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message(self._telemetry.time_us * 1000, m.ts1))

    # ------------------------------------------------------------ parameters

    def _on_param_list(self, link: UdpLink, m: Any) -> None:
        self._listing[link.name] = (link, 0)

    def _on_param_read(self, link: UdpLink, m: Any) -> None:
        names = self._vehicle.parameters.names
        if m.param_index >= 0:
            if m.param_index < len(names):
                self._send_parameter(link, names[m.param_index], m.param_index)
        elif m.param_id in self._vehicle.parameters:
            self._send_parameter(link, m.param_id, names.index(m.param_id))

    def _on_param_set(self, link: UdpLink, m: Any) -> None:
        parameters = self._vehicle.parameters
        if m.param_id not in parameters:
            self.counters["unknown_parameter"] += 1
            return
        value = from_wire(m.param_value, m.param_type)
        if m.param_type == parameters.wire_type(m.param_id) and math.isfinite(value):
            parameters.set(m.param_id, value)
        self._send_parameter(link, m.param_id, parameters.names.index(m.param_id))

    def _send_parameter(self, link: UdpLink, name: str, index: int) -> None:
        parameters = self._vehicle.parameters
        link.send(
            mavlink.MAVLink_param_value_message(
                name.encode(), to_wire(parameters[name]), parameters.wire_type(name), len(parameters.names), index
            )
        )

    # ------------------------------------------------------------ missions: there are none

    def _on_mission_list(self, link: UdpLink, m: Any) -> None:
        link.send(mavlink.MAVLink_mission_count_message(m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type))

    def _on_mission_count(self, link: UdpLink, m: Any) -> None:
        result = 0 if m.count == 0 else _MISSION_UNSUPPORTED
        link.send(mavlink.MAVLink_mission_ack_message(m.get_srcSystem(), m.get_srcComponent(), result, m.mission_type))

    def _on_mission_clear(self, link: UdpLink, m: Any) -> None:
        link.send(mavlink.MAVLink_mission_ack_message(m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type))
