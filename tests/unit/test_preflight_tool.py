"""`outrider preflight` on a real bus: the table, the waiting, and each exit code."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator

import pytest

from common.bus import Bus
from common.cli import main
from common.messages import HelmStatus, PreflightItem
from common.session import BusConfig, open_router
from tests.machine import free_ports

GOOD = PreflightItem(name="battery", ok=True, detail="87%; of 60 Wh")
BAD = PreflightItem(name="home", ok=False, detail="not set; wait for the position estimate; then look again")


def status(*items: PreflightItem) -> HelmStatus:
    return HelmStatus(
        state="standby",
        source="",
        reason="on the ground",
        streaming=False,
        mode="HOLD",
        armed=False,
        in_air=False,
        limiter_zone="safe",
        limiter_distance_m=-1.0,
        request_age_ms=-1.0,
        preflight=items,
    )


class Helm:
    """Says one status five times a second."""

    def __init__(self, config: BusConfig):
        self.says: HelmStatus | None = None
        self._bus = Bus(config, "ground", "helm")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(0.05):
            if self.says is not None:
                self._bus.publish("helm/status", self.says)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._bus.close()


@pytest.fixture(scope="module")
def config() -> Iterator[BusConfig]:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    config = BusConfig(ground_router=endpoint, onboard_router=endpoint, link=endpoint)
    router = open_router(BusConfig(onboard_router=endpoint), "onboard")
    yield config
    router.close()


@pytest.fixture
def helm(config: BusConfig) -> Iterator[Helm]:
    helm = Helm(config)
    yield helm
    helm.close()


def run(config: BusConfig, *arguments: str) -> int:
    return main(["preflight", "--set", f"bus.ground_router={config.ground_router}", *arguments])


def test_a_closed_gate_is_a_table_with_reasons_and_cures(
    config: BusConfig, helm: Helm, capsys: pytest.CaptureFixture[str]
) -> None:
    helm.says = status(GOOD, BAD)

    assert run(config) == 1

    head, columns, battery, home = capsys.readouterr().out.splitlines()
    assert head == "kite: gate closed, 1 of 2 checks fail; helm: standby, on the ground"
    assert columns.split() == ["CHECK", "FOUND", "DO"]
    assert battery.split(maxsplit=2) == ["✓", "battery", "87%; of 60 Wh"]
    at = columns.index("DO")
    assert (home[:at].split(maxsplit=2)[2].strip(), home[at:]) == (
        "not set",
        "wait for the position estimate; then look again",
    )


def test_an_open_gate_is_json_and_exit_code_0(
    config: BusConfig, helm: Helm, capsys: pytest.CaptureFixture[str]
) -> None:
    helm.says = status(GOOD)

    assert run(config, "--json") == 0

    shown = json.loads(capsys.readouterr().out)
    assert (shown["vehicle"], shown["open"], shown["state"]) == ("kite", True, "standby")
    assert shown["items"] == [{"name": "battery", "ok": True, "found": "87%; of 60 Wh", "cure": ""}]


def test_an_empty_gate_is_not_open(config: BusConfig, helm: Helm) -> None:
    helm.says = status()
    assert run(config) == 1


def test_waiting_ends_when_the_gate_opens(config: BusConfig, helm: Helm, capsys: pytest.CaptureFixture[str]) -> None:
    helm.says = status(GOOD, BAD)
    threading.Timer(1.0, lambda: setattr(helm, "says", status(GOOD))).start()
    began_s = time.monotonic()

    assert run(config, "--wait", "20") == 0

    assert time.monotonic() - began_s < 10.0
    assert "waiting for: home" in capsys.readouterr().err


def test_waiting_ends_with_the_time_and_the_gate_as_it_is(config: BusConfig, helm: Helm) -> None:
    helm.says = status(BAD)
    assert run(config, "--wait", "0.5") == 1


def test_without_helm_it_is_one_line_and_exit_code_2(
    config: BusConfig, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.preflight_tool._FIRST_WORD_S", 0.3)

    assert run(config) == 2

    error = capsys.readouterr().err.strip()
    assert "no word from helm of vehicle 'kite'; start `outrider onboard`" in error and "\n" not in error


def test_a_helm_that_falls_silent_while_waiting_is_no_gate(config: BusConfig, helm: Helm) -> None:
    helm.says = status(BAD)
    threading.Timer(0.5, lambda: setattr(helm, "says", None)).start()
    assert run(config, "--wait", "2.5") == 2


def test_without_a_router_it_is_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    absent = BusConfig(ground_router=f"tcp/127.0.0.1:{free_ports(1)[0]}")

    assert run(absent) == 2
    assert "no Zenoh router answers" in capsys.readouterr().err
