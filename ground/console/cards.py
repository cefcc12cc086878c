"""The panel's texts as HTML. Everything that comes from outside is escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from common.geometry.rotation import euler_from_quat
from common.topics import health_topic, topic
from ground.console.alarms import Alarm
from ground.console.commands import LastCommand
from ground.console.snapshot import APPROACH, FOLLOWED, MEMBERS, SESSION, STATE, STATUS, TRACK, Snapshot

_ZONE_CLASS = {"safe": "g", "warning": "o", "transition": "o", "collision": "r", "blind": "d"}
_OUTCOME_CLASS = {"done": "g", "refused": "o", "failed": "r", "running": "b"}
_STATE_CLASS = {
    "hold": "g",
    "pursuit": "g",
    "follow": "g",
    "approach": "g",
    "operator": "g",
    "yielded": "o",
    "failsafe": "r",
    "disconnected": "r",
}


def card(content: str) -> str:
    """Content in the panel's style."""
    return f'<div class="or">{content}</div>'


def headline_html(found: Sequence[Alarm]) -> str:
    """One line of constant height: the worst alarm's title, or that all is well."""
    if not found:
        return card('<div class="head well">All well</div>')
    more = f" (+{len(found) - 1})" if len(found) > 1 else ""
    return card(f'<div class="head {found[0].level}">{escape(found[0].title)}{more}</div>')


def alarms_html(found: Sequence[Alarm], most: int = 4) -> str:
    """The alarms with what to do, worst first, over the picture: the buttons must not move under the thumb."""
    boxes = [f'<div class="al {a.level}"><b>{escape(a.title)}</b>{escape(a.action)}</div>' for a in found[:most]]
    if len(found) > most:
        boxes.append(f'<div class="al notice">and {len(found) - most} more</div>')
    return f'<div class="or free"><div class="als">{"".join(boxes)}</div></div>'


def flight_html(view: Snapshot) -> str:
    """What the vehicle does and who commands it."""
    status = view.status
    known = status is not None and view.fresh(STATUS)
    flying = "d"
    helm, mode, air = "no word", "—", "—"
    if status is not None and known:
        helm, mode = status.state.replace("_", " "), status.mode or "—"
        flying = _STATE_CLASS.get(status.state, "")
        air = "in air" if status.in_air else ("armed" if status.armed else "disarmed")
    pills = (
        f'<div class="pill {flying}"><small>helm</small>{escape(helm)}</div>'
        f'<div class="pill"><small>mode</small>{escape(mode)}</div>'
        f'<div class="pill {"o" if air == "armed" else ""}"><small>motors</small>{escape(air)}</div>'
    )
    return card(f'<div class="top">{pills}</div>{_figures(view)}{_helm_rows(view)}')


def _figures(view: Snapshot) -> str:
    values = ["—", "—", "—", "—"]
    if view.state is not None and view.fresh(STATE):
        s = view.state
        yaw = math.degrees(euler_from_quat(s.ned_q_body)[2])
        speed = math.hypot(*s.ned_v_m_s[:2])
        values = [
            f"{-s.ned_p_m[2]:.1f} <i>m</i>",
            f"{speed:.1f} <i>m/s</i>",
            f"{round(yaw) % 360:03d}°",
            f"{s.battery_fraction:.0%}" if s.battery_fraction >= 0 else "—",
        ]
    names = ("height", "speed", "heading", "battery")
    cells = "".join(f"<div><small>{n}</small>{v}</div>" for n, v in zip(names, values, strict=True))
    return f'<div class="fig">{cells}</div>'


