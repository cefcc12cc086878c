"""The console's commands and its web server."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import viser
from websockets import InvalidStatus, Origin, Subprotocol
from websockets.sync.client import connect

from common.config import Config, ConfigError
from common.messages import Command, Reply
from common.node import ScriptedRun
from common.processes import SECTIONS
from common.topics import COMMANDS
from ground.console.commands import (
    BUTTONS,
    HOLD,
    SELECT,
    STOP_CHASE,
    TAKE_OFF,
    Commander,
    LastCommand,
    by_operator,
)
from ground.console.config import ConsoleConfig
from ground.console.gate import may_connect
from ground.console.node import ConsoleNode
from ground.console.server import open_server
from ground.console.style import style_html
from ground.console.watch import LifeWatch
from tests.machine import free_port


def _wait(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < deadline, "nothing happened within 5 s"
        time.sleep(0.005)


def test_every_button_asks_for_commands_that_exist() -> None:
    asked = {name for action in (*BUTTONS, SELECT) for name in action.commands}
    # Orders about people need a name or two, and stand beside their pictures; a search, and the vehicle's own follower,
    # are begun on the command line.
    elsewhere = {name for name in COMMANDS if name.startswith(("people/", "search/", "follow/"))}
    elsewhere |= {"helm/do/search", "helm/do/follow"}
    assert asked | elsewhere == set(COMMANDS), "each command has its button, and no button asks for another"
    assert len({action.label for action in BUTTONS}) == len(BUTTONS)


def test_outcome_is_reported_and_kept() -> None:
    asked: list[tuple[str, Command]] = []

    def query(name: str, argument: Command) -> Reply:
        asked.append((name, argument))
        return Reply(outcome="refused", reason="not in the air")

    commander, reports = Commander(query), []
    assert commander.start(HOLD, by_operator(Command(), 3), reports.append)
    _wait(lambda: len(reports) == 2)
    assert [r.outcome for r in reports] == ["running", "refused"]
    assert asked == [("helm/do/hold", Command(operator="console/3"))]
    assert commander.log == [reports[1]]
    assert commander.log[0].reason == "not in the air"


def test_several_commands_go_out_in_order_and_the_worst_outcome_counts() -> None:
    asked: list[str] = []

    def query(name: str, argument: Command) -> Reply:
        asked.append(name)
        return Reply(outcome="refused", reason="on the ground") if "hold" in name else Reply(outcome="done")

    commander, reports = Commander(query), []
    commander.start(STOP_CHASE, Command(), reports.append)
    _wait(lambda: len(reports) == 2)
    assert asked == ["helm/do/hold", "pursuit/do/stop"]
    assert (reports[1].outcome, reports[1].reason) == ("refused", "on the ground")


def test_slow_command_holds_up_no_other_and_is_not_given_twice() -> None:
    release = threading.Event()

    def query(name: str, argument: Command) -> Reply:
        if name == "helm/do/takeoff":
            release.wait(5.0)
        return Reply(outcome="done")

    commander, reports = Commander(query), []
    assert commander.start(TAKE_OFF, Command(), reports.append)
    assert not commander.start(TAKE_OFF, Command(), reports.append)
    assert commander.start(HOLD, Command(), reports.append)
    _wait(lambda: any(r.label == "Hold" and r.outcome == "done" for r in reports))
    assert [entry.outcome for entry in commander.log] == ["done", "running"]
    release.set()
    _wait(lambda: commander.log[1].outcome == "done")
    assert commander.start(TAKE_OFF, Command(), reports.append)


def test_broken_bus_and_broken_browser_lose_no_outcome() -> None:
    def query(name: str, argument: Command) -> Reply:
        raise OSError("session closed")

    def report(entry: LastCommand) -> None:
        raise RuntimeError("the browser has gone")

    commander = Commander(query)
    commander.start(HOLD, Command(), report)
    _wait(lambda: commander.log and commander.log[0].outcome == "failed")
    assert "session closed" in commander.log[0].reason


@pytest.mark.parametrize(
    ("origin", "host", "loopback", "allowed"),
    [
        ("http://localhost:8080", "localhost:8080", True, True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True, True),
        (None, "127.0.0.1:8080", True, True),
        ("https://evil.example", "127.0.0.1:8080", True, False),
        ("http://localhost:9999", "localhost:8080", True, False),
        ("http://evil.example:8080", "evil.example:8080", True, False),
        ("http://ground.lan:8080", "ground.lan:8080", False, True),
        ("https://evil.example", "ground.lan:8080", False, False),
    ],
)
def test_only_the_consoles_own_page_may_connect(origin: str | None, host: str, loopback: bool, allowed: bool) -> None:
    assert may_connect(origin, host, loopback) is allowed


def test_taken_port_and_foreign_address_are_one_clear_error() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen(1)
        port = holder.getsockname()[1]
        with pytest.raises(ConfigError, match=re.escape(f"console.port: {port} on 127.0.0.1 is taken")):
            open_server(ConsoleConfig(port=port), "test")
    with pytest.raises(ConfigError, match=re.escape("console.host: cannot listen on '192.0.2.1'")):
        open_server(ConsoleConfig(host="192.0.2.1", port=free_port()), "test")
    with pytest.raises(ConfigError, match=re.escape("console.host: got 'no such host'")):
        open_server(ConsoleConfig(host="no such host", port=free_port()), "test")


def test_page_of_another_site_is_thrown_out_before_it_can_command() -> None:
    port = free_port()
    server = open_server(ConsoleConfig(port=port), "test")
    try:
        protocol = Subprotocol(f"viser-v{viser.__version__}")
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://127.0.0.1:{port}", origin=Origin("https://evil.example"), subprotocols=[protocol])
        assert refused.value.response.status_code == 403
        own = Origin(f"http://127.0.0.1:{port}")
        with connect(f"ws://127.0.0.1:{port}", origin=own, subprotocols=[protocol]) as page:
            assert page.recv(timeout=5)
        assert server.request_share_url() is None
    finally:
        server.stop()


def test_node_serves_its_page_on_the_given_address_alone_and_steps_without_a_browser() -> None:
    port = free_port()
    sections = {name: SECTIONS[name] for name in ("bus", "camera", "console")}
    with pytest.raises(
        ConfigError, match=r"console.camera: got 'front', which this vehicle lacks; expected one of down"
    ):
        ConsoleNode(Config({"console": {"port": port, "camera": "front"}}, sections), "console")
    node = ConsoleNode(Config({"console": {"port": port}, "camera": {"front": {}}}, sections), "console")
    assert node.wants("camera/down/jpeg") and not node.wants("camera/front/jpeg"), "one picture at a time"
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=5) as page:
            assert page.getpeername() == ("127.0.0.1", port)
        listeners = [line.split()[1] for line in _tcp_listeners() if line.split()[1].endswith(f":{port:04X}")]
        assert listeners == [f"0100007F:{port:04X}"]
        assert ScriptedRun(node).step(time.monotonic_ns()) == []
        assert node.metrics() == {"browsers": 0.0, "pictures_sent": 0.0, "sticks": 0.0}
    finally:
        node.close()


def _tcp_listeners() -> list[str]:
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    return [line for line in lines if line.split()[3] == "0A"]


def test_life_is_asked_about_only_while_somebody_looks() -> None:
    asked, looking = [], threading.Event()

    def ask() -> dict[str, list[int]]:
        asked.append(1)
        return {"helm": [1, 2], "camera": [3]}

    watch = LifeWatch(ask, looking.is_set)
    watch.start()
    assert watch.alive is None
    assert not asked
    looking.set()
    _wait(lambda: watch.alive is not None)
    assert watch.alive == {"helm": 2, "camera": 1}
    looking.clear()
    _wait(lambda: watch.alive is None)
    watch.close()


def test_style_sheet_names_every_button() -> None:
    html = style_html({f"id-{n}": action.look for n, action in enumerate(BUTTONS)}, 330)
    assert all(f'button[id="id-{n}"]' in html for n in range(len(BUTTONS)))
    assert html.count("<style>") == 1
    assert html.count("{") == html.count("}")
