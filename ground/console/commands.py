"""The operator's commands: what each button asks for; they run in threads of their own, and the outcome is kept."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import msgspec
from viser import Icon, IconName

from common.messages import Command, Reply
from ground.console.style import ButtonLook

log = logging.getLogger(__name__)

Outcome = Literal["running", "done", "refused", "failed"]
_WORST: dict[str, int] = {"done": 0, "refused": 1, "failed": 2}
_KEPT = 12


@dataclass(frozen=True)
class Action:
    """One button."""

    label: str
    """What it says."""
    commands: tuple[str, ...]
    """Commands that it gives, in order (see `common.topics.COMMANDS`)."""
    icon: IconName
    """Icon of viser's set."""
    look: ButtonLook = field(default_factory=ButtonLook)
    """Size."""
    in_turn: bool = False
    """Whether a command that is not done ends it; else all are given."""


HOLD = Action("Hold", ("helm/do/hold",), Icon.HAND_STOP, ButtonLook(wide=True, height_px=52))
TAKE_OFF = Action("Take off", ("helm/do/takeoff",), Icon.PLANE_DEPARTURE)
LAND = Action("Land", ("helm/do/land",), Icon.PLANE_ARRIVAL)
START_CHASE = Action("Start chase", ("helm/do/chase",), Icon.FOCUS_2)
# First the vehicle stands, then the tracker forgets: the other way round it would fly on with no target.
STOP_CHASE = Action("Stop chase", ("helm/do/hold", "pursuit/do/stop"), Icon.TARGET_OFF)
FIND = Action("Find target", ("pursuit/do/find",), Icon.PHOTO_SEARCH, ButtonLook(height_px=34))
FIND_AGAIN = Action("Find again", ("pursuit/do/reinitialise",), Icon.ZOOM_REPLACE, ButtonLook(height_px=34))
START_FOLLOW = Action("Follow", ("helm/do/follow",), Icon.USER_SHARE)
STOP_FOLLOW = Action("Stop following", ("helm/do/hold", "follow/do/stop"), Icon.USER_OFF)
APPROACH = Action(
    "Approach",
    ("approach/do/select", "helm/do/approach"),
    Icon.WALK,
    in_turn=True,
)
STOP_APPROACH = Action("Stop approach", ("helm/do/hold", "approach/do/stop"), Icon.WALK)
APPROACH_SELECTED = Action("Approach", ("helm/do/approach",), Icon.WALK)
APPROACH_PERSON = Action(
    "Approach this one",
    ("approach/do/select", "helm/do/approach"),
    Icon.WALK,
    ButtonLook(wide=True, height_px=34),
    in_turn=True,
)
SEARCH_AREA = Action(
    "Search area", ("search/do/start", "helm/do/search"), Icon.ROUTE, ButtonLook(height_px=34), in_turn=True
)
RESUME_SEARCH = Action("Search area", ("helm/do/search",), Icon.ROUTE)
# First the vehicle stands, then there is no way: the other way round it would ask for nothing while it is obeyed.
STOP_SEARCH = Action("Stop search", ("helm/do/hold", "search/do/stop"), Icon.ROUTE_OFF, ButtonLook(height_px=34))
RENAME = Action("Rename", ("people/do/rename",), Icon.PENCIL, ButtonLook(wide=True, height_px=34))
MERGE = Action("Merge", ("people/do/merge",), Icon.USERS, ButtonLook(wide=True, height_px=34))
DISMISS = Action("Dismiss", ("people/do/dismiss",), Icon.USER_OFF, ButtonLook(wide=True, height_px=34))
CHOOSE = Action("Choose what to approach", ("approach/do/select",), Icon.POINTER)
RETURN = Action("Return", ("helm/do/return",), Icon.HOME)
ENGAGE = Action("Engage", ("helm/do/engage",), Icon.STEERING_WHEEL)
ARM = Action("Arm", ("helm/do/arm",), Icon.LOCK_OPEN, ButtonLook(height_px=34))
DISARM = Action("Disarm", ("helm/do/disarm",), Icon.LOCK, ButtonLook(height_px=34))
PUSH_BACK = Action(
    "Push-back on / off", ("helm/do/push-back",), Icon.ARROW_BACK_UP, ButtonLook(wide=True, height_px=34)
)
SELECT_FOLLOWED = Action("Choose what to follow", ("follow/do/select",), Icon.MARQUEE_2)
SELECT = Action("Choose target", ("pursuit/do/select",), Icon.MARQUEE_2)

