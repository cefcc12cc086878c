"""The end of a bus: no thread of ours may be left inside Zenoh when the interpreter ends."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.bus import Bus
from common.messages import Track
from common.session import BusConfig, open_router
from tests.system.stack import free_ports

_ROOT = Path(__file__).parents[2]
_TOPICS = ("helm/*", "health/*", "pursuit/*", "camera/**", "world/**")
_SHORT_LIFE = """
import sys
from common.bus import Bus
from common.session import BusConfig
bus = Bus(BusConfig(onboard_router=sys.argv[1]), "onboard", "short-lived", wait_s=10)
for pattern in sys.argv[2:]:
    bus.subscribe_raw(pattern, lambda sample: None)
bus.close()
"""


@pytest.fixture
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    session = open_router(BusConfig(onboard_router=endpoint), "onboard")
    yield endpoint
    session.close()


def test_closing_waits_for_a_reader_that_is_busy(router: str):
    bus = Bus(BusConfig(onboard_router=router), "onboard", "reader", wait_s=10)
    began = threading.Event()

    def slowly(sample: object) -> None:
        began.set()
        time.sleep(0.4)

    bus.subscribe_raw("pursuit/*", slowly)
    (reader,) = [t for t in threading.enumerate() if t.name == "read pursuit/*"]
    sender = Bus(BusConfig(onboard_router=router), "onboard", "sender", wait_s=10)
    while not began.wait(0.05):
        sender.publish("pursuit/track", Track(state="lost"))
    sender.close()
    bus.close()
    assert not reader.is_alive()


def test_closing_waits_for_a_question_under_way(router: str):
    bus = Bus(BusConfig(onboard_router=router), "onboard", "asker", wait_s=10)
    bus.serve("helm/do/arm", lambda query: None)  # never answers
    ended: list[float] = []
    asker = threading.Thread(target=lambda: (bus.query("helm/do/arm", timeout_s=30.0), ended.append(time.monotonic())))
    asker.start()
    time.sleep(0.2)
    start = time.monotonic()
    bus.close()
    asker.join(0.2)
    assert ended and ended[0] - start < 2.0


def test_a_process_that_closes_its_bus_ends_cleanly(router: str):
    """Before readers were waited for, one in seven such processes died with `FATAL: exception not rethrown`."""
    command = [sys.executable, "-c", _SHORT_LIFE, router, *_TOPICS]
    lives = [subprocess.Popen(command, cwd=_ROOT, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    for life in lives:
        _, errors = life.communicate(timeout=30)
        assert (life.returncode, errors) == (0, "")
