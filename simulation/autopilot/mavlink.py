"""What the autopilot answers: commands, parameters, setpoints and the other conversations of MAVLink, as PX4 does."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from simulation.autopilot.commands import CUSTOM_MODE_FLAG, Commands
from simulation.autopilot.link import UdpLink
from simulation.autopilot.motion import heading
from simulation.autopilot.parameters import from_wire, to_wire
from simulation.autopilot.setpoints import SetpointRefused, decode, decode_attitude
from simulation.autopilot.sticks import Sticks
from simulation.autopilot.telemetry import Message, Telemetry
from simulation.autopilot.vehicle import SimulatedVehicle

log = logging.getLogger(__name__)

_GROUND_STATION = 6  # MAV_TYPE_GCS
_AXIS_ABSENT = 32767
_TEXT_BYTES = 50
_MISSION_UNSUPPORTED = 3


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
        self._texts = 0
        self._listing: dict[str, tuple[UdpLink, int]] = {}
        self.counters: Counter[str] = Counter()
        """Setpoints flown and refused by reason (`setpoints`, `setpoints_incomplete`, …), unknown parameters."""
        self._commands = Commands(vehicle, telemetry)
        self._handlers: dict[str, Callable[[UdpLink, Any], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "COMMAND_LONG": self._commands.take_long,
            "COMMAND_INT": self._commands.take_int,
            "SET_MODE": self._on_set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "SET_ATTITUDE_TARGET": self._on_setpoint,
            "PARAM_REQUEST_LIST": self._on_param_list,
            "PARAM_REQUEST_READ": self._on_param_read,
            "PARAM_SET": self._on_param_set,
            "MISSION_REQUEST_LIST": self._on_mission_list,
            "MISSION_COUNT": self._on_mission_count,
            "MISSION_CLEAR_ALL": self._on_mission_clear,
            "TIMESYNC": self._on_timesync,
            "MANUAL_CONTROL": self._on_manual_control,
            "OBSTACLE_DISTANCE": self._on_obstacle_distance,
        }

    def handle(self, link: UdpLink, message: Message) -> None:
        """React to one message of a link's peer; messages for other systems or components are ignored."""
        handler = self._handlers.get(message.get_type())
        if handler is None:
            return
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        if system in (0, self._system_id) and component in (0, 1):
            handler(link, message)

    def update(self) -> None:
        """Send what is due by itself: second acknowledgements, parameter lists, notices to ground stations."""
        self._commands.update()
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
                    self._send_text(link, severity, text.encode())

    def _send_text(self, link: UdpLink, severity: int, text: bytes) -> None:
        """Send a notice, in numbered pieces when it is long."""
        pieces = [text[i : i + _TEXT_BYTES] for i in range(0, len(text), _TEXT_BYTES)]
        self._texts = self._texts % 65535 + 1 if len(pieces) > 1 else self._texts
        for index, piece in enumerate(pieces):
            whole = self._texts if len(pieces) > 1 else 0
            link.send(mavlink.MAVLink_statustext_message(severity, piece, whole, index))

    @property
    def reboot_at_s(self) -> float:
        """When the autopilot falls silent to start anew, autopilot time, s; infinite while nobody asked."""
        return self._commands.reboot_at_s

    def restart(self) -> None:
        """Forget every conversation: the autopilot has started anew."""
        self._commands.restart()
        self._listing.clear()

    @property
    def _system_id(self) -> int:
        return int(self._vehicle.parameters["MAV_SYS_ID"])

    # ------------------------------------------------------------ streams and modes

    def _on_heartbeat(self, link: UdpLink, m: Any) -> None:
        link.peer_is_ground_station = m.type == _GROUND_STATION
        if link.peer_is_ground_station:
            self._vehicle.ground_station_at_s = self._vehicle.t_s
        if link in self._shared:
            for other in self._shared:
                if other is not link:
                    other.forward(bytes(m.get_msgbuf()))

    def _on_set_mode(self, link: UdpLink, m: Any) -> None:
        if m.base_mode & CUSTOM_MODE_FLAG:
            self._commands.change_mode(m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF)

    def _on_setpoint(self, link: UdpLink, m: Any) -> None:
        try:
            if m.get_type() == "SET_ATTITUDE_TARGET":
                setpoint = decode_attitude(m)
            else:
                setpoint = decode(m, heading(self._vehicle.estimate.ned_q_body))
        except SetpointRefused as refusal:
            self.counters[f"setpoints_{refusal}"] += 1
            return
        self.counters["setpoints"] += 1
        self._vehicle.take_setpoint(setpoint)

    def _on_manual_control(self, link: UdpLink, m: Any) -> None:
        """Sticks of a joystick: x forward, y right, z up (0 to 1000), r clockwise; 32767 leaves an axis at rest."""
        x, y, r = (0.0 if axis == _AXIS_ABSENT else min(max(axis / 1000.0, -1.0), 1.0) for axis in (m.x, m.y, m.r))
        throttle = 0.0 if m.z == _AXIS_ABSENT else min(max(m.z / 500.0 - 1.0, -1.0), 1.0)
        self._vehicle.pilot.take(Sticks(y, x, r, throttle), self._vehicle.t_s)

    def _on_obstacle_distance(self, link: UdpLink, m: Any) -> None:
        """Distances around the vehicle: passed on to the other links, as PX4 streams them to a ground station. Its
        collision prevention, which would brake by them in its manual position mode, is not simulated."""
        if not (m.increment_f > 0.0 or m.increment > 0) or m.min_distance >= m.max_distance:
            self.counters["obstacle_distances_bad"] += 1
            return
        self.counters["obstacle_distances"] += 1
        for other in self._shared:
            if other is not link:
                other.forward(bytes(m.get_msgbuf()))

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
