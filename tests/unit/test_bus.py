"""The end of a bus: no thread of ours may be left inside Zenoh when the interpreter ends."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from common.bus import Bus
from common.config import Config
from common.messages import Image, Track
from common.node import Inputs, Node, On, Output
from common.runner import Runner
from common.session import BusConfig, open_router
from tests.machine import free_ports

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


def test_a_writer_sees_whether_it_is_read(router: str):
    config = BusConfig(onboard_router=router)
    with Bus(config, "onboard", "writer", wait_s=10) as writer, Bus(config, "onboard", "reader", wait_s=10) as reader:
        writer.declare_output("pursuit/track")
        assert not writer.has_reader("pursuit/track")
        arrived = threading.Event()
        subscription = reader.subscribe("pursuit/track", lambda received: arrived.set())
        assert eventually(lambda: writer.has_reader("pursuit/track"))
        writer.publish("pursuit/track", Track(state="idle"))
        assert arrived.wait(5)
        reader.unsubscribe(subscription)
        assert eventually(lambda: not writer.has_reader("pursuit/track"))
        assert not subscription.thread.is_alive()


class Relay(Node):
    """Passes pictures on, and reads them only while somebody wants them."""

    inputs = ("sim/camera/front",)
    outputs = ("camera/front/raw",)
    on_demand = {"sim/camera/front": ("camera/front/raw",)}
    trigger = On(("sim/camera/front",))

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        received = inputs.latest("sim/camera/front", Image)
        return [] if received is None else [Output("camera/front/raw", received.message)]


def test_the_wish_for_a_stream_reaches_its_source_and_ends_there(router: str):
    config = BusConfig(onboard_router=router)
    stop = threading.Event()
    runner = Runner(Relay(Config({}, {}), "camera"), config, "onboard", stop)
    runner.open()
    thread = threading.Thread(target=runner.run, args=(stop,))
    thread.start()
    picture = Image(camera="front", width=2, height=1, encoding="gray8", data=b"ab")
    try:
        with Bus(config, "onboard", "world", wait_s=10) as world, Bus(config, "onboard", "reader", wait_s=10) as reader:
            world.declare_output("sim/camera/front")
            time.sleep(0.5)
            assert not world.has_reader("sim/camera/front")
            arrived = threading.Event()
            subscription = reader.subscribe("camera/front/raw", lambda received: arrived.set())
            assert eventually(lambda: world.has_reader("sim/camera/front"))
            world.publish("sim/camera/front", picture)
            assert arrived.wait(5)
            reader.unsubscribe(subscription)
            assert eventually(lambda: not world.has_reader("sim/camera/front"))
    finally:
        stop.set()
        runner.wake()
        thread.join(5)
        runner.close()


def eventually(holds: Callable[[], bool], timeout_s: float = 5.0) -> bool:
    """Whether something becomes true in time."""
    deadline_s = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.01)
    return True


def test_a_process_that_closes_its_bus_ends_cleanly(router: str):
    """Before readers were waited for, one in seven such processes died with `FATAL: exception not rethrown`."""
    command = [sys.executable, "-c", _SHORT_LIFE, router, *_TOPICS]
    lives = [subprocess.Popen(command, cwd=_ROOT, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    for life in lives:
        _, errors = life.communicate(timeout=30)
        assert (life.returncode, errors) == (0, "")
