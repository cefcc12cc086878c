"""The node framework without a bus: what a step sees, what it is noted to have used, how commands are answered."""

from __future__ import annotations

import threading
from collections.abc import Iterable

import msgspec
import pytest

from common.config import Config
from common.messages import Command, MessageError, Reply, Request, Session, Track, VehicleState
from common.node import CommandCall, Inputs, InputStore, Node, On, Output, ScriptedRun
from tests.flying import flying

MS = 1_000_000
STATE = flying()


class Chaser(Node):
    """Asks for motion towards the track while the state is known."""

    inputs = ("pursuit/track", "helm/state", "session")
    outputs = ("helm/request/pursuit",)
    commands = ("pursuit/do/select", "pursuit/do/stop")
    trigger = On(("pursuit/track",), at_least_every_s=0.5)

    def __init__(self) -> None:
        super().__init__(Config({}, {}), "chaser")
        self.states: list[VehicleState] = []
        self.waiting: list[CommandCall] = []
        self.used: tuple = ()
        self.bad = False

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        self.states = [r.message for r in inputs.drain("helm/state", VehicleState)]
        track = inputs.latest("pursuit/track", Track)
        inputs.peek("session", Session)
        self.used = inputs.consumed
        if track is None:
            return
        speed = float("nan") if self.bad else track.message.x_px
        yield Output("helm/request/pursuit", Request(frame="ned", vector=(speed, 0.0, 0.0)), track.header.capture_ns)

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        if call.name == "pursuit/do/select":
            self.waiting.append(call)
            return ()
        return super().on_command(call, inputs, t_ns)


@pytest.fixture
def run() -> ScriptedRun:
    return ScriptedRun(Chaser())


def chaser(run: ScriptedRun) -> Chaser:
    assert isinstance(run.node, Chaser)
    return run.node


def test_a_step_turns_inputs_into_outputs(run: ScriptedRun) -> None:
    run.feed("pursuit/track", Track(state="tracking", x_px=2.0), capture_ns=10 * MS, received_ns=15 * MS)

    outputs = run.step(20 * MS)

    assert outputs == [Output("helm/request/pursuit", Request(frame="ned", vector=(2.0, 0.0, 0.0)), 10 * MS)]


def test_only_the_newest_is_seen_and_the_skipped_are_counted(run: ScriptedRun) -> None:
    for x in (1.0, 2.0, 3.0):
        run.feed("pursuit/track", Track(state="tracking", x_px=x), capture_ns=10 * MS)

    request = run.step(20 * MS)[0].message
    assert isinstance(request, Request)

    assert request.vector[0] == 3.0
    assert run.store.dropped["pursuit/track"] == 2
    run.feed("pursuit/track", Track(state="tracking"), capture_ns=30 * MS)
    assert run.store.dropped["pursuit/track"] == 2, "the read one is no loss"


def test_what_is_older_than_its_topic_allows_is_not_there(run: ScriptedRun) -> None:
    run.feed("pursuit/track", Track(state="tracking"), capture_ns=0, received_ns=100 * MS)

    assert len(run.step(600 * MS)) == 1, "500 ms after receipt"
    assert run.step(601 * MS) == []


def test_age_counts_from_receipt_not_from_capture(run: ScriptedRun) -> None:
    run.feed("pursuit/track", Track(state="tracking"), capture_ns=-10_000 * MS, received_ns=0)

    assert len(run.step(100 * MS)) == 1


def test_a_queue_gives_everything_once_in_order(run: ScriptedRun) -> None:
    states = [STATE, msgspec.structs.replace(STATE, armed=False)]
    for state in states:
        run.feed("helm/state", state, capture_ns=1)

    run.step(2)
    assert chaser(run).states == states
    run.step(3)
    assert chaser(run).states == []


def test_a_full_queue_drops_the_oldest_and_counts(run: ScriptedRun) -> None:
    for i in range(300):
        run.feed("helm/state", STATE, capture_ns=i)

    received = run.store.drain("helm/state")

    assert [r.header.seq for r in received] == list(range(44, 300))
    assert run.store.dropped["helm/state"] == 44


