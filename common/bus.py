"""The bus: Zenoh sessions, one router a side, clients that wait for their router, readers that keep the latest.

Topology and settings follow measurements: a client that waits for its router (`connect/timeout_ms: -1`), a ring in
front of every reader (a callback or a FIFO in front of a slow reader builds seconds of backlog), nothing that blocks
a publisher, no multicast, and loopback unless an endpoint says otherwise.
"""

from __future__ import annotations

import contextlib
import logging
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import msgspec
import zenoh

from common import topics
from common.codec import UNDECODABLE, encode, schema_hash
from common.header import Header, InputRef, Received
from common.messages import Command, Message, MessageError, Reply
from common.session import BusConfig, Side, open_client
from common.subscription import Subscription, survive

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)
_CLOSE_S = 2.0


class Query:
    """A command that arrived; it must be answered exactly once."""

    def __init__(self, name: str, command: Command, query: zenoh.Query, key: str):
        self.name = name
        self.command = command
        self._query = query
        self._key = key

    def reply(self, reply: Reply) -> None:
        """Send the answer to whoever asked; a client that has gone is no error."""
        with contextlib.suppress(zenoh.ZError):
            self._query.reply(self._key, msgspec.msgpack.encode(reply))
            self._query.drop()


class Bus:
    """A node's client session with its side's router. Close it, or the process hangs at exit.

    Args:
        config: endpoints and vehicle name.
        side: whose router to use.
        source: node name, for headers and liveliness.
        wait_s: how long to wait for the router, s; None for ever.
        stop: ends the waiting.

    Raises:
        RouterAbsent: no router within `wait_s`, or told to stop.
    """

    def __init__(
        self,
        config: BusConfig,
        side: Side,
        source: str,
        wait_s: float | None = None,
        stop: threading.Event | None = None,
    ):
        self.config = config
        self.source = source
        self.boot = secrets.randbits(63)
        self._session = open_client(config, side, source, wait_s, stop)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._sequence: Counter[str] = Counter()
        self._open: list[Any] = []
        self._lock = threading.Lock()
        self._readers: list[threading.Thread] = []
        self._asking = 0
        self._asked = threading.Condition()

    def _publisher(self, name: str) -> zenoh.Publisher:
        publisher = self._publishers.get(name)
        if publisher is None:
            topic = topics.topic(name)
            publisher = self._session.declare_publisher(
                topics.key(self.config.vehicle, name),
                encoding=zenoh.Encoding(f"application/x-outrider;schema={topic.type.__name__}"),
                # A reader that stalls must never stall the vehicle: every stream may drop, none may block.
                congestion_control=zenoh.CongestionControl.DROP,
                priority=getattr(zenoh.Priority, topic.priority.upper()),
                express=topic.priority == "real_time",
                reliability=zenoh.Reliability.RELIABLE if topic.reliable else zenoh.Reliability.BEST_EFFORT,
            )
            self._publishers[name] = publisher
        return publisher

    def declare_output(self, name: str) -> None:
        """Announce a stream before its first message, so that readers can be seen to wait for it."""
        with self._lock:
            self._publisher(name)

    def has_reader(self, name: str) -> bool:
        """Whether anyone subscribes to a stream of ours."""
        with self._lock:
            # The stubs call it a bool; it is an object, which is true whatever it says.
            status: Any = self._publisher(name).matching_status
            return status.matching

    def publish(
        self, name: str, message: Message, capture_ns: int | None = None, inputs: tuple[InputRef, ...] = ()
    ) -> Header:
        """Send a message; returns its header.

        Args:
            name: topic.
            message: an instance of the topic's type.
            capture_ns: when the data was true (vehicle clock); None for now.
            inputs: what it was computed from.

        Raises:
            KeyError: unknown topic.
            MessageError: the message breaks its type's promises, or is of another type: it is not sent.
        """
        topic = topics.topic(name)
        if type(message) is not topic.type:
            raise MessageError(f"{name}: got a {type(message).__name__}, expected a {topic.type.__name__}")
        with self._lock:
            sent_ns = time.monotonic_ns()
            header = Header(
                schema_hash(topic.type),
                self.source,
                self.boot,
                self._sequence[name],
                sent_ns,
                sent_ns if capture_ns is None else capture_ns,
                inputs,
            )
            payload, attachment = encode(header, message)
            self._sequence[name] += 1
            self._publisher(name).put(payload, attachment=attachment)
        return header

    def subscribe(self, name: str, callback: Callable[[Received[Any]], None]) -> Subscription:
        """Read a topic; the callback runs in a thread of its own and may be slow: it then skips messages."""
        subscription = Subscription(self._session, self.config.vehicle, topics.topic(name), callback)
        self._open.append(subscription)
        self._readers.append(subscription.thread)
        return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """Stop reading a topic; its callback is not called again once this has returned, unless from its own thread."""
        subscription.close()
        if subscription.thread is not threading.current_thread():
            subscription.thread.join(_CLOSE_S)
        self._open.remove(subscription)
        self._readers.remove(subscription.thread)

    def subscribe_raw(self, pattern: str, callback: Callable[[zenoh.Sample], None], depth: int = 512) -> None:
        """Hand on every sample whose name matches a key pattern, undecoded: for the recorder and `outrider topics`."""
        subscriber = self._session.declare_subscriber(
            topics.key(self.config.vehicle, pattern), zenoh.handlers.RingChannel(depth)
        )
        self._open.append(subscriber)

        def read() -> None:
            while True:
                try:
                    sample = subscriber.recv()
                except Exception:  # noqa: BLE001 — the binding raises several types once the session is closed
                    return
                survive(pattern, lambda s=sample: callback(s))

        reader = threading.Thread(target=read, name=f"read {pattern}", daemon=True)
        self._readers.append(reader)
        reader.start()

    def serve(self, command: str, callback: Callable[[Query], None]) -> None:
        """Answer a command: the callback gets each query and sees that it is answered, now or later."""
        key = topics.key(self.config.vehicle, topics.COMMANDS[command].name)

        def answer(query: zenoh.Query) -> None:
            try:
                payload = query.payload
                argument = msgspec.msgpack.decode(payload.to_bytes(), type=Command) if payload else Command()
                argument.check()
            except (*UNDECODABLE, MessageError) as error:
                refusal = Reply(outcome="refused", reason=f"{command}: malformed argument ({error})")
                query.reply(key, msgspec.msgpack.encode(refusal))
                return
            callback(Query(command, argument, query, key))

        self._open.append(self._session.declare_queryable(key, answer))

    def query(self, command: str, argument: Command | None = None, timeout_s: float | None = None) -> Reply:
        """Ask for a command and wait for the reply; `failed` when nobody answers in time.

        Raises:
            KeyError: unknown command.
        """
        with self._question():
            return self._ask(command, argument or Command(), timeout_s)

    def _ask(self, command: str, argument: Command, timeout_s: float | None) -> Reply:
        timeout_s = topics.COMMANDS[command].timeout_s if timeout_s is None else timeout_s
        asked_s = time.monotonic()
        replies = self._session.get(
            topics.key(self.config.vehicle, command),
            payload=msgspec.msgpack.encode(argument),
            timeout=timeout_s,
            # The default keeps a reply back until every router has closed the query: across two of them, its timeout.
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK_FIRST,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        for reply in replies:
            if reply.ok is not None:
                try:
                    return msgspec.msgpack.decode(reply.ok.payload.to_bytes(), type=Reply)
                except UNDECODABLE as error:
                    return Reply(
                        outcome="failed",
                        reason=f"{command}: malformed reply ({error}); do both sides run the same version of Outrider?",
                    )
        node = command.split("/")[0]
        waited_s = time.monotonic() - asked_s  # shorter than the timeout where the node died meanwhile, or is not there
        return Reply(outcome="failed", reason=f"{command}: no answer in {waited_s:.1f} s; is node {node!r} running?")

    def announce(self) -> None:
        """Say that this node is alive until the session ends."""
        self._open.append(
            self._session.liveliness().declare_token(
                topics.key(self.config.vehicle, f"alive/{self.source}/{self.boot}")
            )
        )

    def alive(self, timeout_s: float = 1.0) -> dict[str, list[int]]:
        """Live nodes: name to the boot identifiers of its processes (more than one is a conflict)."""
        nodes: dict[str, list[int]] = {}
        with self._question(), contextlib.suppress(zenoh.ZError):
            for reply in self._session.liveliness().get(
                topics.key(self.config.vehicle, "alive/*/*"), timeout=timeout_s
            ):
                if reply.ok is not None:
                    *_, name, boot = str(reply.ok.key_expr).split("/")
                    nodes.setdefault(name, []).append(int(boot))
        return nodes

    def connected(self) -> bool:
        """Whether the session has its router."""
        return bool(self._session.info.routers_zid())

    def close(self) -> None:
        """End the session, and with it all readers, answers and the liveliness token.

        No thread is left inside Zenoh: one that comes back from there while the interpreter ends aborts the process
        ("FATAL: exception not rethrown"), as Rust cannot be unwound by Python's end of a thread.
        """
        self._session.close()
        deadline_s = time.monotonic() + _CLOSE_S
        for reader in self._readers:
            if reader is not threading.current_thread():
                reader.join(max(deadline_s - time.monotonic(), 0.0))
        with self._asked:
            self._asked.wait_for(lambda: self._asking == 0, max(deadline_s - time.monotonic(), 0.0))
        self._open.clear()

    @contextlib.contextmanager
    def _question(self) -> Iterator[None]:
        """Counts who waits for replies, so that `close` can wait for them."""
        with self._asked:
            self._asking += 1
        try:
            yield
        finally:
            with self._asked:
                self._asking -= 1
                self._asked.notify_all()

    def __enter__(self) -> Bus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
