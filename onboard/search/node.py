"""The search as a node: flies the lines over its area by requests to helm, which obeys while it is told to."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from common.config import Config
from common.geometry.config import CamerasConfig
from common.geometry.rotation import Array, euler_from_quat
from common.header import Received
from common.messages import HelmStatus, Reply, Request, SearchStatus, VehicleState
from common.node import CommandCall, Every, Inputs, Node, Output
from onboard.helm.config import HelmConfig
from onboard.limiter.config import LimiterConfig
from onboard.limiter.volume import edges
from onboard.people.pipeline_config import PeopleConfig
from onboard.search.config import SearchConfig
from onboard.search.law import along
from onboard.search.sweep import length_m, swath_m, sweep

_STATE, _STATUS = "helm/state", "helm/status"
_STATE_MAX_AGE_NS = 200_000_000
_STATUS_PERIOD_NS = 190_000_000
_NEARER_M = 0.1


class SearchNode(Node):
    """Asks for velocities along the way over `search.area` from `search/do/start` on until it is flown.

    Args:
        config: sections `search`, `camera`, `people`, and the fences of `limiter` and `helm`.
        name: node name.
    """

    inputs = (_STATE, _STATUS)
    outputs = ("helm/request/search", "search/status")
    commands = ("search/do/start", "search/do/stop")
    trigger = Every(0.05)

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        self._config = config.section(SearchConfig)
        self._limiter = config.section(LimiterConfig)
        self._contained = config.section(HelmConfig).containment
        cameras = config.section(CamerasConfig).by_name()
        people = config.section(PeopleConfig)
        eye = cameras[people.camera or "down"]
        depth = eye.depth_camera() if people.use_depth else None
        # Who is beside the depth picture is not found, however wide the colour picture is.
        eyes = [eye.camera(), *([] if depth is None else [depth.camera])]
        swaths_m = [swath_m(camera, self._config.height_m) for camera in eyes]
        self._spacing_m = min(swaths_m) * (1.0 - self._config.overlap)
        self._state: Received[VehicleState] | None = None
        self._way: Array = np.zeros((0, 2))
        self._next = 0
        self._from: Array = np.zeros(2)
        """Where the line to the next corner begins, (2,)."""
        self._nearest: tuple[float, int] = (math.inf, 0)
        """Least distance to the next corner so far, m, and when that was, ns."""
        self._over = "nothing was searched yet"
        self._skipped = 0
        self._told_ns = 0
        self._obeyed = False
        self._answer: tuple[CommandCall, Reply] | None = None

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Ask for the way to the next corner; say how far the search is."""
        self._take(inputs)
        if self._answer is not None:  # once the first request is out, so that helm has it when it is told to obey
            call, reply = self._answer
            self._answer = None
            call.reply(reply)
        outputs = []
        if self._searching and self._fresh(t_ns) and self._state is not None:
            request = self._advance(self._state.message, t_ns)
            if request is not None:
                outputs.append(Output("helm/request/search", request, self._state.header.capture_ns))
        if t_ns - self._told_ns >= _STATUS_PERIOD_NS:
            self._told_ns = t_ns
            outputs.append(Output("search/status", self._status()))
        return outputs

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Begin at the first line, or end."""
        if call.name == "search/do/stop":
            self._end("stopped")
            call.reply(Reply(outcome="done", reason="the search has ended"))
            return ()
        self._take(inputs)
        refusal = self._begin(t_ns)
        if refusal:
            call.reply(Reply(outcome="refused", reason=refusal))
            return ()
        outputs = self.step(inputs, t_ns)
        way_m = length_m(self._way, (self._place[0], self._place[1]))
        lasts_s = way_m / self._config.speed_m_s
        told = f"{len(self._way) // 2} lines, {way_m:.0f} m, about {lasts_s:.0f} s; `search` flies them"
        self._answer = (call, Reply(outcome="done", reason=told))
        return outputs

    def _take(self, inputs: Inputs) -> None:
        """Take over the newest state, and whether helm obeys."""
        states = inputs.drain(_STATE, VehicleState)
        self._state = states[-1] if states else self._state
        status = inputs.latest(_STATUS, HelmStatus)
        self._obeyed = status is not None and status.message.state == "search"

    @property
    def _searching(self) -> bool:
        return self._next < len(self._way)

    @property
    def _place(self) -> Array:
        return np.zeros(3) if self._state is None else np.array(self._state.message.ned_p_m)

    def _fresh(self, t_ns: int) -> bool:
        return self._state is not None and t_ns - self._state.received_ns <= _STATE_MAX_AGE_NS

    def _begin(self, t_ns: int) -> str:
        """Lay out the way; why it cannot be flown, or nothing."""
        if not self._config.area:
            return "search.area names no area; set its corners in the vehicle's file"
        if not self._fresh(t_ns):
            return "no vehicle state; is helm running?"
        low, high = self._contained.height_min_m, self._contained.height_max_m
        if not low <= self._config.height_m <= high:
            return f"search.height_m: got {self._config.height_m:g}, expected {low:g} to {high:g} (helm.containment)"
        place = self._place
        way = sweep(self._config.area, self._spacing_m, (place[0], place[1]))
        for north, east in way.tolist():
            room_m = self._room_m(north, east)
            if room_m < self._config.fence_margin_m:
                return (
                    f"search.area: its way comes to {north:.1f} m north, {east:.1f} m east of home, {room_m:.1f} m "
                    f"inside the fence, expected {self._config.fence_margin_m:g} or more; search less, or fence more"
                )
        self._way, self._skipped, self._over = way, 0, ""
        self._set_out(0, t_ns)
        return ""

    def _room_m(self, north_m: float, east_m: float) -> float:
        """How far inside the fences a place is, m; 0 or less outside."""
        rooms = edges((north_m, east_m, -self._config.height_m), self._limiter).rooms_m
        return min([self._contained.radius_m - math.hypot(north_m, east_m), *rooms.tolist()])

    def _set_out(self, number: int, t_ns: int) -> None:
        self._next, self._nearest = number, (math.inf, t_ns)
        # A line begins at its first corner; the way to that begins here.
        self._from = self._way[number - 1] if number % 2 else self._place[:2]

    def _advance(self, state: VehicleState, t_ns: int) -> Request | None:
        """The request for now, after taking note of what was reached; None at the end."""
        place = np.array(state.ned_p_m)
        left_m = float(np.linalg.norm(self._way[self._next] - place[:2]))
        if left_m < self._nearest[0] - _NEARER_M or not self._obeyed:
            self._nearest = (left_m, t_ns)
        stuck = t_ns - self._nearest[1] > self._config.stuck_s * 1e9
        if left_m <= self._config.reached_m or stuck:
            self._skipped += stuck
            self._set_out(self._next + 1, t_ns)
        if not self._searching:
            blocked = f", {self._skipped} corners of it not reached" if self._skipped else ""
            self._end("flown to its end" + blocked)
            return None
        yaw_rad = euler_from_quat(state.ned_q_body)[2]
        return along(self._from, self._way[self._next], place, yaw_rad, self._config)

    def _end(self, why: str) -> None:
        self._way, self._next, self._over = np.zeros((0, 2)), 0, why

    def _status(self) -> SearchStatus:
        done = self._next / len(self._way) if len(self._way) else 0.0
        return SearchStatus(
            state="searching" if self._searching else "idle",
            flown=done,
            way_m=tuple((north, east) for north, east in self._way.tolist()),
            next_corner=self._next,
            skipped=self._skipped,
            reason=self._over,
        )
