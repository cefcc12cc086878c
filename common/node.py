"""The node: declared inputs and outputs, one trigger, `step(inputs, t_ns) -> outputs`.

The same `step` runs live (`common.runner`), in a test with scripted inputs (`ScriptedRun`) and in a replay. A node
never sees the bus: it gets what is newest, says what goes out, and the framework writes from which messages it came.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

from common import topics
from common.codec import schema_hash
from common.config import Config
from common.header import Header, InputRef, Received
from common.messages import Command, Message, Reply

T = TypeVar("T", bound=Message)
_QUEUE_DEPTH = 256


@dataclass(frozen=True)
class Every:
    """Trigger: at a fixed period."""

    period_s: float
    """Period, s."""


@dataclass(frozen=True)
class On:
    """Trigger: whenever one of these topics brings a message, and at least every so often."""

    topics: tuple[str, ...]
    """Topics that start a step."""
    at_least_every_s: float | None = None
    """Longest time between steps, s; None for no limit."""


class Output(NamedTuple):
    """One message that a step sends."""

    topic: str
    message: Message
    capture_ns: int | None = None
    """When its data was true (vehicle clock); None for the time of the step."""


class Answerable(Protocol):
    """A command that waits for its reply: a query of the bus, or one of a test."""

    name: str
    command: Command

    def reply(self, reply: Reply) -> None:
        """Answer it."""


class CommandCall:
    """A command given to a node; reply at once or in a later step, exactly once.

    Args:
        source: what takes the reply.
    """

    def __init__(self, source: Answerable):
        self.name = source.name
        self.command = source.command
        self.answer: Reply | None = None
        self._source = source

    @property
    def client(self) -> str:
        """Who asks."""
        return self.command.operator or "unknown"

    def reply(self, reply: Reply) -> None:
        """Answer the client.

        Raises:
            RuntimeError: it was answered before.
        """
        if self.answer is not None:
            raise RuntimeError(f"{self.name}: answered twice ({self.answer.outcome}, then {reply.outcome})")
        self.answer = reply
        self._source.reply(reply)


class InputStore:
    """What has arrived and was not consumed yet; written by reader threads, read by the node's thread."""

    def __init__(self, names: Iterable[str]):
        self.condition = threading.Condition()
        self.commands: deque[Answerable] = deque()
        self.dropped: dict[str, int] = {}
        """Messages that a newer one replaced before a step read them."""
        self._latest: dict[str, Received[Any]] = {}
        self._queues: dict[str, deque[Received[Any]]] = {}
        self._unread: set[str] = set()
        self.names = tuple(names)
        for name in self.names:
            self.dropped[name] = 0
            if topics.topic(name).delivery == "queue":
                self._queues[name] = deque()

    def put(self, name: str, received: Received[Any]) -> None:
        """Store a message and wake the node."""
        with self.condition:
            queue = self._queues.get(name)
            if queue is not None:
                queue.append(received)
                if len(queue) > _QUEUE_DEPTH:
                    queue.popleft()
                    self.dropped[name] += 1
            elif name in self._unread:
                self.dropped[name] += 1
            self._latest[name] = received
            self._unread.add(name)
            self.condition.notify()

    def put_command(self, call: Answerable) -> None:
        """Store a command and wake the node."""
        with self.condition:
            self.commands.append(call)
            self.condition.notify()

    def take_command(self) -> Answerable | None:
        """Oldest command that waits, or None."""
        with self.condition:
            return self.commands.popleft() if self.commands else None

    def fresh(self, names: Iterable[str]) -> bool:
        """Whether one of these topics has a message that no step has read. Call with the condition held."""
        return any(name in self._unread for name in names)

    def newest(self, name: str) -> Received[Any] | None:
        """Newest message of a topic, read or not."""
        if name not in self.dropped:
            raise KeyError(f"{name!r} is not among the node's inputs {self.names}; declare it in `inputs`")
        with self.condition:
            self._unread.discard(name)
            return self._latest.get(name)

    def drain(self, name: str) -> list[Received[Any]]:
        """All queued messages of a topic, oldest first."""
        if name not in self._queues:
            raise KeyError(f"{name!r} is no queue among the node's inputs; only topics with queue delivery are drained")
        with self.condition:
            self._unread.discard(name)
            items = list(self._queues[name])
            self._queues[name].clear()
            return items

    def mark_read(self, names: Iterable[str]) -> None:
        """Count these topics as read, so that a step that ignores its trigger does not run again for it."""
        with self.condition:
            self._unread.difference_update(names)

    def ages_ms(self, t_ns: int) -> dict[str, float]:
        """Age of the newest message of each input, ms; -1 when none has come."""
        with self.condition:
            return {
                name: (t_ns - self._latest[name].received_ns) / 1e6 if name in self._latest else -1.0
                for name in self.names
            }