def _helm_rows(view: Snapshot) -> str:
    """Always the same lines, so that what stands below keeps its place."""
    status = view.status if view.fresh(STATUS) else None
    reason, source, limiter, home = "", "—", "—", "—"
    if status is not None:
        reason = status.reason
        age = f", request {status.request_age_ms:.0f} ms old" if status.request_age_ms >= 0 else ""
        source = escape(status.source or "nobody") + age + ("" if status.streaming else " (no setpoints)")
        distance = f", nearest {status.limiter_distance_m:.1f} m" if status.limiter_distance_m >= 0 else ""
        limiter = f'<b class="{_ZONE_CLASS.get(status.limiter_zone, "")}">{escape(status.limiter_zone)}</b>{distance}'
    if view.state is not None and view.fresh(STATE):
        home = f"{math.hypot(*view.state.ned_p_m[:2]):.0f} m away"
    return (
        f'<div class="why two" title="{escape(reason)}">{escape(reason)}</div>'
        + row("Commanded by", source)
        + row("Limiter", limiter)
        + row("Home", home)
    )


def row(name: str, value: str) -> str:
    """A line with a name on the left and a value, already escaped, on the right."""
    return f'<div class="row"><span>{name}</span><span>{value}</span></div>'


def target_html(view: Snapshot, forward_m: float | None, right_m: float | None) -> str:
    """What is known of the target.

    Args:
        view: what the console knows.
        forward_m: how far ahead of the vehicle it is, m; None when unknown.
        right_m: how far to the right, m.
    """
    return card("".join((*_chased_rows(view, forward_m, right_m), *_followed_rows(view))))


def _chased_rows(view: Snapshot, forward_m: float | None, right_m: float | None) -> list[str]:
    """What is known of the chase's target."""
    track = view.track
    if track is None or not view.fresh(TRACK):
        return [row("Target", '<span class="d">no word from the pursuit</span>')]
    look = {"tracking": "g", "lost": "o"}.get(track.state, "d")
    lines = [row("Target", f'<b class="{look}">{escape(track.state)}</b>')]
    if forward_m is not None and right_m is not None:
        lines.append(row("Position", where(forward_m, right_m)))
    if track.state != "idle":
        lines.append(row("Colour distance", f"{track.distance:.2f}, lost above {track.distance_limit:.2f}"))
    if track.reason:
        lines.append(f'<div class="why">No request: {escape(track.reason)}</div>')
    return lines


def _followed_rows(view: Snapshot) -> list[str]:
    """What is known of the follower's target; nothing where it has none."""
    track = view.followed if view.fresh(FOLLOWED) else None
    if track is None or track.state == "idle":
        return []
    look = "g" if track.state == "tracking" else "o"
    lines = [row("Followed", f'<b class="{look}">{escape(track.state)}</b>')]
    members = view.members.members if view.members is not None and view.fresh(MEMBERS) else ()
    seeing = [member.name for member in members if member.box_px is not None]
    lines.append(row("Seen by", escape(", ".join(seeing) or "no tracker")))
    if track.reason:
        lines.append(f'<div class="why">No request: {escape(track.reason)}</div>')
    return lines


def approach_html(view: Snapshot) -> str:
    """What is approached, how far it is, and why nothing is asked for."""
    target = view.approach
    if target is None or not view.fresh(APPROACH):
        return card(row("Approach", '<span class="d">no word from it</span>'))
    if target.state == "idle":
        return card(row("Approach", '<span class="d">nothing selected</span>'))
    look = "g" if target.state == "tracking" else "o"
    name = f'<b class="{look}">{escape(target.label or "selected thing")}</b>'
    lines = [row("Approach", f"{name}, {target.distance_m:.1f} m, to {target.goal_m:.1f} m")]
    if target.reason:
        lines.append(f'<div class="why">No request: {escape(target.reason)}</div>')
    return card("".join(lines))


def where(forward_m: float, right_m: float) -> str:
    """A place seen from the vehicle, in words."""
    return (
        f"{abs(forward_m):.2f} m {'ahead' if forward_m >= 0 else 'behind'}, "
        f"{abs(right_m):.2f} m {'right' if right_m >= 0 else 'left'}"
    )


