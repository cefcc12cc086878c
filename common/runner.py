"""Runs one node live: owns the loop, the rate, the bus, health and shutdown."""

from __future__ import annotations

import gc
import logging
import os
import statistics
import threading
import time
from collections import Counter

from common import topics
from common.bus import Bus, Subscription
from common.config import ConfigError
from common.heartbeat import beat
from common.messages import Health, MessageError
from common.node import CommandCall, Every, Inputs, InputStore, Node, On, Output
from common.session import BusConfig, Side

log = logging.getLogger(__name__)

_HEALTH_PERIOD_S = 1.0
_ERRORS_IN_A_ROW = 20
_DEMAND_PERIOD_NS = 200_000_000


class AlreadyRunning(ConfigError):
    """Another process of an exclusive node holds the vehicle."""


class Runner:
    """The live shell around a node.

    Args:
        node: what to run.
        bus_config: where the routers are.
        side: whose router to use.
        stop: ends the waiting for the router.

    Raises:
        RouterAbsent: told to stop before a router came.
    """

    def __init__(self, node: Node, bus_config: BusConfig, side: Side, stop: threading.Event | None = None):
        self.node = node
        self.store = InputStore(node.inputs)
        self.bus = Bus(bus_config, side, node.name, stop=stop)
        self._errors = 0
        self._errors_in_a_row = 0
        self._last_error = ""
        self._steps = 0
        self._durations_ms: list[float] = []
        self._subscriptions: dict[str, Subscription] = {}
        self._next_demand_ns = 0
        self._invalid_outputs: Counter[str] = Counter()

    def open(self) -> None:
        """Join the bus.

        Raises:
            AlreadyRunning: the node is exclusive and another process of it lives.
        """
        if self.node.exclusive:
            self._refuse_second()
        self.bus.announce()
        for name in self.node.outputs:
            self.bus.declare_output(name)
        self.node.has_reader = self.bus.has_reader
        self.node.query = self.bus.query
        self.node.alive = self.bus.alive
        for name in self.node.inputs:
            if name not in self.node.on_demand:
                self._subscribe(name)
        for name in self.node.commands:
            self.bus.serve(name, self.store.put_command)

    def _subscribe(self, name: str) -> None:
        self._subscriptions[name] = self.bus.subscribe(name, lambda r: self.store.put(name, r))

    def _follow_demand(self) -> None:
        """Read the inputs on demand that the node wants now, and no others."""
        now_ns = time.monotonic_ns()
        if now_ns < self._next_demand_ns:
            return
        self._next_demand_ns = now_ns + _DEMAND_PERIOD_NS
        for name in self.node.on_demand:
            wanted = self.node.wants(name)
            if wanted and name not in self._subscriptions:
                self._subscribe(name)
            elif not wanted and name in self._subscriptions:
                self.bus.unsubscribe(self._subscriptions.pop(name))

    def _refuse_second(self) -> None:
        others = self.bus.alive().get(self.node.name, [])
        if others:
            raise AlreadyRunning(
                f"{self.node.name}: vehicle {self.bus.config.vehicle!r} already has one (boot {others[0]:x}); the "
                f"first keeps the stick. Stop it first, or give this vehicle another name with bus.vehicle"
            )

    def run(self, stop: threading.Event) -> int:
        """Step until told to stop; returns the exit code (1 when the node fails again and again)."""
        trigger = self.node.trigger
        next_ns = time.monotonic_ns()
        next_health_ns = next_ns
        gc.collect()
        gc.freeze()  # start-up objects live for ever: keep them out of every later collection's pause
        while not stop.is_set():
            self._follow_demand()
            if isinstance(trigger, Every):
                next_ns = self._wait_until(next_ns, stop) + int(trigger.period_s * 1e9)
                next_ns = max(next_ns, time.monotonic_ns() - int(trigger.period_s * 1e9))
            else:
                self._wait_for(trigger, stop)
            if stop.is_set():
                break
            self._answer_commands()
            self._step(trigger)
            now_ns = time.monotonic_ns()
            if now_ns >= next_health_ns:
                self._publish_health(now_ns)
                next_health_ns = now_ns + int(_HEALTH_PERIOD_S * 1e9)
            if self._errors_in_a_row >= _ERRORS_IN_A_ROW:
                log.error("%d steps failed in a row, giving up: %s", _ERRORS_IN_A_ROW, self._last_error)
                return 1
        return 0

    def close(self) -> None:
        """Release the node and leave the bus."""
        try:
            self.node.close()
        finally:
            self.bus.close()

    def _wait_until(self, due_ns: int, stop: threading.Event) -> int:
        """Sleep until due, answering commands meanwhile; returns the due time."""
        while not stop.is_set():
            remaining_s = (due_ns - time.monotonic_ns()) / 1e9
            if remaining_s <= 0:
                break
            with self.store.condition:
                if not self.store.commands:
                    self.store.condition.wait_for(lambda: bool(self.store.commands) or stop.is_set(), remaining_s)
            self._answer_commands()
        return due_ns

    def _wait_for(self, trigger: On, stop: threading.Event) -> None:
        longest_s = _DEMAND_PERIOD_NS / 1e9 if self.node.on_demand else _HEALTH_PERIOD_S
        limit_s = min(trigger.at_least_every_s or longest_s, longest_s)
        with self.store.condition:
            self.store.condition.wait_for(
                lambda: stop.is_set() or bool(self.store.commands) or self.store.fresh(trigger.topics), limit_s
            )

    def wake(self) -> None:
        """Let a waiting loop look at its stop event."""
        with self.store.condition:
            self.store.condition.notify_all()

    def _answer_commands(self) -> None:
        while (query := self.store.take_command()) is not None:
            t_ns = time.monotonic_ns()
            inputs = Inputs(self.store, t_ns)
            call = CommandCall(query)
            log.info("command %s from %s", call.name, call.client)
            self._guarded(lambda c=call, i=inputs, t=t_ns: list(self.node.on_command(c, i, t)), inputs, t_ns)

    def _step(self, trigger: Every | On) -> None:
        t_ns = time.monotonic_ns()
        if isinstance(trigger, On):
            with self.store.condition:
                due = self.store.fresh(trigger.topics)
            self.store.mark_read(trigger.topics)
            if not due and trigger.at_least_every_s is None:
                return
        inputs = Inputs(self.store, t_ns)
        self._guarded(lambda: list(self.node.step(inputs, t_ns)), inputs, t_ns)
        self._steps += 1
        self._durations_ms.append((time.monotonic_ns() - t_ns) / 1e6)

    def _guarded(self, work: object, inputs: Inputs, t_ns: int) -> None:
        """Run a piece of the node and publish what it returns; an exception is counted, logged and survived."""
        try:
            outputs: list[Output] = work()  # type: ignore[operator]
            self._errors_in_a_row = 0
        except Exception as error:
            self._errors += 1
            self._errors_in_a_row += 1
            self._last_error = f"{type(error).__name__}: {error}"
            if self._errors_in_a_row <= 3:
                log.exception("step failed")
            return
        for output in outputs:
            try:
                self.bus.publish(
                    output.topic,
                    output.message,
                    t_ns if output.capture_ns is None else output.capture_ns,
                    inputs.consumed,
                )
            except MessageError as error:
                if not self._invalid_outputs[output.topic]:
                    log.error("did not send an invalid %s: %s", output.topic, error)
                self._invalid_outputs[output.topic] += 1

    def _publish_health(self, now_ns: int) -> None:
        beat()
        durations, self._durations_ms = self._durations_ms, []
        rejected = {
            f"{s.topic.name}: {reason}": n for s in self._subscriptions.values() for reason, n in s.rejected.items()
        }
        rejected |= {f"own {name}: content": n for name, n in self._invalid_outputs.items()}
        lost = {s.topic.name: s.dropped for s in self._subscriptions.values()}
        self.bus.publish(
            topics.health_topic(self.node.name).name,
            Health(
                node=self.node.name,
                pid=os.getpid(),
                steps=self._steps,
                step_ms_median=statistics.median(durations) if durations else 0.0,
                step_ms_max=max(durations, default=0.0),
                input_age_ms=self.store.ages_ms(now_ns),
                dropped={name: self.store.dropped[name] + lost.get(name, 0) for name in self.store.names},
                rejected=rejected,
                errors=self._errors,
                last_error=self._last_error,
                metrics={k: float(v) for k, v in self.node.metrics().items()},
            ),
        )
