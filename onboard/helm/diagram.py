"""Writes the state diagram of `docs/helm.md` from the table: `python -m onboard.helm.diagram`."""

from __future__ import annotations

from pathlib import Path

from onboard.helm.states import TRANSITIONS, Event, State, in_control

BEGIN, END = "<!-- states: written by `python -m onboard.helm.diagram` -->", "<!-- end of states -->"
_PAGE = Path(__file__).parents[2] / "docs" / "helm.md"
_EVERYWHERE = Event.AUTOPILOT_LOST


def diagram() -> str:
    """The state machine as a Mermaid diagram and a table of transitions."""
    lines = ["```mermaid", "stateDiagram-v2", "    [*] --> disconnected"]
    flown = [state for state in State if in_control(state)]
    shared = {
        (event, target)
        for (_, event), target in TRANSITIONS.items()
        if all(TRANSITIONS.get((state, event)) is target for state in flown)
    }
    arrows: dict[tuple[str, str], list[str]] = {}
    for (state, event), target in TRANSITIONS.items():
        source = "flown" if state in flown and (event, target) in shared else state.value
        events = arrows.setdefault((source, target.value), [])
        if event is not _EVERYWHERE and target is not state and event.value not in events:
            events.append(event.value)
    inside = {state.value for state in flown}
    drawn = [(a, b, f"{a} --> {b}: {'<br/>'.join(events)}") for (a, b), events in arrows.items() if events]
    lines += ['    state "flown by helm" as flown {', *(f"        {state.value}" for state in flown)]
    lines += [f"        {text}" for a, b, text in drawn if a in inside and b in inside]
    lines += ["    }", *(f"    {text}" for a, b, text in drawn if not (a in inside and b in inside))]
    lines += [
        "```",
        "",
        f'From every state, "{_EVERYWHERE.value}" leads to `{State.DISCONNECTED.value}`.',
        "",
        "| event | from | to |",
        "|---|---|---|",
    ]
    for event in Event:
        by_target: dict[State, list[str]] = {}
        for (state, happened), target in TRANSITIONS.items():
            if happened is event:
                by_target.setdefault(target, []).append(f"`{state.value}`")
        lines += [f"| {event.value} | {', '.join(states)} | `{target.value}` |" for target, states in by_target.items()]
    return "\n".join(lines)


def rewrite(page: str) -> str:
    """The page with the part between the marks replaced.

    Raises:
        ValueError: the page has no marks.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"docs/helm.md: got no marks {BEGIN!r} and {END!r}; put them where the diagram belongs")
    return f"{before}{BEGIN}\n{diagram()}\n{END}{after}"


def main(page: Path = _PAGE) -> None:
    """Rewrite the page in place."""
    page.write_text(rewrite(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