MAIN = (
    HOLD,
    TAKE_OFF,
    LAND,
    START_CHASE,
    STOP_CHASE,
    START_FOLLOW,
    STOP_FOLLOW,
    APPROACH,
    STOP_APPROACH,
    RETURN,
    ENGAGE,
    ARM,
    DISARM,
)
"""Buttons that are always in view, in reading order."""
OF_TARGET = (FIND, FIND_AGAIN)
"""Those beside the target."""
OF_SETTINGS = (PUSH_BACK,)
"""Those among the settings."""
BUTTONS = (*MAIN, *OF_TARGET, *OF_SETTINGS)


@dataclass(frozen=True)
class LastCommand:
    """A command that was given, and what became of it."""

    label: str
    """Button, or what was done."""
    outcome: Outcome
    """`running` until the reply is there."""
    reason: str
    """What the reply said."""
    t_ns: int
    """When it was given (console's clock)."""


class Commander:
    """Runs commands in threads, one at a time for each action, so that a slow take-off never delays Hold.

    Args:
        query: asks a node and blocks until it answers.
    """

    def __init__(self, query: Callable[[str, Command], Reply]):
        self._query = query
        self._lock = threading.Lock()
        self._running: set[str] = set()
        self._log: deque[tuple[int, LastCommand]] = deque(maxlen=_KEPT)
        self._count = 0

    @property
    def log(self) -> list[LastCommand]:
        """The newest commands, newest first."""
        with self._lock:
            return [entry for _, entry in reversed(self._log)]

    def start(self, action: Action, argument: Command, report: Callable[[LastCommand], None]) -> bool:
        """Give an action's commands; returns at once, False when the same action still waits for its reply.

        Args:
            action: what to do.
            argument: argument of each of its commands.
            report: called in the worker thread, first when the command goes out, then with the outcome.
        """
        with self._lock:
            if action.label in self._running:
                return False
            self._running.add(action.label)
            self._count += 1
            number = self._count
        given = LastCommand(action.label, "running", "", time.monotonic_ns())
        self._note(number, given)
        threading.Thread(
            target=self._run,
            args=(action, argument, report, number, given),
            name=f"command {action.label}",
            daemon=True,
        ).start()
        return True

    def refuse(self, action: Action, reason: str, report: Callable[[LastCommand], None]) -> None:
        """Note an action that the console itself refuses (a box that is too small)."""
        with self._lock:
            self._count += 1
            number = self._count
        refused = LastCommand(action.label, "refused", reason, time.monotonic_ns())
        self._note(number, refused)
        report(refused)

    def _run(
        self, action: Action, argument: Command, report: Callable[[LastCommand], None], number: int, given: LastCommand
    ) -> None:
        try:
            _quietly(report, given)
            outcome, reason = self._ask(action, argument)
        finally:
            with self._lock:
                self._running.discard(action.label)
        ended = LastCommand(given.label, outcome, reason, given.t_ns)
        log.info("%s: %s%s", ended.label, ended.outcome, f" ({ended.reason})" if ended.reason else "")
        self._note(number, ended)
        _quietly(report, ended)

    def _ask(self, action: Action, argument: Command) -> tuple[Outcome, str]:
        worst: Outcome = "done"
        reasons = []
        for name in action.commands:
            try:
                reply = self._query(name, argument)
            except Exception as error:  # noqa: BLE001 — the bus may be gone; the operator must hear of it
                reply = Reply(outcome="failed", reason=f"{name}: {type(error).__name__}: {error}")
            if reply.reason:
                reasons.append(reply.reason)
            if _WORST[reply.outcome] > _WORST[worst]:
                worst = reply.outcome
            if action.in_turn and reply.outcome != "done":
                break
        return worst, "; ".join(reasons)

    def _note(self, number: int, entry: LastCommand) -> None:
        with self._lock:
            for index, (known, _) in enumerate(self._log):
                if known == number:
                    self._log[index] = (number, entry)
                    return
            self._log.append((number, entry))


def _quietly(report: Callable[[LastCommand], None], entry: LastCommand) -> None:
    try:
        report(entry)
    except Exception:  # a browser that went away must not swallow the outcome
        log.debug("the page could not show %s", entry, exc_info=True)


def by_operator(argument: Command, client_id: int) -> Command:
    """The argument signed with the browser that gave it, for helm's log."""
    return msgspec.structs.replace(argument, operator=f"console/{client_id}")