class Inputs:
    """What one step sees; notes what was consumed for the headers of its outputs."""

    def __init__(self, store: InputStore, t_ns: int):
        self._store = store
        self._t_ns = t_ns
        self._consumed: dict[str, InputRef] = {}

    def latest(self, topic: str, kind: type[T]) -> Received[T] | None:
        """Newest message, or None when there is none or it is older than the topic's maximum age."""
        received = self._store.newest(topic)
        if received is None or self._t_ns - received.received_ns > topics.topic(topic).max_age_ms * 1e6:
            return None
        self._consumed[topic] = received.reference(topic)
        return received

    def peek(self, topic: str, kind: type[T]) -> Received[T] | None:
        """Newest message whatever its age, without noting it as consumed."""
        return self._store.newest(topic)

    def drain(self, topic: str, kind: type[T]) -> list[Received[T]]:
        """All messages of a queue topic since the last call, oldest first."""
        received = self._store.drain(topic)
        if received:
            self._consumed[topic] = received[-1].reference(topic)
        return received

    @property
    def consumed(self) -> tuple[InputRef, ...]:
        """References to the messages that were read so far."""
        return tuple(self._consumed.values())


class Node(ABC):
    """Base of every node. Subclasses set the declarations and `step`.

    The runner gives it three functions of the bus: `has_reader(topic)`, whether anyone reads an output; `query(command,
    argument)`, which asks another node and blocks until it answers (never call it inside `step`: use a thread); and
    `alive()`, the live nodes by name.

    Args:
        config: all sections; a node takes its own.
        name: name of this process, as in the process table.
    """

    inputs: tuple[str, ...] = ()
    """Topics it reads."""
    outputs: tuple[str, ...] = ()
    """Topics it writes."""
    on_demand: dict[str, tuple[str, ...]] = {}
    """Inputs that are subscribed only while somebody reads one of these outputs: so the wish for a heavy stream reaches
    its source, which then makes none that nobody reads. A node with another reason to read them overrides `wants`."""
    commands: tuple[str, ...] = ()
    """Commands it answers."""
    trigger: Every | On
    """When `step` runs."""
    exclusive: bool = False
    """Whether a second process of this node for the same vehicle must refuse to start."""

    def __init__(self, config: Config, name: str):
        self.config = config
        self.name = name
        self.has_reader: Callable[[str], bool] = _everyone_reads
        self.query: Callable[[str, Command], Reply] = _nobody_answers
        self.alive: Callable[[], dict[str, list[int]]] = dict

    def wants(self, topic: str) -> bool:
        """Whether an input that `on_demand` names is to be read now; asked five times a second."""
        return any(self.has_reader(output) for output in self.on_demand[topic])

    @abstractmethod
    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """One step at a time (monotonic, ns): what goes out."""

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """A command arrived; runs in the thread of `step`. Reply now, or keep the call and reply later."""
        call.reply(Reply(outcome="refused", reason=f"{self.name} does not answer {call.name}"))
        return ()

    def metrics(self) -> dict[str, float]:
        """Figures for the health message."""
        return {}

    def close(self) -> None:  # noqa: B027  most nodes hold nothing
        """Release devices, threads and files."""


def _everyone_reads(topic: str) -> bool:
    return True


def _nobody_answers(command: str, argument: Command) -> Reply:
    return Reply(outcome="failed", reason=f"{command}: this node is not on a bus")


class ScriptedCall:
    """A command without a bus: whoever gives it reads `CommandCall.answer`.

    Args:
        name: of the command.
        command: its argument.
    """

    def __init__(self, name: str, command: Command):
        self.name = name
        self.command = command

    def reply(self, reply: Reply) -> None:
        """Nothing to send."""


class ScriptedRun:
    """Runs a node without a bus: feed inputs, step, look at the outputs.

    Args:
        node: the node.
    """

    def __init__(self, node: Node):
        self.node = node
        self.store = InputStore(node.inputs)
        self._sequence: dict[str, int] = {}

    def feed(
        self, topic: str, message: Message, capture_ns: int, received_ns: int | None = None, source: str = "script"
    ) -> None:
        """Give the node a message, as if it had arrived at `received_ns` (default: its capture time)."""
        message.check()
        received_ns = capture_ns if received_ns is None else received_ns
        seq = self._sequence.get(topic, 0)
        self._sequence[topic] = seq + 1
        header = Header(schema_hash(type(message)), source, 1, seq, received_ns, capture_ns)
        self.store.put(topic, Received(message, header, received_ns))

    def step(self, t_ns: int) -> list[Output]:
        """Outputs of one step; each is checked as the bus would."""
        outputs = list(self.node.step(Inputs(self.store, t_ns), t_ns))
        for output in outputs:
            output.message.check()
        return outputs

    def call(self, name: str, command: Command, t_ns: int) -> tuple[CommandCall, list[Output]]:
        """Give the node a command; the call's `answer` is set once the node replied."""
        call = CommandCall(ScriptedCall(name, command))
        return call, list(self.node.on_command(call, Inputs(self.store, t_ns), t_ns))
