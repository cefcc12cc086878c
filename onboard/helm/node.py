"""The helm node: a shell around `Flight`. The one process that commands the autopilot."""

from __future__ import annotations

import math
from collections.abc import Iterable

from common.config import Config
from common.geometry.rotation import euler_from_quat
from common.helm_lock import HelmLock, require_free_port
from common.messages import (
    CameraInfo,
    HelmStatus,
    LimiterStatus,
    Message,
    Obstacles,
    Request,
    Track,
    VehicleState,
)
from common.node import CommandCall, Inputs, Node, On, Output
from common.session import BusConfig
from onboard.helm.actions import Link
from onboard.helm.arbiter import Candidate
from onboard.helm.autopilot_link import AutopilotLink
from onboard.helm.commands import COMMANDS, obey
from onboard.helm.config import HelmConfig
from onboard.helm.flight import Flight
from onboard.helm.obstacle_distance import obstacle_distance
from onboard.helm.preflight import CameraView, gate
from onboard.helm.seen import Seen, TrackView
from onboard.helm.telemetry import AttitudeSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import monotone
from onboard.limiter.limiter import Limited, limit
from onboard.limiter.map import NOTHING_KNOWN, ObstacleMap
from onboard.limiter.status import limiter_status
from onboard.limiter.surroundings import Surroundings

_SOURCES = ("operator", "pursuit", "follow", "approach", "search")
_REQUESTS = tuple(f"helm/request/{source}" for source in _SOURCES)
_OBSTACLES = ("obstacles/depth", "obstacles/people", "obstacles/circles")
_STATUS_PERIOD_S = 0.2
_LIMITER_PERIOD_S = 0.1
_NEAREST_TOLD_M = 0.2
_EXTRAPOLATE_S = 0.2


