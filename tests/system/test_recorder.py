"""The recorder as a process: what it keeps when it is killed, when the disk is full, when the folder is refused."""

from __future__ import annotations

import resource
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.bus import Bus
from common.messages import Health, Image, Track
from common.recording import Recorded, read_configuration, read_recording
from tests.system.flight import Seen
from tests.system.stack import Stack

MakeStack = Callable[..., Stack]


class Publisher:
    """Stands on the vehicle's side and publishes pictures and tracks at 20 Hz, noting when each was sent."""

    def __init__(self, bus: Bus):
        ok, data = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8))
        assert ok
        self.picture = Image(camera="down", width=320, height=240, encoding="jpeg", data=data.tobytes())
        self.raw = Image(camera="down", width=320, height=240, encoding="bgr8", data=bytes(320 * 240 * 3))
        self.sent_ns: list[int] = []
        self._bus = bus
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(0.05):
            header = self._bus.publish("camera/down/jpeg", self.picture)
            self._bus.publish("camera/down/raw", self.raw)
            self._bus.publish("pursuit/track", Track(state="tracking", x_px=float(header.seq)))
            self.sent_ns.append(header.sent_ns)

    def end(self) -> None:
        """Stop publishing."""
        self._stop.set()
        self._thread.join()


@pytest.fixture
def recorded(make_stack: MakeStack) -> Iterator[tuple[Stack, Publisher, Seen]]:
    """Both routers, the recorder, a publisher on the vehicle's side, and the recorder's health."""
    stack = make_stack()
    stack.start("onboard", "--without", "camera", "--without", "helm")
    stack.start("ground", "--without", "pursuit", "--without", "console")
    health = Seen(stack.bus("ground"), "health/recorder")
    publisher = Publisher(stack.bus("onboard", "camera"))
    try:
        wait_for("recording", stack, lambda: health.last is not None and health.last.metrics["messages"] > 160)
        yield stack, publisher, health
    finally:
        publisher.end()


def wait_for(what: str, stack: Stack, condition: Callable[[], bool], limit_s: float = 20.0) -> None:
    """Wait for a condition; fails with the logs when it does not come."""
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, f"no {what} within {limit_s:.0f} s; {stack.logs()}"
        time.sleep(0.02)


def files(stack: Stack) -> list[Path]:
    """Recordings, oldest first."""
    return sorted((stack.folder / "recordings").glob("*.mcap"))


def of_topic(read: list[Recorded], topic: str) -> list[Recorded]:
    """The messages of one topic."""
    return [r for r in read if r.topic == topic]


def test_a_killed_recorder_loses_at_most_a_second_and_begins_a_new_file(
    recorded: tuple[Stack, Publisher, Seen],
) -> None:
    stack, publisher, health = recorded

    stack.kill("recorder")
    killed_ns = time.monotonic_ns()
    wait_for("second recording", stack, lambda: len(files(stack)) == 2)
    # Messages of the new process, told apart by its process identifier.
    first_pid = health.all[0].message.pid
    wait_for(
        "health of the new recorder",
        stack,
        lambda: health.last.pid != first_pid and health.last.metrics["messages"] > 40,
    )
    publisher.end()
    stack.end()

    first, second = (list(read_recording(path)) for path in files(stack))
    pictures = of_topic(first, "camera/down/jpeg")
    assert all(r.message == publisher.picture for r in pictures)
    numbers = [r.header.seq for r in pictures]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "no picture is missing before the kill"
    assert [r.header.sent_ns for r in pictures] == publisher.sent_ns[numbers[0] : numbers[-1] + 1]
    lost_s = (killed_ns - pictures[-1].header.sent_ns) / 1e9
    assert lost_s < 1.0, f"the last {lost_s:.2f} s before the kill are lost"
    tracks = of_topic(first, "pursuit/track")
    assert [r.message for r in tracks] == [Track(state="tracking", x_px=float(r.header.seq)) for r in tracks]
    assert not of_topic(first, "camera/down/raw"), "raw pictures are not recorded"
    assert of_topic(first, "session") and of_topic(first, "health/recorder")
    assert of_topic(second, "camera/down/jpeg")[0].header.seq > numbers[-1]
    assert read_configuration(files(stack)[0])["bus"]["vehicle"] == "kite"
    assert {path.name.split("_")[1] for path in files(stack)} <= {"kite.mcap", "kite-2.mcap"}


def test_a_disk_that_fills_up_ends_the_recording_and_nothing_else(recorded: tuple[Stack, Publisher, Seen]) -> None:
    stack, _, health = recorded
    pid = stack.pid("recorder")
    assert pid is not None
    limit = files(stack)[0].stat().st_size + 300_000

    resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, limit))
    wait_for("word of the full disk", stack, lambda: health.last.errors == 1)

    said: Health = health.last
    assert "recording has ended" in said.last_error
    assert said.metrics["recording"] == 0.0
    assert stack.log("ground").count("recording has ended") == 1, "said once, in one line"
    assert "Traceback" not in stack.log("ground")
    seen = len(health.all)
    wait_for("health after the error", stack, lambda: len(health.all) > seen + 1)
    assert stack.pid("recorder") == pid
    assert stack.sides["ground"].poll() is None, "the ground station lives"
    kept = of_topic(list(read_recording(files(stack)[0])), "camera/down/jpeg")
    assert len(kept) > 20


def test_a_folder_that_cannot_be_written_is_refused_at_the_start(make_stack: MakeStack, tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file where the folder should be")
    stack = make_stack(f"recorder.folder={taken}")
    stack.start("ground", "--without", "pursuit", "--without", "console")

    assert stack.sides["ground"].wait(20) == 2
    assert f"recorder: cannot write to '{taken}'" in stack.log("ground")
    assert "set recorder.folder" in stack.log("ground")
    assert "Traceback" not in stack.log("ground")


def test_a_recorder_that_is_switched_off_writes_nothing_and_stays(make_stack: MakeStack) -> None:
    stack = make_stack("recorder.enabled=false")
    stack.start("ground", "--without", "pursuit", "--without", "console")
    health = Seen(stack.bus("ground"), "health/recorder")

    wait_for("health", stack, lambda: len(health.all) >= 3)

    assert health.last.metrics["recording"] == 0.0
    assert len({r.message.pid for r in health.all}) == 1, "it is not restarted"
    assert not (stack.folder / "recordings").exists()
