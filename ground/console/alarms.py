"""What the operator must know now, each with what to do about it; worst first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from ground.console.config import ConsoleConfig
from ground.console.snapshot import APPROACH, FOLLOWED, STATE, STATUS, Snapshot

Level = Literal["danger", "warning", "notice"]
_ORDER: dict[Level, int] = {"danger": 0, "warning": 1, "notice": 2}


@dataclass(frozen=True)
class Alarm:
    """One alarm."""

    level: Level
    """`danger`: act now. `warning`: act soon. `notice`: know it."""
    title: str
    """What is wrong."""
    action: str
    """What to do."""


def alarms(view: Snapshot, config: ConsoleConfig) -> list[Alarm]:
    """Alarms of an instant, worst first, in a fixed order within a level.

    Args:
        view: what the console knows.
        config: thresholds and essential nodes.
    """
    found = [
        *_helm(view),
        *_limiter(view),
        *_battery(view, config),
        *_picture(view, config),
        *_nodes(view, config),
        *_target(view),
        *_follow(view),
        *_approach(view),
        *_ground(view),
    ]
    return sorted(found, key=lambda alarm: _ORDER[alarm.level])


def _helm(view: Snapshot) -> Iterator[Alarm]:
    if view.alive is not None and view.alive.get("helm", 0) > 1:
        yield Alarm("danger", f"{view.alive['helm']} helms are running", "Stop all but one: two hands on one stick.")
    status = view.status
    if status is None or not view.fresh(STATUS):
        gone = view.alive is not None and "helm" not in view.alive
        since = "" if status is None else f" for {view.age_ms(STATUS) / 1000:.0f} s"
        title = "Helm is not running" if gone else f"No word from helm{since}"
        advice = (
            "Take over with the pilot's remote; start the onboard side again."
            if status is not None and (status.in_air or status.armed)
            else "Start the onboard side, or check the radio link."
        )
        yield Alarm("danger" if status is not None or gone else "warning", title, advice)
        return
    if status.state == "yielded":
        yield Alarm(
            "warning",
            f"Another pilot has the stick ({status.mode or 'mode unknown'})",
            "Press Engage to take the stick again.",
        )
    elif status.state == "failsafe":
        yield Alarm(
            "danger",
            "Failsafe",
            _sentence(status.reason, "The autopilot acts on its own; be ready to take over with the pilot's remote."),
        )
    elif status.state == "disconnected":
        yield Alarm("warning", "No autopilot", "Check the autopilot's power and its cable.")
    elif view.state is not None and not view.fresh(STATE):
        yield Alarm(
            "danger",
            f"Flight data are {view.age_ms(STATE) / 1000:.1f} s old",
            "Do not trust height and position; press Hold.",
        )


_GO_NEAR = ("approach", "landing")
"""States in which what is near is what was asked for; the collision zone is an alarm in these, too."""


def _limiter(view: Snapshot) -> Iterator[Alarm]:
    status = view.status
    if status is None or not status.in_air or not view.fresh(STATUS):
        return
    distance = f"{status.limiter_distance_m:.1f} m" if status.limiter_distance_m >= 0 else "distance unknown"
    if status.limiter_zone == "collision":
        yield Alarm(
            "danger",
            f"Obstacle at {distance}: collision zone",
            "The limiter pushes away. Press Hold; do not press Land or Return before it is clear.",
        )
    elif status.limiter_zone == "transition" and status.state not in _GO_NEAR:
        yield Alarm("warning", f"Obstacle at {distance}", "The limiter slows the vehicle; choose another way.")


def _battery(view: Snapshot, config: ConsoleConfig) -> Iterator[Alarm]:
    state = view.state
    if state is None or not view.fresh(STATE) or state.battery_fraction < 0:
        return
    if state.battery_fraction < config.battery_empty_fraction:
        yield Alarm("danger", f"Battery {state.battery_fraction:.0%}", "Land now." if state.in_air else "Charge it.")
    elif state.battery_fraction < config.battery_low_fraction:
        yield Alarm(
            "warning",
            f"Battery {state.battery_fraction:.0%}",
            "Press Return." if state.in_air else "Charge it before the flight.",
        )


def _picture(view: Snapshot, config: ConsoleConfig) -> Iterator[Alarm]:
    age_ms = view.picture_age_ms
    if age_ms < 0:
        yield Alarm("warning", "No picture yet", "Check the camera node and the radio link.")
    elif age_ms > config.picture_age_alarm_ms:
        yield Alarm(
            "danger" if view.chasing else "warning",
            f"No picture for {age_ms / 1000:.1f} s",
            "Choose no target. Press Hold if it stays; check the camera node and the radio link.",
        )


def _nodes(view: Snapshot, config: ConsoleConfig) -> Iterator[Alarm]:
    if view.alive is None:
        return
    for name in config.essential_nodes:
        if name not in view.alive and name != "helm":
            yield Alarm(
                "warning",
                f"Node {name} is not running",
                f"It should come back by itself; else start `outrider node {name}`.",
            )
    for name in config.nodes:
        if view.alive.get(name, 0) > 1 and name != "helm":
            yield Alarm("warning", f"Node {name} runs {view.alive[name]} times", "Stop all but one.")
    for name, health in view.health.items():
        if health.errors and view.fresh(f"health/{name}"):
            yield Alarm(
                "notice", f"Node {name}: {health.errors} failed steps", _sentence(health.last_error, "See its log.")
            )


def _target(view: Snapshot) -> Iterator[Alarm]:
    if not view.chasing or view.track is None:
        return
    if view.track.state == "lost":
        since = f" for {view.tracked_ago_ms / 1000:.1f} s" if view.tracked_ago_ms >= 0 else ""
        yield Alarm("warning", f"Target lost{since}", "Draw a box around it, or press Hold.")
    elif view.track.state == "idle":
        yield Alarm("warning", "The chase has no target", "Draw a box around it, or press Hold.")


def _follow(view: Snapshot) -> Iterator[Alarm]:
    track = view.followed
    if not view.following:
        return
    if track is None or not view.fresh(FOLLOWED):
        yield Alarm("warning", "No word from the follower", "Helm hovers. Press Hold; it should come back by itself.")
    elif track.state == "idle":
        yield Alarm("warning", "Nothing is followed", "Helm hovers. Draw a box around what to follow, or press Hold.")
    elif track.state == "lost":
        since = f" for {view.followed_ago_ms / 1000:.1f} s" if view.followed_ago_ms >= 0 else ""
        yield Alarm("warning", f"Followed target lost{since}", "Draw a box around it, or press Hold.")
    elif view.status is not None and view.status.source == "helm":
        yield Alarm("notice", "Helm hovers, though the target is seen", _sentence(view.status.reason, "Press Hold."))


def _approach(view: Snapshot) -> Iterator[Alarm]:
    status, target = view.status, view.approach
    if status is None or not view.fresh(STATUS) or status.state != "approach":
        return
    if target is None or not view.fresh(APPROACH):
        yield Alarm("warning", "No word from the approach", "Helm hovers. Press Hold; it should come back by itself.")
    elif target.state != "tracking":
        yield Alarm("warning", f"Nothing to approach: {target.reason}", "Helm hovers. Select it again, or press Hold.")


def _ground(view: Snapshot) -> Iterator[Alarm]:
    status = view.status
    if status is None or not view.fresh(STATUS) or status.in_air or status.state != "standby":
        return
    failing = [item for item in status.preflight if not item.ok]
    if failing:
        more = f" (and {len(failing) - 1} more, see Checks)" if len(failing) > 1 else ""
        yield Alarm(
            "notice", f"Not ready to fly: {failing[0].name}", _sentence(failing[0].detail, "See Checks.") + more
        )


def _sentence(text: str, otherwise: str) -> str:
    return text.strip() or otherwise