class HelmNode(Node):
    """Arbitrates requests, limits them, streams setpoints, answers `helm/do/…`, publishes state and status.

    It steps at 50 Hz, so that a state goes out as soon as its attitude has come in, and at once on a request, so that
    the answer does not wait; setpoints go out for each request (50 Hz at most) and at 25 Hz while nobody is obeyed.

    Args:
        config: all sections.
        name: process name.
        link: the autopilot; by default the one that `helm.autopilot_url` names.

    Raises:
        HelmTaken: another helm on this machine holds the link.
        ConfigError: the URL cannot be opened, or the limiter's curve does not fall at the largest speed.
    """

    inputs = (*_REQUESTS, *_OBSTACLES, "camera/down/info", "pursuit/track")
    outputs = ("helm/state", "helm/status", "helm/setpoint", "helm/limiter")
    commands = COMMANDS
    trigger = On(_REQUESTS, at_least_every_s=0.02)
    exclusive = True

    def __init__(self, config: Config, name: str, link: Link | None = None):
        super().__init__(config, name)
        self.helm = config.section(HelmConfig)
        self.limiter = config.section(LimiterConfig)
        if self.limiter.strategy == "proposed":
            monotone(self.helm.containment.speed_m_s, self.limiter)
        self.flight = Flight(self.helm, self.limiter)
        self._lock: HelmLock | None = None
        self._link: Link = self._open() if link is None else link
        self._telemetry = Telemetry()
        self._map = ObstacleMap(self.limiter)
        self._limited: Limited | None = None
        self._status_ns = 0
        self._limiter_ns = 0
        self._heading_rad: float | None = None
        self._shown: tuple[str, str] = ("", "")

    def _open(self) -> AutopilotLink:
        url = self.helm.autopilot_url
        self._lock = HelmLock(url, self.config.section(BusConfig).vehicle)
        try:
            if self.helm.udp_port is not None:
                require_free_port(self.helm.udp_port, url)
            return AutopilotLink(url, self.helm.dialect)
        except Exception:
            self._lock.close()
            raise

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """One control cycle: the setpoint first, then what the bus is told."""
        self._telemetry = self._link.poll(t_ns)
        seen = self._look(inputs, t_ns, results=True)
        flown = self.flight.step(seen, t_ns)
        outputs: list[Output] = []
        if flown is not None:
            ok = self._link.send(flown.local)
            self.flight.sent(flown, ok, t_ns)
            self._limited = flown.limited
            source = self.flight.verdict.source
            if source in _SOURCES:
                inputs.latest(f"helm/request/{source}", Request)  # names it in the setpoint's provenance
            if ok:
                outputs.append(Output("helm/setpoint", flown.message))
        self._hand_over()
        outputs.extend(
            Output("helm/state", vehicle_state(self._telemetry, sample), sample.stamp_ns)
            for sample in self._telemetry.attitudes
            if self._telemetry.position is not None
        )
        outputs.extend(self._status(seen, t_ns))
        outputs.extend(self._limiter_status(seen, t_ns))
        return outputs

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Start a command; the reply comes when it is done, refused or failed."""
        obey(call, self.flight, self._look(inputs, t_ns, results=False), t_ns)
        self._hand_over()
        return ()

    def metrics(self) -> dict[str, float]:
        """Counts of the link and of the flight."""
        return {**self._link.metrics(), "setpoints": float(self.flight.machine.counters["setpoints"])}

    def close(self) -> None:
        """End the link; a vehicle in helm's hands is given to the autopilot's HOLD first."""
        self.flight.orders.fail_all("helm is stopping")
        self._link.close(hold=self.flight.streaming(self._telemetry))
        if self._lock is not None:
            self._lock.close()

    def _hand_over(self) -> None:
        for action in self.flight.take_actions():
            self._link.submit(action)

    def _look(self, inputs: Inputs, t_ns: int, results: bool) -> Seen:
        track = inputs.peek("pursuit/track", Track)
        info = inputs.peek("camera/down/info", CameraInfo)
        return Seen(
            telemetry=self._telemetry,
            results=tuple(self._link.results()) if results else (),
            operator=_candidate(inputs, "operator"),
            pursuit=_candidate(inputs, "pursuit"),
            follow=_candidate(inputs, "follow"),
            approach=_candidate(inputs, "approach"),
            search=_candidate(inputs, "search"),
            around=self._around(inputs, t_ns),
            track=None
            if track is None
            else TrackView(track.message.state == "tracking", (t_ns - track.received_ns) / 1e9),
            camera=None if info is None else CameraView((t_ns - info.header.capture_ns) / 1e9, info.message.rate_hz),
        )

    def _status(self, seen: Seen, t_ns: int) -> Iterable[Output]:
        """The status, five times a second and at every change."""
        machine, telemetry = self.flight.machine, self._telemetry
        shown = (machine.state, telemetry.mode)
        if shown == self._shown and (t_ns - self._status_ns) / 1e9 < _STATUS_PERIOD_S:
            return ()
        self._shown, self._status_ns = shown, t_ns
        streaming = self.flight.streaming(telemetry)
        limited = self._limited_now(seen)
        status: Message = HelmStatus(
            state=machine.state.value,
            source=self.flight.verdict.source if streaming else "",
            reason=machine.reason,
            streaming=streaming,
            mode=telemetry.mode,
            armed=telemetry.armed,
            in_air=telemetry.in_air,
            limiter_zone=limited.zone,
            limiter_distance_m=limited.distance_m,
            request_age_ms=self.flight.verdict.age_ms,
            preflight=gate(telemetry, self.flight.parameters.values, seen.camera, self.helm, t_ns),
            counters=dict(machine.counters),
        )
        return (Output("helm/status", status),)

    def _around(self, inputs: Inputs, t_ns: int) -> Surroundings | None:
        """The obstacle map, brought up to now."""
        ned_p_m, position = self._telemetry.ned_p_m(), self._telemetry.position
        if ned_p_m is None or position is None:
            return None if self.limiter.required else NOTHING_KNOWN
        north, east, down = ned_p_m
        v_n, v_e, v_d = position.ned_v_m_s
        dt_s = min(max((t_ns - position.stamp_ns) / 1e9, 0.0), _EXTRAPOLATE_S)
        here = (north + v_n * dt_s, east + v_e * dt_s, down + v_d * dt_s)
        self._map.follow(here, t_ns)
        for name in _OBSTACLES:
            received = inputs.latest(name, Obstacles)
            if received is not None:
                self._map.hear(name, received.message, received.header.capture_ns)
        return self._map.now(here, t_ns)

    def _limited_now(self, seen: Seen) -> Limited:
        """What the limiter did to the newest setpoint; without one, what it would do to hover."""
        if self._limited is not None and self.flight.streaming(self._telemetry):
            return self._limited
        return limit((0.0, 0.0, 0.0), seen.around, self.flight.pilot.limiter)

    def _limiter_status(self, seen: Seen, t_ns: int) -> Iterable[Output]:
        if (t_ns - self._limiter_ns) / 1e9 < _LIMITER_PERIOD_S:
            return ()
        self._limiter_ns = t_ns
        status = limiter_status(self._limited_now(seen), seen.around, self.flight.pilot.limiter)
        if self.helm.obstacle_distance:
            self._tell_autopilot(status, t_ns)
        return (Output("helm/limiter", status),)

    def _tell_autopilot(self, status: LimiterStatus, t_ns: int) -> None:
        """Pass the distances on, for the autopilot's own collision prevention."""
        sample = self._telemetry.attitudes[-1] if self._telemetry.attitudes else None
        if sample is not None:
            self._heading_rad = euler_from_quat(sample.ned_q_body)[2]
        if self._heading_rad is not None:
            fields = obstacle_distance(
                status.sectors_m, self._heading_rad, _NEAREST_TOLD_M, self.limiter.h_max_m, t_ns // 1000
            )
            self._link.tell("OBSTACLE_DISTANCE", fields)


def _candidate(inputs: Inputs, source: str) -> Candidate | None:
    received = inputs.peek(f"helm/request/{source}", Request)
    if received is None:
        return None
    return Candidate(source, received.message, received.header.capture_ns, received.received_ns)


def vehicle_state(telemetry: Telemetry, sample: AttitudeSample) -> VehicleState:
    """The vehicle at the time of an attitude: the newest position carried there by its velocity (30 Hz to 50 Hz).

    Raises:
        ValueError: no position is known.
    """
    ned_p_m, position = telemetry.ned_p_m(), telemetry.position
    if ned_p_m is None or position is None:
        raise ValueError("vehicle_state: got no position, expected a LOCAL_POSITION_NED before")
    dt_s = min(max((sample.stamp_ns - position.stamp_ns) / 1e9, -_EXTRAPOLATE_S), _EXTRAPOLATE_S)
    v = position.ned_v_m_s
    return VehicleState(
        ned_p_m=(ned_p_m[0] + v[0] * dt_s, ned_p_m[1] + v[1] * dt_s, ned_p_m[2] + v[2] * dt_s),
        ned_v_m_s=v,
        ned_q_body=sample.ned_q_body,
        body_rates_rad_s=sample.body_rates_rad_s,
        armed=telemetry.armed,
        in_air=telemetry.in_air,
        mode=telemetry.mode,
        battery_fraction=telemetry.battery_fraction if math.isfinite(telemetry.battery_fraction) else -1.0,
        body_f_m_s2=sample.body_f_m_s2,
    )
