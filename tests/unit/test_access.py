"""Access control: each stream and command in the tables, and what two real routers then let through."""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from common import topics
from common.access import (
    IDENTITIES,
    OPERATORS,
    READ_ON_BOARD,
    RouterSide,
    access_control,
    certificate_name,
    commands_of,
    crossing,
    written_by,
)
from common.bus import Bus
from common.config import load_object
from common.keys import make
from common.messages import Command, Image, Reply, Request
from common.node import Node
from common.processes import PROCESSES, SECTIONS
from common.session import BusConfig, TlsConfig, open_router
from tests.machine import free_ports

NODES = {n: load_object(s.entry) for n, s in PROCESSES.items() if s.entry.split(":")[1].endswith("Node")}
SIDES: tuple[RouterSide, RouterSide] = ("onboard", "ground")


def allowed(side: RouterSide, subject: str, flow: str, message: str) -> set[str]:
    """Keys, without their vehicle, that a subject of a router may use for a message in a direction."""
    table = access_control(side, "kite")
    (policy,) = (p for p in table["policies"] if p["subjects"] == [subject])
    keys = {
        key
        for rule in table["rules"]
        if rule["id"] in policy["rules"] and flow in rule["flows"] and message in rule["messages"]
        for key in rule["key_exprs"]
    }
    assert all(key.startswith("outrider/kite/") for key in keys), "one vehicle's keys and no other's"
    return {key.removeprefix("outrider/kite/") for key in keys}


@pytest.mark.parametrize("side", SIDES)
def test_what_no_rule_allows_is_dropped(side: RouterSide) -> None:
    table = access_control(side, "kite")

    assert table["enabled"] and table["default_permission"] == "deny"
    assert {rule["permission"] for rule in table["rules"]} == {"allow"}
    assert [s["id"] for s in table["subjects"]] == [*IDENTITIES[side], "link"]
    for subject in table["subjects"]:
        assert subject.get("usernames") or subject.get("cert_common_names"), "no subject that fits everybody"
        assert subject["link_protocols"] == (["tls"] if subject["id"] == "link" else ["tcp"])
    rules = [rule["id"] for rule in table["rules"]]
    assert sorted(rules) == sorted(r for p in table["policies"] for r in p["rules"]), "each rule is in one policy"


@pytest.mark.parametrize("topic", topics.TOPICS.values(), ids=lambda t: t.name)
def test_every_stream_is_written_by_its_writers_alone(topic: topics.Topic) -> None:
    for side in SIDES:
        for identity in IDENTITIES[side]:
            may = topic.name in allowed(side, identity, "ingress", "put")
            assert may == (identity in topic.writers), identity
    assert set(topic.writers) <= {i for side in SIDES for i in IDENTITIES[side]}


@pytest.mark.parametrize("topic", topics.TOPICS.values(), ids=lambda t: t.name)
def test_every_stream_crosses_the_link_one_way_or_not_at_all(topic: topics.Topic) -> None:
    upwards = topic.name in READ_ON_BOARD
    downwards = not upwards and topic.crosses_link and not topic.simulated

    assert (topic.name in allowed("onboard", "link", "ingress", "put")) == upwards
    assert (topic.name in allowed("ground", "link", "egress", "put")) == upwards
    assert (topic.name in allowed("onboard", "link", "egress", "put")) == downwards
    assert (topic.name in allowed("ground", "link", "ingress", "put")) == downwards


def test_only_requests_and_the_track_are_written_towards_the_vehicle() -> None:
    assert allowed("onboard", "link", "ingress", "put") == {
        "helm/request/operator",
        "helm/request/pursuit",
        "pursuit/track",
    }
    assert {i for i in IDENTITIES["ground"] if "helm/request/pursuit" in written_by(i)} == {"pursuit"}


@pytest.mark.parametrize("command", topics.COMMANDS)
def test_every_command_is_asked_by_operators_and_answered_by_its_node(command: str) -> None:
    node = command.split("/")[0]
    for side in SIDES:
        for identity in IDENTITIES[side]:
            reached = side == "ground" or node in IDENTITIES["onboard"]
            asks = command in allowed(side, identity, "ingress", "query")
            assert asks == (identity in OPERATORS and reached), identity
            for message in ("reply", "declare_queryable"):
                assert (command in allowed(side, identity, "ingress", message)) == (identity == node), identity
    assert (command in allowed("onboard", "link", "ingress", "query")) == (node in IDENTITIES["onboard"])
    assert not allowed("onboard", "link", "ingress", "reply"), "the ground answers nothing in the vehicle's name"
    assert (command in allowed("ground", "link", "ingress", "reply")) == (node in IDENTITIES["onboard"])


def test_every_process_on_the_bus_has_an_identity_on_its_side() -> None:
    on_no_bus = {"router-ground", "autopilot"}
    for name, spec in PROCESSES.items():
        if name not in on_no_bus:
            assert name in IDENTITIES["ground" if spec.side == "ground" else "onboard"], "add it to common/access.py"


