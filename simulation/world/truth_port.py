"""Listens for the vehicle's true pose on UDP; says nothing to the autopilot but which message rates it wants."""

from __future__ import annotations

import errno
import logging
import socket
import struct
import threading
import time
from collections import deque

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from common.config import ConfigError
from simulation.world.config import WorldConfig
from simulation.world.truth_filter import Motion, motion_at, ned_from_geodetic, smoothed

log = logging.getLogger(__name__)

_HISTORY_NS = 1_000_000_000
_WATCH_S = 1.0
_ENOUGH = 0.8
# Linux: the kernel stamps each datagram on arrival; Python 3.11 has no name for it.
_SO_TIMESTAMPNS = 35
_TIMESPEC = struct.Struct("@qq")
# Own identity on the link: a companion computer's peripheral, which sends no heartbeat.
_SYSTEM, _COMPONENT = 1, 158
_AUTOPILOT = 1


class TruthPortError(ConfigError):
    """The truth port cannot be opened; the text says why and what to do."""


class TruthPort:
    """Receives poses in a thread and keeps the last second of them.

    Args:
        config: source, addresses, rates.

    Raises:
        TruthPortError: the port is in use or not permitted.
    """

    def __init__(self, config: WorldConfig):
        self._config = config
        self._home = None if config.home == "first" else config.home
        self._lock = threading.Lock()
        self._history: deque[Motion] = deque()
        self._local: tuple[int, np.ndarray, np.ndarray] | None = None
        self._arrivals: deque[int] = deque(maxlen=512)
        self._peer: tuple[tuple[str, int], int] = ((config.host, config.autopilot_port), 1)
        self._mav = mavlink.MAVLink(None, srcSystem=_SYSTEM, srcComponent=_COMPONENT)
        self._mav.robust_parsing = True
        self._closed = threading.Event()
        self._socket = _bound_socket(config.host, config.port)
        self._thread = threading.Thread(target=self._receive, name="truth-port", daemon=True)
        self._thread.start()

    @property
    def newest_ns(self) -> int | None:
        """Arrival of the newest pose, ns; None while none has come."""
        with self._lock:
            return self._history[-1].t_ns if self._history else None

    @property
    def rate_hz(self) -> float:
        """Poses that arrived over the last second, Hz."""
        return self._rate(time.monotonic_ns())

    def motion_at(self, t_ns: int) -> Motion | None:
        """Motion at an instant, ns; None when nothing is known of it (see `truth_filter.motion_at`)."""
        with self._lock:
            history = tuple(self._history)
        return motion_at(history, t_ns, int(self._config.longest_extrapolation_ms * 1e6))

    def close(self) -> None:
        """Stop listening."""
        self._closed.set()
        self._thread.join(timeout=2.0)
        self._socket.close()

    def _receive(self) -> None:
        next_watch = time.monotonic()
        while not self._closed.is_set():
            if time.monotonic() >= next_watch:
                next_watch = time.monotonic() + _WATCH_S
                self._ask_for_rates()
            try:
                data, ancillary, _, sender = self._socket.recvmsg(2048, 128)
            except TimeoutError:
                continue
            except OSError as error:
                if self._closed.is_set():
                    return
                log.warning("truth port: %s", error)
                continue
            self._take(data, _arrival_ns(ancillary), sender)

    def _take(self, data: bytes, arrival_ns: int, sender: tuple[str, int]) -> None:
        """Everything that one datagram says about the pose."""
        truth = self._config.source == "truth"
        for message in self._mav.parse_buffer(data) or ():
            if message.get_srcComponent() == _AUTOPILOT:  # a link may carry the heartbeats of others too
                self._peer = (sender, message.get_srcSystem())
            motion = None
            if truth and isinstance(message, mavlink.MAVLink_hil_state_quaternion_message):
                motion = self._from_truth(message, arrival_ns)
            elif not truth and isinstance(message, mavlink.MAVLink_local_position_ned_message):
                self._local = (
                    arrival_ns,
                    np.array([message.x, message.y, message.z]),
                    np.array([message.vx, message.vy, message.vz]),
                )
            elif not truth and isinstance(message, mavlink.MAVLink_attitude_quaternion_message):
                motion = self._from_local(message, arrival_ns)
            if motion is not None and _finite(motion):
                self._keep(motion)

    def _from_truth(self, message: mavlink.MAVLink_hil_state_quaternion_message, arrival_ns: int) -> Motion:
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        if self._home is None:
            self._home = place
            log.info("the first truth position is home: %.7f, %.7f, %.2f m", *place)
        velocity = np.array([message.vx, message.vy, message.vz]) * 0.01
        rates = np.array([message.rollspeed, message.pitchspeed, message.yawspeed], dtype=float)
        return Motion(
            arrival_ns, ned_from_geodetic(*place, self._home), velocity, _unit(message.attitude_quaternion), rates
        )

    def _from_local(self, message: mavlink.MAVLink_attitude_quaternion_message, arrival_ns: int) -> Motion | None:
        if self._local is None or arrival_ns - self._local[0] > _HISTORY_NS:
            return None
        stamp, position, velocity = self._local
        rates = np.array([message.rollspeed, message.pitchspeed, message.yawspeed], dtype=float)
        attitude = _unit((message.q1, message.q2, message.q3, message.q4))
        return Motion(arrival_ns, position + velocity * (arrival_ns - stamp) / 1e9, velocity, attitude, rates)

    def _keep(self, motion: Motion) -> None:
        with self._lock:
            previous = self._history[-1] if self._history else None
            if previous is not None and motion.t_ns <= previous.t_ns:
                return  # two datagrams with one stamp: the first one counts
            self._history.append(smoothed(previous, motion, self._config.smoothing_s))
            while motion.t_ns - self._history[0].t_ns > _HISTORY_NS:
                self._history.popleft()
            self._arrivals.append(motion.t_ns)

    def _rate(self, now_ns: int) -> float:
        with self._lock:
            return float(sum(now_ns - t_ns < _HISTORY_NS for t_ns in self._arrivals))

    def _ask_for_rates(self) -> None:
        """Ask the autopilot for the message rate that is wanted, while it is not there."""
        wanted = self._config.truth_rate_hz
        if self._rate(time.monotonic_ns()) >= _ENOUGH * wanted:
            return
        messages = (
            (mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,)
            if self._config.source == "truth"
            else (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)
        )
        address, system = self._peer
        for message in messages:
            command = self._mav.command_long_encode(
                system, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, 1e6 / wanted, 0, 0, 0, 0, 0
            )
            try:
                self._socket.sendto(command.pack(self._mav), address)
            except OSError as error:
                log.warning("truth port: cannot ask %s:%d for its rates (%s)", *address, error)