def test_the_header_lists_what_was_consumed_and_nothing_else(run: ScriptedRun) -> None:
    run.feed("session", Session(vehicle="kite", monotonic_ns=1, utc_ns=2), capture_ns=1 * MS)
    run.feed("helm/state", STATE, capture_ns=2 * MS)
    run.feed("helm/state", STATE, capture_ns=3 * MS)
    run.feed("pursuit/track", Track(state="tracking"), capture_ns=4 * MS, received_ns=6 * MS, source="pursuit")

    run.step(10 * MS)

    used = {ref.topic: ref for ref in chaser(run).used}
    assert set(used) == {"helm/state", "pursuit/track"}, "a peek is not noted"
    assert used["helm/state"].seq == 1, "the newest of the queue stands for it"
    track = used["pursuit/track"]
    assert (track.source, track.capture_ns, track.received_ns) == ("pursuit", 4 * MS, 6 * MS)


def test_reading_what_was_not_declared_is_an_error(run: ScriptedRun) -> None:
    inputs = Inputs(run.store, 0)

    with pytest.raises(KeyError, match="'helm/status' is not among the node's inputs"):
        inputs.latest("helm/status", Track)
    with pytest.raises(KeyError, match="'pursuit/track' is no queue"):
        inputs.drain("pursuit/track", Track)
    with pytest.raises(KeyError, match="did you mean 'helm/state'"):
        InputStore(["helm/stat"])


def test_an_invalid_output_fails_the_test_as_the_bus_would_refuse_it(run: ScriptedRun) -> None:
    chaser(run).bad = True
    run.feed("pursuit/track", Track(state="tracking"), capture_ns=1)

    with pytest.raises(MessageError, match="vector: got nan"):
        run.step(2)


def test_a_command_may_be_answered_in_a_later_step(run: ScriptedRun) -> None:
    call, outputs = run.call("pursuit/do/select", Command(operator="Ada"), t_ns=1)

    assert call.answer is None
    assert call.client == "Ada"
    assert outputs == []
    chaser(run).waiting[0].reply(Reply(outcome="done"))
    assert call.answer == Reply(outcome="done")


def test_a_command_is_answered_once(run: ScriptedRun) -> None:
    call, _ = run.call("pursuit/do/select", Command(), t_ns=1)
    call.reply(Reply(outcome="done"))

    with pytest.raises(RuntimeError, match=r"pursuit/do/select: answered twice \(done, then failed\)"):
        call.reply(Reply(outcome="failed"))
    assert call.client == "unknown"


def test_a_command_that_nobody_handles_is_refused(run: ScriptedRun) -> None:
    call, _ = run.call("pursuit/do/stop", Command(), t_ns=1)

    assert call.answer == Reply(outcome="refused", reason="chaser does not answer pursuit/do/stop")


def test_off_the_bus_everyone_reads_and_nobody_answers(run: ScriptedRun) -> None:
    assert run.node.has_reader("helm/request/pursuit")
    assert run.node.query("helm/do/hold", Command()).outcome == "failed"
    assert run.node.alive() == {}
    assert run.node.metrics() == {}


def test_ages_are_given_for_every_input(run: ScriptedRun) -> None:
    run.feed("pursuit/track", Track(state="idle"), capture_ns=0, received_ns=5 * MS)

    assert run.store.ages_ms(25 * MS) == {"pursuit/track": 20.0, "helm/state": -1.0, "session": -1.0}


def test_a_message_wakes_whoever_waits_for_it() -> None:
    store = InputStore(["pursuit/track", "session"])
    woken: list[bool] = []

    def wait() -> None:
        with store.condition:
            woken.append(store.condition.wait_for(lambda: store.fresh(["pursuit/track"]), timeout=5.0))

    thread = threading.Thread(target=wait)
    thread.start()
    run = ScriptedRun(Chaser())
    run.store = store
    run.feed("session", Session(vehicle="kite", monotonic_ns=1, utc_ns=2), capture_ns=1)
    assert thread.is_alive()
    run.feed("pursuit/track", Track(state="idle"), capture_ns=1)
    thread.join(2.0)

    assert woken == [True]
    store.mark_read(["pursuit/track"])
    with store.condition:
        assert not store.fresh(["pursuit/track"])
        assert store.fresh(["session"])


def test_a_node_without_a_step_is_refused_when_it_is_made() -> None:
    class Idle(Node):
        trigger = On(())

    with pytest.raises(TypeError, match="step"):
        Idle(Config({}, {}), "idle")  # type: ignore[abstract]