@pytest.mark.parametrize("name", NODES)
def test_every_node_may_do_what_it_declares(name: str) -> None:
    node: type[Node] = NODES[name]

    assert set(node.outputs) <= set(written_by(name))
    assert set(node.commands) == set(commands_of((name,)))
    for topic in node.inputs:
        sides = {side for side in SIDES if set(topics.topic(topic).writers) & set(IDENTITIES[side])}
        own: RouterSide = "ground" if PROCESSES[name].side == "ground" else "onboard"
        assert own in sides or topic in crossing("ground" if own == "onboard" else "onboard"), topic


def test_the_section_of_the_bus_is_registered() -> None:
    assert load_object(SECTIONS["bus"]) is BusConfig


# ---------------------------------------------------------------- two real routers


def options(folder: Path, **changed: Any) -> argparse.Namespace:
    """Options of `outrider keys` as the command line would give them."""
    defaults = {
        "folder": str(folder),
        "vehicle_host": [],
        "ground_host": [],
        "days": 60,
        "ca": None,
        "renew": False,
        "force": False,
    }
    return argparse.Namespace(**(defaults | changed))


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BusConfig]:
    """Both routers with keys of their own, linked."""
    folder = tmp_path_factory.mktemp("secured") / "keys"
    onboard, ground, link = free_ports(3)
    config = BusConfig(
        onboard_router=f"tcp/127.0.0.1:{onboard}",
        ground_router=f"tcp/127.0.0.1:{ground}",
        link=f"tls/127.0.0.1:{link}",
        tls=TlsConfig(folder=str(folder), listen=f"tls/127.0.0.1:{link}"),
    )
    make(options(folder), config)
    routers = [open_router(config, side) for side in SIDES]
    eventually(lambda: bool(list(routers[1].info.routers_zid())))
    yield config
    for router in reversed(routers):
        router.close()


def eventually(condition: Callable[[], bool], limit_s: float = 5.0) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class Party:
    """Sessions of several processes, and what they received."""

    def __init__(self, config: BusConfig):
        self._config = config
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Party:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def end_with(self, close: Callable[[], None]) -> None:
        """Close something else with the party: an open session would hold up the end of the test run."""
        self._stack.callback(close)

    def bus(self, side: RouterSide, name: str) -> Bus:
        """A process's session."""
        return self._stack.enter_context(Bus(self._config, side, name, wait_s=5.0))


def picture() -> Image:
    """A small picture."""
    return Image(camera="down", width=4, height=2, encoding="bgr8", data=np.zeros((2, 4, 3), np.uint8).tobytes())


def request() -> Request:
    """A request to hover."""
    return Request(frame="ned", vector=(0.0, 0.0, 0.0))


def test_pictures_requests_and_commands_cross_and_raw_pictures_do_not(secured: BusConfig) -> None:
    seen: dict[str, list[Any]] = {"camera/down/jpeg": [], "camera/down/raw": [], "truth": [], "helm": []}
    with Party(secured) as party:
        camera, world, helm = (party.bus("onboard", name) for name in ("camera", "world", "helm"))
        pursuit, cli = party.bus("ground", "pursuit"), party.bus("ground", "cli")
        for name in ("camera/down/jpeg", "camera/down/raw"):
            pursuit.subscribe(name, seen[name].append)
        pursuit.subscribe_raw("**", lambda sample: seen["truth"].append(str(sample.key_expr)))
        helm.subscribe("helm/request/pursuit", seen["helm"].append)
        helm.serve("helm/do/hold", lambda query: query.reply(Reply(outcome="done")))
        helm.announce()
        eventually(lambda: camera.has_reader("camera/down/jpeg") and pursuit.has_reader("helm/request/pursuit"))
        eventually(lambda: "helm" in cli.alive())

        camera.publish("camera/down/raw", picture())
        world.publish("sim/camera/down", picture())
        camera.publish("camera/down/jpeg", picture())
        pursuit.publish("helm/request/pursuit", request())
        reply = cli.query("helm/do/hold", Command(operator="test"), timeout_s=2.0)
        eventually(lambda: bool(seen["camera/down/jpeg"] and seen["helm"]))

        assert reply.outcome == "done"
        assert not seen["camera/down/raw"]
        assert set(seen["truth"]) <= {"outrider/kite/camera/down/jpeg", "outrider/kite/helm/request/pursuit"}


