"""What a browser is told of the orders that it gave: that they went out, and how they ended."""

from __future__ import annotations

from typing import Literal

import viser

from common.messages import Command
from ground.console.commands import Action, Commander, LastCommand, by_operator

_NOTE_COLOUR: dict[str, Literal["blue", "green", "orange", "red"]] = {
    "running": "blue",
    "done": "green",
    "refused": "orange",
    "failed": "red",
}
_NOTE_S = {"done": 3.0, "refused": 8.0, "failed": 12.0}


class Notes:
    """Gives orders for browsers, and tells each of its own.

    Args:
        commander: runs the commands.
    """

    def __init__(self, commander: Commander):
        self._commander = commander

    def give(self, client: viser.ClientHandle, action: Action, argument: Command) -> None:
        """Give an action's commands for a browser, which is told when they go out and how they end."""
        note: list[viser.NotificationHandle] = []

        def report(entry: LastCommand) -> None:
            if entry.outcome == "running":
                note.append(
                    client.add_notification(
                        entry.label, "waiting for the reply …", loading=True, with_close_button=False, color="blue"
                    )
                )
                return
            for waiting in note:
                waiting.remove()
            client.add_notification(
                f"{entry.label}: {entry.outcome}",
                entry.reason,
                color=_NOTE_COLOUR[entry.outcome],
                auto_close_seconds=_NOTE_S[entry.outcome],
            )

        if not self._commander.start(action, by_operator(argument, client.client_id), report):
            client.add_notification(
                action.label, "still waiting for the reply to the first press", color="orange", auto_close_seconds=3.0
            )

    def refuse(self, client: viser.ClientHandle, action: Action, reason: str) -> None:
        """Tell a browser that the console itself refuses an action."""
        self._commander.refuse(
            action,
            reason,
            lambda entry: (
                client.add_notification(
                    f"{entry.label}: refused", entry.reason, color="orange", auto_close_seconds=_NOTE_S["refused"]
                )
                and None
            ),
        )
