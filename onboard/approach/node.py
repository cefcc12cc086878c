"""The approach as a node: takes the operator's choice, follows it through the measurements, asks helm to close in."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from common.config import Config
from common.geometry.rotation import Array, as_vec3, euler_from_quat
from common.header import Received
from common.messages import ApproachTarget, Command, Obstacles, People, Reply, VehicleState
from common.node import CommandCall, Inputs, Node, On, Output
from common.topics import topic
from onboard.approach.config import ApproachConfig
from onboard.approach.law import closing
from onboard.approach.target import SelectError, Sighting, Target, choose, follow, remembered, sightings
from onboard.limiter.config import LimiterConfig

_SOURCES = ("obstacles/people", "obstacles/circles", "obstacles/depth")
_STATE, _ROLL = "helm/state", "people/tracks"
_STATE_MAX_AGE_NS = 200_000_000
_REQUEST_PERIOD_NS = 45_000_000
_TARGET_PERIOD_NS = 95_000_000


class ApproachNode(Node):
    """Asks for a velocity towards what was selected for as long as it is seen; helm obeys while it is told to.

    Args:
        config: sections `approach` and `limiter`.
        name: node name.
    """

    inputs = (*_SOURCES, _STATE, _ROLL)
    outputs = ("helm/request/approach", "approach/target")
    commands = ("approach/do/select", "approach/do/stop")
    trigger = On(_SOURCES, at_least_every_s=0.05)

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        self._config = config.section(ApproachConfig)
        self._goal_m = max(self._config.distance_m, config.section(LimiterConfig).h_desired_m)
        self._target: Target | None = None
        self._state: Received[VehicleState] | None = None
        self._seen: dict[str, tuple[int, list[Sighting]]] = {}
        """Capture stamp and points of each source's newest measurement."""
        self._remembered: list[Sighting] = []
        """People at the places where they were last seen."""
        self._asked_ns = 0
        self._told_ns = 0
        self._answers: list[tuple[CommandCall, Reply]] = []

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Follow the target through what is new, ask for the way to it, say how it stands."""
        self._look(inputs)
        reason = self._reason(t_ns)
        # A choice is answered once its first request is out, so that helm has it when it is told to obey.
        answers, self._answers = self._answers, []
        for call, reply in answers:
            call.reply(reply)
        outputs = []
        due = t_ns - self._asked_ns >= _REQUEST_PERIOD_NS
        if due and not reason and self._target is not None and self._state is not None:
            self._asked_ns = t_ns
            place = self._place(self._state, t_ns)
            request = closing(self._target.at(t_ns), place, self._yaw_rad, self._goal_m, self._config)
            outputs.append(Output("helm/request/approach", request, self._state.header.capture_ns))
        if t_ns - self._told_ns >= _TARGET_PERIOD_NS:
            self._told_ns = t_ns
            outputs.append(Output("approach/target", self._told(reason, t_ns)))
        return outputs

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Choose another target, or forget the present one."""
        if call.name == "approach/do/stop":
            self._target = None
            call.reply(Reply(outcome="done", reason="nothing is selected now"))
            return ()
        self._look(inputs)
        state = self._state
        if state is None or t_ns - state.received_ns > _STATE_MAX_AGE_NS:
            call.reply(Reply(outcome="refused", reason="no vehicle state; is helm running?"))
            return ()
        place = self._place(state, t_ns)
        try:
            target = choose(self._known(call.command, t_ns), call.command, place, self._yaw_rad, t_ns, self._config)
        except SelectError as error:
            call.reply(Reply(outcome="refused", reason=str(error)))
            return ()
        self._target = target
        distance_m = float(np.linalg.norm(target.ned_p_m - place))
        what = target.label or "the thing"
        self._asked_ns = 0
        outputs = self.step(inputs, t_ns)
        self._answers.append(
            (call, Reply(outcome="done", reason=f"{what} at {distance_m:.1f} m; `approach` closes in"))
        )
        return outputs

    @property
    def _yaw_rad(self) -> float:
        return 0.0 if self._state is None else euler_from_quat(self._state.message.ned_q_body)[2]

    @staticmethod
    def _place(state: Received[VehicleState], t_ns: int) -> Array:
        """The vehicle (3,) at a time near a state's, NED, m: carried there by its velocity."""
        ahead_s = min(max((t_ns - state.header.capture_ns) / 1e9, -0.5), 0.5)
        return np.asarray(state.message.ned_p_m) + ahead_s * np.asarray(state.message.ned_v_m_s)

    def _look(self, inputs: Inputs) -> None:
        """Take over states and measurements; follow the target through each that is new."""
        states = inputs.drain(_STATE, VehicleState)
        self._state = states[-1] if states else self._state
        roll = inputs.latest(_ROLL, People)
        if roll is not None:
            self._remembered = remembered(roll.message)
        if self._state is None:
            return
        for name in _SOURCES:
            received = inputs.latest(name, Obstacles)
            if received is None or received.header.capture_ns == self._seen.get(name, (0, []))[0]:
                continue
            capture_ns = received.header.capture_ns
            place = self._place(self._state, capture_ns)
            points = sightings(received.message.obstacles, place)
            self._seen[name] = (capture_ns, points)
            if self._target is not None:
                self._target = follow(self._target, points, place, capture_ns, self._config)

    def _present(self, t_ns: int) -> list[Sighting]:
        """What is seen now, all sources together."""
        return [
            point
            for name, (capture_ns, points) in self._seen.items()
            if t_ns - capture_ns < topic(name).max_age_ms * 1e6
            for point in points
        ]

    def _known(self, command: Command, t_ns: int) -> list[Sighting]:
        """What a command may mean: what is seen now; by name or place also who was seen before."""
        present = self._present(t_ns)
        if not command.label and command.ned_p_m is None:
            return present
        labels = {sighting.label for sighting in present}
        return present + [sighting for sighting in self._remembered if sighting.label not in labels]

    def _on_the_way(self, target: Target, t_ns: int) -> bool:
        """Whether a person out of sight may be seen again once the vehicle is there."""
        if self._state is None or target.label not in {sighting.label for sighting in self._remembered}:
            return False
        north, east, down = target.at(t_ns) - self._place(self._state, t_ns)
        to_go_m = math.hypot(north, east, down) - self._goal_m
        return math.hypot(north, east) > self._config.seek_m and to_go_m > 2.0 * self._config.hold_band_m

    def _reason(self, t_ns: int) -> str:
        """Why nothing is asked for, empty when something is."""
        if self._target is None:
            return "nothing is selected"
        if self._state is None or t_ns - self._state.received_ns > _STATE_MAX_AGE_NS:
            return "no vehicle state"
        since_s = (t_ns - self._target.seen_ns) / 1e9
        if since_s > self._config.lost_after_s and self._on_the_way(self._target, t_ns):
            return ""
        if since_s > self._config.forget_after_s and not self._target.label:
            return f"lost for {since_s:.0f} s: select it again"
        return f"not seen for {since_s:.1f} s" if since_s > self._config.lost_after_s else ""

    def _told(self, reason: str, t_ns: int) -> ApproachTarget:
        target = self._target
        if target is None or self._state is None:
            return ApproachTarget(state="idle", goal_m=self._goal_m, reason=reason)
        point = target.at(t_ns)
        return ApproachTarget(
            state="lost" if reason else "tracking",
            label=target.label,
            ned_p_m=as_vec3(point),
            distance_m=float(np.linalg.norm(point - self._place(self._state, t_ns))),
            goal_m=self._goal_m,
            reason=reason,
        )
