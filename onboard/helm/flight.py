"""The control cycle: telemetry, action results and requests in; at most one setpoint and some actions out.

Imports neither MAVSDK nor the bus: the node feeds it, a test can.
"""

from __future__ import annotations

import math

from onboard.helm.actions import Action, Kind
from onboard.helm.arbiter import HOVER, Candidate, Verdict, arbitrate
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.base import Role
from onboard.helm.machine import Engagement, Machine, presence
from onboard.helm.orders import Orders
from onboard.helm.parameters import Parameters
from onboard.helm.pilot import Flown, Pilot, homing
from onboard.helm.seen import Seen
from onboard.helm.states import Event, State, accepts, in_control
from onboard.helm.takeoff import Takeoff
from onboard.helm.tasks import TaskWatch
from onboard.helm.telemetry import Telemetry
from onboard.limiter.config import LimiterConfig

_HOVER_PERIOD_S = 0.036  # two steps of 20 ms
_REPEAT_S = 0.09  # a repeat must not come just before the next request of a 20 Hz stream and hold it up
_PERIOD_MIN_S = 0.018
_LAND_WITHIN_S = 4.0
_TAKEOFF_NEAR_M = 1.0
_STICK_DEADBAND = 1e-3
_STICK_STATES = accepts(Event.STICK)