def _bound_socket(host: str, port: int) -> socket.socket:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp.bind((host, port))
    except OSError as error:
        udp.close()
        if error.errno == errno.EADDRINUSE:
            raise TruthPortError(
                f"truth port: got UDP port {port} on {host} in use, expected it free for the "
                "vehicle's pose; stop the other world or ground station, or set world.port"
            ) from None
        raise TruthPortError(
            f"truth port: cannot listen on {host}:{port} ({error.strerror}); set world.host and world.port"
        ) from None
    udp.settimeout(0.25)
    try:
        udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    except OSError:
        log.info("no kernel time stamps on this machine: poses are stamped when they are read")
    return udp


def _arrival_ns(ancillary: list[tuple[int, int, bytes]]) -> int:
    """Monotonic time of a datagram's arrival, ns: the kernel's stamp where there is one, else now.

    The kernel stamps in UTC; the age of the stamp is taken off the monotonic clock, so UTC need not be steady for long.
    """
    now_ns = time.monotonic_ns()
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            age_ns = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
            if 0 <= age_ns < _HISTORY_NS:
                return now_ns - age_ns
    return now_ns


def _unit(quaternion: object) -> np.ndarray:
    """Unit quaternion (4,) of what a message holds; NaN when it has no length."""
    q = np.asarray(quaternion, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        return q / np.linalg.norm(q)


def _finite(motion: Motion) -> bool:
    values = (motion.ned_p_m, motion.ned_v_m_s, motion.ned_q_body, motion.body_rates_rad_s)
    return all(bool(np.isfinite(v).all()) for v in values)