def test_a_known_process_cannot_act_for_another(secured: BusConfig) -> None:
    got: list[Any] = []
    answered: list[str] = []
    with Party(secured) as party:
        helm, camera = party.bus("onboard", "helm"), party.bus("onboard", "camera")
        recorder, pursuit = party.bus("ground", "recorder"), party.bus("ground", "pursuit")
        helm.subscribe("helm/request/pursuit", got.append)
        helm.subscribe("helm/request/operator", got.append)
        camera.serve("helm/do/land", lambda query: answered.append(query.name))
        helm.serve("helm/do/hold", lambda query: answered.append(query.name))
        eventually(lambda: pursuit.has_reader("helm/request/pursuit"))

        recorder.publish("helm/request/pursuit", request())
        recorder.publish("helm/request/operator", request())
        pursuit.publish("helm/request/operator", request())
        camera.publish("helm/request/pursuit", request())
        denied = recorder.query("helm/do/hold", Command(operator="test"), timeout_s=0.5)
        unanswered = party.bus("ground", "cli").query("helm/do/land", Command(operator="test"), timeout_s=0.5)
        pursuit.publish("helm/request/pursuit", request())  # the allowed one comes last, and alone
        eventually(lambda: bool(got))

        assert [r.header.source for r in got] == ["pursuit"]
        assert denied.outcome == unanswered.outcome == "failed"
        assert not answered


def outsider(endpoint: str, settings: dict[str, Any]) -> zenoh.Session | None:
    """A session that is not ours, or None when it is not let in within 0.3 s."""
    config = zenoh.Config()
    base = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 300,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
    }
    for path, value in (base | settings).items():
        config.insert_json5(path, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        return None


def tls_of(folder: Path, side: str = "ground", authority: Path | None = None) -> dict[str, Any]:
    """TLS settings of a client that uses a side's certificate."""
    return {
        "transport/link/tls": {
            "root_ca_certificate": str((authority or folder / side) / "ca.pem"),
            "connect_certificate": str(folder / side / "router.pem"),
            "connect_private_key": str(folder / side / "router.key"),
            "enable_mtls": True,
            "verify_name_on_connect": False,
        }
    }


def login(folder: Path, side: str, identity: str) -> dict[str, Any]:
    """Password settings of a client."""
    password = (folder / side / "passwords" / identity).read_text().strip()
    return {"transport/auth/usrpwd": {"user": identity, "password": password}}


def test_strangers_are_not_let_in(secured: BusConfig, tmp_path: Path) -> None:
    keys, other = Path(secured.tls.folder), tmp_path / "other"
    make(options(other), secured)
    trusted = {"transport/link/tls": {"root_ca_certificate": str(keys / "ground/ca.pem"), "enable_mtls": False}}
    link_login = login(keys, "ground", "link")
    attempts = {
        "no certificate": (secured.link, trusted | link_login),
        "a certificate of the same names by another authority": (
            secured.link,
            tls_of(other, authority=keys / "ground") | link_login,
        ),
        "the certificate without the password": (secured.link, tls_of(keys)),
        "plain tcp at the TLS port": (secured.link.replace("tls/", "tcp/"), link_login),
        "no password on loopback": (secured.onboard_router, {}),
        "a password of another `outrider keys`": (secured.onboard_router, login(other, "onboard", "helm")),
        "no password at the ground's router": (secured.ground_router, {}),
    }

    for what, (endpoint, settings) in attempts.items():
        assert outsider(endpoint, settings) is None, what
    session = outsider(secured.link, tls_of(keys) | link_login)
    assert session is not None, "the right certificate and password are let in, by the same way of trying"
    session.close()


def test_another_vehicle_of_the_same_authority_is_let_in_and_allowed_nothing(
    secured: BusConfig, tmp_path: Path
) -> None:
    keys, second = Path(secured.tls.folder), tmp_path / "second"
    make(options(second, ca=str(keys / "ca")), BusConfig(vehicle="heron"))
    got: list[Any] = []
    with Party(secured) as party:
        helm, pursuit = party.bus("onboard", "helm"), party.bus("ground", "pursuit")
        helm.subscribe("helm/request/pursuit", got.append)
        eventually(lambda: pursuit.has_reader("helm/request/pursuit"))
        # The worst case: the other ground station even knows the password of this link.
        session = outsider(secured.link, tls_of(second) | login(keys, "ground", "link"))
        assert session is not None
        party.end_with(session.close)
        frames: list[Any] = []
        session.declare_subscriber("outrider/kite/camera/**", frames.append)
        helm.serve("helm/do/hold", lambda query: query.reply(Reply(outcome="done")))
        camera = party.bus("onboard", "camera")
        time.sleep(0.2)

        session.put("outrider/kite/helm/request/pursuit", b"")
        camera.publish("camera/down/jpeg", picture())
        replies = [r for r in session.get("outrider/kite/helm/do/hold", timeout=0.5) if r.ok is not None]
        pursuit.publish("helm/request/pursuit", request())
        eventually(lambda: bool(got))

        assert [r.header.source for r in got] == ["pursuit"]
        assert not frames and not replies
    assert certificate_name("ground", "heron") == "ground.heron"