class Flight:
    """Helm's brain: the machine, the arbiter, the pilot and what is under way.

    Args:
        config: helm's settings.
        limiter: the limiter's.
    """

    def __init__(self, config: HelmConfig, limiter: LimiterConfig):
        self.config = config
        self.machine = Machine(f"no autopilot at {config.autopilot_url} yet; start it, or set helm.autopilot_url")
        self.orders = Orders()
        self.pilot = Pilot(config, limiter)
        self.takeoff: Takeoff | None = None
        self.parameters = Parameters(config)
        self.verdict: Verdict = HOVER
        """The arbiter's newest decision."""
        self._engagement: Engagement | None = None
        self._outbox: list[Action] = []
        self._last_sent_ns = 0
        self._last_basis_ns = 0
        self._tasks = TaskWatch(config)

    @property
    def state(self) -> State:
        """Present state."""
        return self.machine.state

    def take_actions(self) -> list[Action]:
        """Actions to hand to the link, oldest first."""
        actions, self._outbox = self._outbox, []
        return actions

    def do(self, action: Action) -> None:
        """Queue an action for the link."""
        self._outbox.append(action)

    def streaming(self, telemetry: Telemetry) -> bool:
        """Whether setpoints go out: in control, engaging, or until the autopilot has taken over the landing."""
        if self.state is State.LANDING:
            return Role.CONTROL in telemetry.roles
        return self.state is State.ENGAGING or in_control(self.state)

    def step(self, seen: Seen, t_ns: int) -> Flown | None:
        """One control cycle; the setpoint to send, or None when none is due or none may go out."""
        self._hear(seen, t_ns)
        self._watch(seen, t_ns)
        self._progress(seen, t_ns)
        self._decide(seen, t_ns)
        self.orders.expire(
            t_ns, lambda key: f"{key}: no confirmation in time; helm is {self.state} ({self.machine.reason})"
        )
        if not self.streaming(seen.telemetry) or not self._due(t_ns):
            return None
        for source, reason in self.verdict.refused:
            self.machine.counters[f"{source}: {reason}"] += 1
        return self.pilot.fly(self.verdict, seen.telemetry, seen.around, t_ns)

    def sent(self, flown: Flown, ok: bool, t_ns: int) -> None:
        """Note that the link took a setpoint, or could not."""
        if not ok:
            self.machine.counters["setpoints not sent"] += 1
            return
        self._last_sent_ns = t_ns
        self.machine.counters["setpoints"] += 1
        if flown.limited.changed:
            self.machine.counters["limited"] += 1
        if self._engagement is not None:
            self._engagement.sent()

    def fire(self, event: Event, reason: str, telemetry: Telemetry, t_ns: int) -> bool:
        """Take a transition and do what entering the new state calls for; False when the table has none."""
        before = self.state
        if not self.machine.fire(event, reason, telemetry, t_ns):
            return False
        self.machine.counters[event.value] += 1
        if self.state is not before:
            self._enter(before, telemetry, t_ns)
            self._tasks.entered(self.state, event, t_ns)
        return True

    # ------------------------------------------------------------ one part of the cycle each

    def _enter(self, before: State, telemetry: Telemetry, t_ns: int) -> None:
        state, reason = self.state, self.machine.reason
        if state is State.ENGAGING:
            self._engagement = Engagement(t_ns)
            target_m = self.takeoff.height_m if self.takeoff is not None else math.nan
            near = abs(target_m - telemetry.height_m) < _TAKEOFF_NEAR_M
            self.pilot.reset(telemetry, t_ns, target_m if near else None)
            self._last_sent_ns = t_ns
        else:
            self._engagement = None
        if state is not State.TAKING_OFF:
            self.takeoff = None
        if state is State.LANDING:
            self.orders.fail_all("superseded by the landing", keep=("landing",))
            self.do(Action(Kind.LAND))
        elif state in (State.YIELDED, State.FAILSAFE, State.DISCONNECTED, State.STANDBY):
            if state is State.STANDBY and before is State.LANDING:
                self.orders.settle("landing", "done", reason)
            self.orders.fail_all(reason, keep=("arm", "disarm"))
        if state is State.STANDBY or before is State.DISCONNECTED:
            self.do(self.parameters.read(telemetry.dialect, t_ns, write=state is State.STANDBY))

    def _hear(self, seen: Seen, t_ns: int) -> None:
        for result in seen.results:
            if result.action.kind is Kind.PARAMETERS:
                self.parameters.values.update(result.values)
            elif result.action.kind is Kind.CONTROL and result.ok and self._engagement is not None:
                self._engagement.accepted(t_ns)
            if result.ok:
                continue
            self.machine.counters[f"{result.action.kind.value} refused"] += 1
            if result.action.kind in (Kind.ARM, Kind.DISARM):
                self.orders.settle(result.action.kind.value, "failed", f"the autopilot refused: {result.text}")
            elif result.action.kind is Kind.LAND and self.state is State.LANDING:
                self.orders.settle("landing", "failed", f"the autopilot refused to land: {result.text}")
                self.fire(Event.LAND_FAILED, f"the autopilot refused to land: {result.text}", seen.telemetry, t_ns)

    def _watch(self, seen: Seen, t_ns: int) -> None:
        """What happens to helm: presence and silence of the autopilot, its own hang, modes that others command."""
        telemetry = seen.telemetry
        gap_s = (t_ns - self._last_sent_ns) / 1e9
        if gap_s > self.config.silence_s(telemetry.dialect):
            self.fire(
                Event.HUNG,
                f"no setpoint went out for {gap_s:.1f} s, so {telemetry.dialect.on_silence}; "
                "`engage` takes the stick again",
                telemetry,
                t_ns,
            )
        if telemetry.unfit and self.state is State.DISCONNECTED:
            self.machine.reason = telemetry.unfit
        found = presence(self.state, telemetry, t_ns, self.config.resume_after_restart, self.config.autopilot_url)
        if found is not None:
            self.fire(*found, telemetry, t_ns)
        height_m = self.takeoff.height_m if self.takeoff else math.inf
        foreign = self.machine.foreign_mode(telemetry, height_m)
        if foreign is not None:
            who = "the autopilot's failsafe" if telemetry.critical else "a pilot, a ground station or the autopilot"
            self.fire(
                Event.MODE_TAKEN,
                f"mode {foreign} was set by {who}, not by helm; setpoints stopped, `engage` takes the stick again",
                telemetry,
                t_ns,
            )
        if telemetry.armed:
            self.orders.settle("arm", "done", "armed")
        else:
            self.orders.settle("disarm", "done", "disarmed")

    def _progress(self, seen: Seen, t_ns: int) -> None:
        """What helm has under way: takeoff, engagement, landing, return, parameters."""
        telemetry = seen.telemetry
        if self.state is State.TAKING_OFF and self.takeoff is not None:
            self._take_off(self.takeoff, seen, t_ns)
        if self.state is State.ENGAGING and self._engagement is not None:
            if self._engagement.confirmed(telemetry):
                self.fire(Event.ENGAGED, "hovering", telemetry, t_ns)
                self.orders.settle("engaged", "done", f"hovering at {telemetry.height_m:.1f} m")
            elif self._engagement.failed(t_ns):
                self.fire(
                    Event.ENGAGE_FAILED,
                    f"the autopilot did not enter {telemetry.dialect.control_mode}, it is in {telemetry.mode}; look "
                    f"at its messages, then `engage`",
                    telemetry,
                    t_ns,
                )
            elif self._engagement.due(t_ns):
                self.do(Action(Kind.CONTROL))
        if self.state is State.LANDING:
            if Role.LAND in telemetry.roles:
                self.orders.settle("landing", "done", "landing")
            elif Role.CONTROL in telemetry.roles and self.machine.in_state_s(t_ns) > _LAND_WITHIN_S:
                self.orders.settle("landing", "failed", "the autopilot did not enter LAND")
                self.fire(Event.LAND_FAILED, "the autopilot did not enter LAND; hovering", telemetry, t_ns)
        if self.state is State.STANDBY and self.parameters.due(telemetry.dialect, t_ns):
            self.do(self.parameters.read(telemetry.dialect, t_ns, write=True))

    def _take_off(self, takeoff: Takeoff, seen: Seen, t_ns: int) -> None:
        retries = takeoff.retries
        actions, outcome = takeoff.step(seen.telemetry, list(seen.results), t_ns)
        self._outbox.extend(actions)
        self.machine.counters["takeoff retries"] += takeoff.retries - retries
        self.machine.reason = f"{takeoff.phase.value}, {seen.telemetry.height_m:.1f} of {takeoff.height_m:.1f} m"
        if outcome is None:
            return
        if outcome.climbed:
            self.orders.move("takeoff", "engaged")
            self.fire(Event.CLIMBED, outcome.reason, seen.telemetry, t_ns)
            return
        self.orders.settle("takeoff", "failed", outcome.reason)
        if outcome.in_air:
            self.fire(Event.HOLD, outcome.reason, seen.telemetry, t_ns)
            return
        self.do(Action(Kind.DISARM))
        self.fire(Event.TAKEOFF_FAILED, outcome.reason, seen.telemetry, t_ns)

    def _decide(self, seen: Seen, t_ns: int) -> None:
        """Arbitrate, and take the transitions that requests (or their absence) call for."""
        telemetry, state = seen.telemetry, self.state
        self.verdict = self._arbitrate(seen, t_ns)
        if self.verdict.source == "operator":
            if state is not State.OPERATOR:
                self.fire(Event.STICK, "the operator has the stick", telemetry, t_ns)
        elif state is State.RETURNING and telemetry.position is not None:
            yaw_rad = telemetry.attitude.yaw_rad if telemetry.attitude else math.nan
            self.verdict, home = homing(
                telemetry.ned_p_m() or (0.0, 0.0, 0.0), telemetry.position.ned_v_m_s, yaw_rad, self.config
            )
            if home:
                self.fire(Event.HOME_REACHED, "home reached, landing", telemetry, t_ns)
        elif state is State.OPERATOR:
            self.fire(
                Event.STICK_RELEASED,
                "the operator let go, hovering; `chase`, `follow`, `approach` or `search` resumes",
                telemetry,
                t_ns,
            )
        else:
            judged = self._tasks.judge(state, self.verdict, seen, t_ns)
            if judged.event is not None:
                self.fire(judged.event, judged.reason, telemetry, t_ns)
            elif judged.reason:
                self.machine.reason = judged.reason

    def _arbitrate(self, seen: Seen, t_ns: int) -> Verdict:
        """Operator over task; a stick at rest ends nothing that is under way."""
        state, candidates = self.state, []
        if seen.operator is not None and (
            state is State.OPERATOR or (state in _STICK_STATES and _moves(seen.operator))
        ):
            candidates.append(seen.operator)
        tasks = {
            State.PURSUIT: (seen.pursuit, seen.follow if self.config.follow_on_link_loss else None),
            State.FOLLOW: (seen.follow,),
            State.APPROACH: (seen.approach,),
            State.SEARCH: (seen.search,),
        }.get(state, ())
        candidates += [task for task in tasks if task is not None]
        attitude = seen.telemetry.attitude
        return arbitrate(candidates, t_ns, attitude.yaw_rad if attitude else math.nan, self.config.freshness_s)

    def _due(self, t_ns: int) -> bool:
        """A setpoint is due for each new request (50 Hz at most), 90 ms after it when no other has come, and at 25 Hz
        while nobody is obeyed."""
        fresh = self.verdict.basis_ns > self._last_basis_ns
        repeat_s = _HOVER_PERIOD_S if self.verdict.source == "helm" else _REPEAT_S
        if (t_ns - self._last_sent_ns) / 1e9 < (_PERIOD_MIN_S if fresh else repeat_s):
            return False
        self._last_basis_ns = max(self.verdict.basis_ns, self._last_basis_ns)
        return True


def _moves(candidate: Candidate | None) -> bool:
    """Whether a request asks for any motion: a stick at rest does not end a chase."""
    if candidate is None:
        return False
    request = candidate.request
    return max(*(abs(c) for c in request.vector), abs(request.yaw_rate_rad_s)) > _STICK_DEADBAND