def checks_html(view: Snapshot) -> str:
    """The preflight gate: open or not, then each check with what was found and what to do; failing ones first."""
    status = view.status
    if status is None or not status.preflight:
        return card('<div class="why">No preflight list from helm yet.</div>')
    if not view.fresh(STATUS):
        head = '<div class="gate"><b class="o">This list is old: no word from helm.</b></div>'
    elif failing := sum(not item.ok for item in status.preflight):
        head = f'<div class="gate"><b class="r">Gate closed</b>: {failing} of {len(status.preflight)} checks fail</div>'
    else:
        head = f'<div class="gate"><b class="g">Gate open</b>: all {len(status.preflight)} checks pass</div>'
    items = []
    for item in sorted(status.preflight, key=lambda i: i.ok):
        mark = '<b class="g">✓</b>' if item.ok else '<b class="r">✗</b>'
        found, cure = item.found_and_cure()
        to_do = f'<small class="do">{escape(cure[:1].upper() + cure[1:])}</small>' if cure else ""
        items.append(
            f'<div class="ck">{mark}<span>{escape(item.name)}</span><small>{escape(found)}</small>{to_do}</div>'
        )
    return card(head + "".join(items))


def nodes_html(view: Snapshot, nodes: tuple[str, ...], picture_rate_hz: float) -> str:
    """Which nodes live, how they do, and how old each input of the console is."""
    head = "<tr><th>node</th><th>step ms</th><th>errors</th><th>refused</th><th>lost</th></tr>"
    lines = [head]
    for name in nodes:
        count = None if view.alive is None else view.alive.get(name, 0)
        health = view.health.get(name)
        # One that never spoke may not belong to this vehicle.
        gone = '<b class="d">○</b>' if health is None else '<b class="r">●</b>'
        dot = {None: '<b class="d">?</b>', 0: gone, 1: '<b class="g">●</b>'}.get(count, f'<b class="o">×{count}</b>')
        if health is None or not view.fresh(health_topic(name).name):
            lines.append(f'<tr><td>{dot} {escape(name)}</td><td class="d" colspan="4">no health</td></tr>')
            continue
        errors = f'<b class="r">{health.errors}</b>' if health.errors else "0"
        lines.append(
            f"<tr><td>{dot} {escape(name)}</td><td>{health.step_ms_median:.1f} / {health.step_ms_max:.0f}</td>"
            f"<td>{errors}</td><td>{sum(health.rejected.values())}</td><td>{sum(health.dropped.values())}</td>"
            f"</tr>"
        )
    ages = ["<tr><th>input</th><th>age</th><th>limit</th></tr>"]
    for name, age in view.ages_ms.items():
        limit = topic(name).max_age_ms
        if name.startswith("health/"):
            continue
        look, text = ("d", "none yet") if age < 0 else ("g" if age <= limit else "r", _age(age))
        ages.append(f'<tr><td>{escape(name)}</td><td class="{look}">{text}</td><td class="d">{_age(limit)}</td></tr>')
    rate = row("Pictures", f"{picture_rate_hz:.1f} a second")
    return card(f"<table>{''.join(lines)}</table>{rate}<table>{''.join(ages)}</table>{_session(view)}")


def _session(view: Snapshot) -> str:
    if view.session is None or not view.fresh(SESSION):
        return ""
    return row("Vehicle", escape(view.session.vehicle))


def _age(age_ms: float) -> str:
    return f"{age_ms:.0f} ms" if age_ms < 1000 else f"{age_ms / 1000:.1f} s"


def last_html(last: LastCommand | None, t_ns: int) -> str:
    """The line of the newest command."""
    if last is None:
        return card('<div class="last">No command yet</div>')
    return card(_command(last, t_ns))


def log_html(commands: Iterable[LastCommand], t_ns: int) -> str:
    """The newest commands, newest first."""
    lines = "".join(f'<div style="margin-bottom:4px">{_command(c, t_ns)}</div>' for c in commands)
    return card(lines or '<div class="why">No command yet.</div>')


def _command(last: LastCommand, t_ns: int) -> str:
    look = _OUTCOME_CLASS[last.outcome]
    word = "…" if last.outcome == "running" else last.outcome
    reason = f"<br>{escape(last.reason)}" if last.reason else ""
    ago = max(0, (t_ns - last.t_ns) // 1_000_000_000)
    return (
        f'<div class="last {look}"><small>{ago} s ago</small><b>{escape(last.label)}</b>: {escape(word)}{reason}</div>'
    )
