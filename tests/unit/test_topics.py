"""The tables of streams, commands and processes agree with each other."""

from __future__ import annotations

import inspect

import pytest

from common import topics
from common.config import load_object
from common.messages import Health, Message
from common.node import Every, Node, On
from common.processes import PROCESSES, process, side_processes
from common.truth import Truth

NODES = [name for name, spec in PROCESSES.items() if spec.entry.split(":")[1].endswith("Node")]


@pytest.mark.parametrize("topic", topics.TOPICS.values(), ids=lambda t: t.name)
def test_every_topic_is_complete(topic: topics.Topic) -> None:
    assert issubclass(topic.type, Message)
    assert topic.doc
    assert topic.max_age_ms > 0
    assert not topic.rate_hz or topic.max_age_ms > 1000 / topic.rate_hz, "a stream is fresh for longer than its period"
    assert not set(topic.name) & set("*$?# "), "one plain key"
    assert topics.topic(topic.name) is topic


def test_heavy_streams_are_lossy_and_stay_out_of_the_way() -> None:
    for topic in topics.TOPICS.values():
        if topic.type.__name__ == "Image":
            assert (topic.delivery, topic.reliable, topic.priority) == ("latest", False, "data_low"), topic.name
            assert topic.recorded == topic.crosses_link, "what never leaves the vehicle is not recorded on the ground"


def test_requests_go_first() -> None:
    requests = [t for t in topics.TOPICS.values() if t.name.startswith("helm/request/")]

    assert len(requests) >= 2
    assert {t.priority for t in requests} == {"real_time"}
    assert max(t.max_age_ms for t in requests) <= 300


def test_a_wrong_name_gets_a_suggestion_or_the_list() -> None:
    with pytest.raises(KeyError, match=r"unknown topic 'camera/down/jpg'; did you mean 'camera/down/jpeg'\?"):
        topics.topic("camera/down/jpg")
    with pytest.raises(KeyError, match=r"expected one of .*helm/state"):
        topics.topic("zzz")


def test_each_node_has_a_health_topic() -> None:
    assert topics.topic("health/pursuit") == topics.health_topic("pursuit")
    assert topics.topic("health/pursuit").type is Health


def test_keys_carry_the_vehicle() -> None:
    assert topics.key("kite", "helm/state") == "outrider/kite/helm/state"


def test_commands_name_their_node_and_have_patience() -> None:
    for name, spec in topics.COMMANDS.items():
        node, verb, command = name.split("/")
        assert (spec.name, verb) == (name, "do")
        assert node in PROCESSES
        assert command and spec.doc and spec.timeout_s > 0


@pytest.mark.parametrize("spec", PROCESSES.values(), ids=lambda s: s.name)
def test_every_process_can_be_loaded(spec) -> None:
    entry = load_object(spec.entry)

    assert spec in side_processes(spec.side)
    assert process(spec.name) is spec
    assert spec.doc and spec.extra
    if not inspect.isclass(entry):
        assert list(inspect.signature(entry).parameters) == ["config", "stop"]


@pytest.mark.parametrize("name", NODES)
def test_every_node_declares_what_exists(name: str) -> None:
    node: type[Node] = load_object(PROCESSES[name].entry)

    assert issubclass(node, Node)
    for topic in (*node.inputs, *node.outputs):
        assert topics.topic(topic)
    assert set(node.commands) <= set(topics.COMMANDS)
    assert {c for c in topics.COMMANDS if c.startswith(f"{name}/")} == set(node.commands), "each command is answered"
    trigger = getattr(node, "trigger", None)
    if isinstance(trigger, On) and node.inputs:  # some nodes collect their inputs when they are made
        assert set(trigger.topics) <= set(node.inputs)
    if isinstance(trigger, Every):
        assert trigger.period_s > 0


def test_no_stream_has_two_writers_and_every_input_has_one() -> None:
    nodes = {name: load_object(PROCESSES[name].entry) for name in NODES}
    writers = [topic for node in nodes.values() for topic in node.outputs]
    read = {topic for node in nodes.values() for topic in node.inputs}

    assert len(writers) == len(set(writers))
    # Health is written by the framework, the session by the vehicle's router, the others by what users bring:
    # sensors of obstacles, a stick.
    obstacles = {"obstacles/depth", "obstacles/people", "obstacles/circles"}
    from_elsewhere = {"session", "helm/request/operator", *obstacles}
    assert {t for t in read - set(writers) if not t.startswith("health/")} <= from_elsewhere


def test_only_the_simulation_touches_the_truth() -> None:
    truths = {t.name for t in topics.TOPICS.values() if t.type is Truth}
    for name in NODES:
        node = load_object(PROCESSES[name].entry)
        if PROCESSES[name].side != "sim":
            assert not truths & {*node.inputs, *node.outputs}, name
