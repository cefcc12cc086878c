"""The stick: when a page's word counts, what one hand and two hands ask for, and who may speak at its socket."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets import ConnectionClosed, InvalidStatus, Origin
from websockets.sync.client import connect

from common.cli_parser import make_parser
from common.config import ConfigError, build
from common.stick_command import push_of
from ground.console.config import ConsoleConfig
from ground.console.password import make_hash, write_hash
from ground.console.server import open_server
from ground.console.stick import Speeds, Stand, Stick, StickError, read_stand
from ground.console.stick_link import StickLink
from tests.machine import free_port

MS = 1_000_000
SPEEDS = Speeds(2.0, 0.7, 0.6)
FORWARD, CENTRED = {"forward": 1.0}, {}


def say(stick: Stick, number: int, axes: dict[str, float], t_ms: int, beat_ms: int | None = None) -> None:
    stick.move(number, Stand(beat=t_ms - 60 if beat_ms is None else beat_ms, **axes), t_ms * MS)


def vector(stick: Stick, t_ms: int) -> tuple[float, float, float] | None:
    asked = stick.ask(t_ms * MS, SPEEDS)
    return None if asked is None else asked.request.vector


def test_a_hand_moves_and_its_release_is_a_hover_for_a_moment_then_silence() -> None:
    stick = Stick()
    hand = stick.join()
    say(stick, hand, CENTRED, 1000)
    assert vector(stick, 1000) is None, "a stick at rest asks for nothing"
    say(stick, hand, FORWARD, 1050)
    asked = stick.ask(1060 * MS, SPEEDS)
    assert asked is not None
    assert asked.request.vector == (2.0, 0.0, 0.0)
    assert asked.heard_ns == 1050 * MS, "it is as old as the page's word"
    assert stick.ask(1070 * MS, SPEEDS) is None, "no faster than 25 Hz"
    say(stick, hand, CENTRED, 1100)
    assert vector(stick, 1110) == (0.0, 0.0, 0.0)
    assert vector(stick, 1340) == (0.0, 0.0, 0.0)
    assert vector(stick, 1500) is None


@pytest.mark.parametrize("ending", ["silent", "gone", "behind"])
def test_a_hand_that_cannot_be_believed_hovers(ending: str) -> None:
    stick = Stick()
    hand = stick.join()
    say(stick, hand, FORWARD, 1000)
    assert vector(stick, 1010) == (2.0, 0.0, 0.0)
    if ending == "gone":
        stick.leave(hand)
        assert vector(stick, 1060) == (0.0, 0.0, 0.0)
    elif ending == "behind":
        say(stick, hand, FORWARD, 1050, beat_ms=400)
        assert vector(stick, 1060) == (0.0, 0.0, 0.0)
        assert "slow" in stick.note(hand, 1060 * MS)
    else:
        assert vector(stick, 1199) == (2.0, 0.0, 0.0)
        assert vector(stick, 1250) == (0.0, 0.0, 0.0)
    assert vector(stick, 1900) is None


def test_after_a_long_silence_it_must_be_let_go_first() -> None:
    stick = Stick()
    hand = stick.join()
    say(stick, hand, FORWARD, 1000)
    say(stick, hand, FORWARD, 1400)
    assert vector(stick, 1410) == (2.0, 0.0, 0.0), "a hiccup passes"
    say(stick, hand, FORWARD, 2000)
    assert vector(stick, 2010) is None
    assert stick.note(hand, 2010 * MS) == "let go and push again"
    say(stick, hand, CENTRED, 2050)
    say(stick, hand, FORWARD, 2100)
    assert vector(stick, 2110) == (2.0, 0.0, 0.0)


def test_a_second_hand_that_joins_stops_the_first_until_it_lets_go() -> None:
    stick = Stick()
    first = stick.join()
    say(stick, first, FORWARD, 1000)
    assert vector(stick, 1010) == (2.0, 0.0, 0.0)
    stick.join()
    assert vector(stick, 1060) == (0.0, 0.0, 0.0)
    say(stick, first, FORWARD, 1100)
    assert vector(stick, 1110) == (0.0, 0.0, 0.0)
    say(stick, first, CENTRED, 1150)
    say(stick, first, FORWARD, 1200)
    assert vector(stick, 1210) == (2.0, 0.0, 0.0)


def test_two_hands_that_move_hover_until_both_let_go() -> None:
    stick = Stick()
    hands = stick.join(), stick.join()
    for hand in hands:
        say(stick, hand, FORWARD, 1000)
    assert vector(stick, 1010) is None
    say(stick, hands[0], CENTRED, 1050)
    say(stick, hands[1], FORWARD, 1050)
    assert vector(stick, 1060) is None, "the other one still pushes"
    assert "another page" in stick.note(hands[1], 1060 * MS)
    say(stick, hands[0], FORWARD, 1100)
    assert vector(stick, 1110) == (2.0, 0.0, 0.0)


def test_a_diagonal_is_no_faster_and_up_is_up() -> None:
    stick = Stick()
    say(stick, stick.join(), {"forward": 1.0, "right": -1.0, "up": 1.0, "turn": -0.5}, 1000)
    asked = stick.ask(1000 * MS, SPEEDS)
    assert asked is not None
    assert math.hypot(*asked.request.vector[:2]) == pytest.approx(2.0)
    assert asked.request.vector[1] < 0.0
    assert asked.request.vector[2] == pytest.approx(-0.7)
    assert asked.request.yaw_rate_rad_s == pytest.approx(-0.3)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"beat":1,"forward":1.01}', '{"beat":1,"forward":NaN}', '{"beat":1,"speed":9}', '{"beat":"1"}']
)
def test_what_is_no_position_of_a_stick_is_refused(text: str) -> None:
    with pytest.raises(StickError, match=r"^stick: got .*expected"):
        read_stand(text)


def test_a_stick_faster_than_the_page_offers_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"stick_speed_m_s: got 4.*at most stick_speed_max_m_s = 3"):
        build(ConsoleConfig, {"stick_speed_m_s": 4.0}, "test")


# ---------------------------------------------------------------- its socket, on the real server

PASSWORD = "two hands are one too many"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[int, Stick]]:
    write_hash(tmp_path / "password", make_hash(PASSWORD))
    port = free_port()
    stick = Stick()
    config = ConsoleConfig(host="0.0.0.0", port=port, password_file=str(tmp_path / "password"))
    server = open_server(config, "test", (StickLink(stick),))
    yield port, stick
    server.stop()


def test_the_socket_needs_the_password_and_a_page_of_ours(served: tuple[int, Stick]) -> None:
    from tests.unit.test_console_gate import Client, basic

    port, stick = served
    client = Client(port)
    url = f"ws://127.0.0.1:{port}/stick"
    credentials = {"Authorization": basic(PASSWORD)}

    assert client.get("/stick")[0] == 401
    with pytest.raises(InvalidStatus, match="401"):
        connect(url, proxy=None)
    with pytest.raises(InvalidStatus, match="403"):
        connect(url, proxy=None, origin=Origin("https://evil.example"), additional_headers=credentials)
    assert stick.hands == 0

    status, headers, text = client.get("/stick", **credentials)
    assert (status, headers["X-Frame-Options"]) == (200, "SAMEORIGIN")
    assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]
    assert "Take stick" in text
    assert client.get("/", **credentials)[1]["X-Frame-Options"] == "DENY"

    with connect(url, proxy=None, additional_headers=credentials) as page:
        beat = json.loads(page.recv(timeout=5))["beat"]
        page.send(json.dumps({"beat": beat, "forward": 1.0}))
        deadline = time.monotonic() + 5
        while (asked := stick.ask(time.monotonic_ns(), SPEEDS)) is None and time.monotonic() < deadline:
            time.sleep(0.005)
        assert asked is not None
        assert asked.request.vector == (2.0, 0.0, 0.0)
        page.send('{"beat":1,"forward":7}')
        with pytest.raises(ConnectionClosed, match="1008"):
            while True:
                page.recv(timeout=5)
    deadline = time.monotonic() + 5
    while stick.hands and time.monotonic() < deadline:
        time.sleep(0.01)
    assert stick.hands == 0, "the hand is gone with its page"


# ---------------------------------------------------------------- the command line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--forward", "nan"], "--forward: got nan"),
        (["--for", "3"], "got no motion"),
        (["--forward", "1", "--for", "0"], "--for: got 0"),
        (["--forward", "1", "--for", "61"], "at most 60 s"),
    ],
)
@pytest.mark.parametrize("command", [["stick"], ["do", "stick"]])
def test_the_command_line_refuses_what_it_cannot_hold(command: list[str], words: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        push_of(make_parser().parse_args([*command, *words]))


def test_the_command_line_asks_in_the_heading_frame() -> None:
    push = push_of(make_parser().parse_args(["do", "stick", "--forward", "0.5", "--up", "0.2", "--for", "3"]))
    assert (push.request.frame, push.request.vector, push.duration_s) == ("heading", (0.5, 0.0, -0.2), 3.0)
