"""What the requests of a task, or their absence, call for: chase, follower, approach and search.

Hover at once without a request is the arbiter's; this is what follows after the configured times, and the hand-over
between the chase and the vehicle's own follower.
"""

from __future__ import annotations

from typing import NamedTuple

from onboard.helm.arbiter import Verdict, fault
from onboard.helm.config import HelmConfig
from onboard.helm.seen import Seen
from onboard.helm.states import Event, State

TASKS = (State.PURSUIT, State.FOLLOW, State.APPROACH, State.SEARCH)
_LINK_ALIVE_S = 1.0
_LOSS_EVENTS = {"return": Event.LINK_LOST_RETURN, "land": Event.LINK_LOST_LAND, "hover": Event.LINK_LOST_HOVER}


class Judgement(NamedTuple):
    """What a cycle of a task came to."""

    reason: str = ""
    """Why: of the event, or of the state as it stands; empty where nothing is to be said."""
    event: Event | None = None
    """The transition that is called for; None to go on."""


class TaskWatch:
    """When a task last asked, and last had its target.

    Args:
        config: how long each may stay away, and what follows.
    """

    def __init__(self, config: HelmConfig):
        self._config = config
        self._link_ns = 0
        self._target_ns = 0
        self._taken_over_ns: int | None = None
        self._chase_back_ns: int | None = None

    def entered(self, state: State, event: Event, t_ns: int) -> None:
        """Note that a state was entered, and by which event."""
        if state in TASKS:
            self._link_ns = self._target_ns = t_ns
        self._taken_over_ns = t_ns if event is Event.TAKEN_OVER else None
        self._chase_back_ns = None

    def judge(self, state: State, verdict: Verdict, seen: Seen, t_ns: int) -> Judgement:
        """What this cycle of a task calls for; nothing in any other state.

        Args:
            state: helm's.
            verdict: whom the arbiter obeys.
            seen: all that this cycle looks at.
            t_ns: now.
        """
        if state is State.PURSUIT:
            return self._chase(verdict, seen, t_ns)
        if state is State.FOLLOW:
            return self._follow(verdict, seen, t_ns)
        return self._other(state.value, verdict, t_ns) if state in TASKS else Judgement()

    def _chase(self, verdict: Verdict, seen: Seen, t_ns: int) -> Judgement:
        """After the configured time without a request, what the configuration says."""
        if verdict.source == "follow":
            return Judgement("nothing from the chase: the vehicle follows its target itself", Event.TAKEN_OVER)
        if _chase_speaks(seen, t_ns):
            self._link_ns = t_ns
        if verdict.source == "pursuit" and (seen.track is None or seen.track.tracking):
            self._target_ns = t_ns
            return Judgement("obeying the chase")
        silent_s, without_s = (t_ns - self._link_ns) / 1e9, (t_ns - self._target_ns) / 1e9
        if silent_s > self._config.link_loss_after_s:
            return self._lost(silent_s)
        if silent_s <= 0.0 and without_s > self._config.containment.chase_without_target_s:
            return Judgement(f"no target for {without_s:.0f} s: hold", Event.TARGET_AWAY)
        return _waiting("the chase", without_s) if verdict.source == "helm" else Judgement()

    def _follow(self, verdict: Verdict, seen: Seen, t_ns: int) -> Judgement:
        """A chase that was taken over is handed back, or ended in time."""
        reason = ""
        if verdict.source == "follow":
            self._target_ns = t_ns
            reason = "obeying the follower"
        without_s = (t_ns - self._target_ns) / 1e9
        if self._taken_over_ns is not None:
            if self._is_back(seen, t_ns):
                return Judgement("the chase is back with its target", Event.HANDED_BACK)
            alone_s = (t_ns - self._taken_over_ns) / 1e9
            if alone_s > self._config.follow_without_link_s or without_s > self._config.link_loss_after_s:
                return self._lost(alone_s)
            reason = f"no link for {alone_s:.0f} s: following the chase's target"
        if without_s > self._config.containment.chase_without_target_s:
            return Judgement(f"no target for {without_s:.0f} s: hold", Event.TARGET_AWAY)
        return _waiting("the follower", without_s) if verdict.source == "helm" else Judgement(reason)

    def _is_back(self, seen: Seen, t_ns: int) -> bool:
        """Whether the chase has been back with its target for long enough."""
        chase, track, fresh_s = seen.pursuit, seen.track, self._config.freshness_s
        back = chase is not None and fault(chase, t_ns, fresh_s) is None
        if not back or track is None or not track.tracking or track.age_s > fresh_s:
            self._chase_back_ns = None
            return False
        if self._chase_back_ns is None:
            self._chase_back_ns = t_ns
        return (t_ns - self._chase_back_ns) / 1e9 >= self._config.hand_back_after_s

    def _other(self, task: str, verdict: Verdict, t_ns: int) -> Judgement:
        """Its target being lost, or its way flown: after the configured time, hold."""
        if verdict.source == task:
            self._target_ns = t_ns
            return Judgement(f"obeying the {task}")
        without_s = (t_ns - self._target_ns) / 1e9
        if without_s > self._config.containment.chase_without_target_s:
            return Judgement(f"nothing from the {task} for {without_s:.0f} s: hold", Event.TARGET_AWAY)
        return _waiting(f"the {task}", without_s)

    def _lost(self, silent_s: float) -> Judgement:
        action = self._config.link_loss_action
        return Judgement(f"nothing from the chase for {silent_s:.0f} s: {action}", _LOSS_EVENTS[action])


def _waiting(for_whom: str, without_s: float) -> Judgement:
    return Judgement(f"no fresh request from {for_whom} for {without_s:.1f} s: hover")


def _chase_speaks(seen: Seen, t_ns: int) -> bool:
    """Whether anything has come from the chase of late: a request, or a word of its tracker."""
    spoke_ns = [seen.pursuit.received_ns] if seen.pursuit else []
    if seen.track is not None:
        spoke_ns.append(t_ns - int(seen.track.age_s * 1e9))
    return any((t_ns - ns) / 1e9 < _LINK_ALIVE_S for ns in spoke_ns)
