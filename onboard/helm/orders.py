"""Commands that wait for their reply: each is answered exactly once, when what it asked for is done or has failed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

from common.messages import Command, Reply


class Call(Protocol):
    """A command with somebody waiting for the reply (`common.node.CommandCall`)."""

    name: str
    command: Command

    def reply(self, reply: Reply) -> None:
        """Answer it."""
        ...


@dataclass
class Orders:
    """The commands that are under way, by what ends them."""

    waiting: dict[str, list[Call]] = field(default_factory=dict)
    """Calls by key (`engaged`, `landing`, `takeoff`, `arm`, `disarm`)."""
    deadlines: dict[str, int] = field(default_factory=dict)
    """When a key's calls count as failed, ns."""

    def wait(self, key: str, call: Call, deadline_ns: int) -> None:
        """Keep a call until `settle(key, …)`."""
        self.waiting.setdefault(key, []).append(call)
        self.deadlines[key] = max(self.deadlines.get(key, 0), deadline_ns)

    def move(self, key: str, target: str) -> None:
        """Let the calls of one key wait for another (a takeoff becomes an engagement)."""
        calls = self.waiting.pop(key, [])
        deadline_ns = self.deadlines.pop(key, 0)
        for call in calls:
            self.wait(target, call, deadline_ns)

    def settle(self, key: str, outcome: Literal["done", "refused", "failed"], reason: str) -> None:
        """Answer all calls of a key."""
        self.deadlines.pop(key, None)
        for call in self.waiting.pop(key, []):
            call.reply(Reply(outcome=outcome, reason=reason))

    def fail_all(self, reason: str, keep: tuple[str, ...] = ()) -> None:
        """Answer everything that waits, but for some keys, with `failed`."""
        for key in [k for k in self.waiting if k not in keep]:
            self.settle(key, "failed", reason)

    def expire(self, t_ns: int, reason: Callable[[str], str]) -> None:
        """Fail the calls whose deadline has passed."""
        for key in [k for k, due in self.deadlines.items() if t_ns > due]:
            self.settle(key, "failed", reason(key))
