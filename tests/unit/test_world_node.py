"""The world node, fed over UDP as an autopilot feeds it."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from common.config import Config
from common.geometry.config import CamerasConfig
from common.messages import Image
from common.node import Output, ScriptedRun
from common.truth import Truth
from simulation.world.gl import GlMissingError
from simulation.world.node import WorldNode
from tests.machine import free_port

SECTIONS = {"camera": "common.geometry.config:CamerasConfig", "world": "simulation.world.config:WorldConfig"}
PERIOD_NS = 50_000_000
SCENARIO = """
seed = 2
[ground]
kind = "snow"
size_m = 20.0
texture_px = 256
trees = 0
houses = 0
[car]
bonnet = "#ff00ff"
roof = "#ff00ff"
boot = "#ff00ff"
stripe = "#ff00ff"
[car.path]
waypoints = [ {{ north_m = 1.0, east_m = 0.0 }}, {{ north_m = 1.0, east_m = 3.0 }}, {{ north_m = 4.0, east_m = 1.5 }} ]
{extra}
"""


class Feeder:
    """Sends poses of a vehicle that hovers at a height."""

    def __init__(self, port: int) -> None:
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.peer = ("127.0.0.1", port)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def send(self, up_m: float) -> None:
        message = self.mav.hil_state_quaternion_encode(
            0,
            [1.0, 0.0, 0.0, 0.0],
            0.0,
            0.0,
            0.0,
            473977420,
            85455940,
            488_000 + round(up_m * 1000),
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
        )
        self.udp.sendto(message.pack(self.mav), self.peer)


class World:
    """A node, its feeder, and a scripted run."""

    def __init__(self, folder: Path, extra: str = "", camera: dict | None = None, **world: object) -> None:
        scenario = folder / "test.toml"
        scenario.write_text(SCENARIO.format(extra=extra))
        port = free_port()
        tables = {"world": {"scenario": str(scenario), "port": port, "autopilot_port": 9, **world}}
        tables |= {"camera": camera} if camera else {}
        self.node = WorldNode(Config(tables, SECTIONS), "world")
        self.run = ScriptedRun(self.node)
        self.feeder = Feeder(port)

    def fly(self, frames: int, up_m: float) -> list[list[Output]]:
        """Steps at 20 Hz, in real time, with five poses before each."""
        steps = []
        for _ in range(frames):
            for _ in range(5):
                self.feeder.send(up_m)
                time.sleep(0.01)
            steps.append(self.run.step(time.monotonic_ns()))
        return steps

    def close(self) -> None:
        self.node.close()
        self.feeder.udp.close()


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    made = World(tmp_path)
    yield made
    made.close()


def pictures(steps: list[list[Output]]) -> list[Output]:
    return [o for step in steps for o in step if isinstance(o.message, Image)]


def truths(steps: list[list[Output]]) -> list[Truth]:
    return [o.message for step in steps for o in step if isinstance(o.message, Truth)]


def test_pictures_and_truth_come_with_the_instant_of_rendering_as_their_stamp(world: World) -> None:
    assert world.run.step(time.monotonic_ns()) == []  # no pose yet
    world.fly(4, 0.0)
    before_ns = time.monotonic_ns()
    steps = world.fly(4, 5.0)
    assert [[o.topic for o in step] for step in steps] == [["sim/camera/down", "truth"]] * 4
    picture, truth = steps[-1]
    assert isinstance(picture.message, Image) and (picture.message.width, picture.message.height) == (640, 480)
    assert picture.capture_ns == truth.capture_ns
    stamps = [o.capture_ns or 0 for o in pictures(steps)]
    assert stamps == sorted(stamps)
    assert before_ns - PERIOD_NS < stamps[0] < time.monotonic_ns()
    assert isinstance(truth.message, Truth)
    assert truth.message.ned_p_m[2] == pytest.approx(-5.0, abs=0.05)
    metrics = world.node.metrics()
    assert metrics["stale"] == 1 and 1.0 < metrics["picture_ms_median"] < 200.0


def test_truth_corners_are_where_the_car_is_in_the_picture(world: World) -> None:
    world.fly(2, 0.0)
    steps = world.fly(2, 5.0)
    image, truth = pictures(steps)[-1].message, truths(steps)[-1]
    assert isinstance(image, Image)
    assert truth.target_visible and len(truth.target_corners_px) == 4
    frame = np.frombuffer(image.data, np.uint8).reshape(480, 640, 3).astype(int)
    rows, columns = np.nonzero((frame[..., 0] - frame[..., 1] > 60) & (frame[..., 2] - frame[..., 1] > 60))
    corners = np.array(truth.target_corners_px)
    centre = np.array([np.ptp(columns) / 2 + columns.min(), np.ptp(rows) / 2 + rows.min()])
    assert np.abs(centre - corners.mean(axis=0)).max() < 3.0


def test_the_car_waits_for_the_vehicle_to_be_airborne(world: World) -> None:
    on_ground = truths(world.fly(6, 0.0))
    assert len({t.target_ned_p_m for t in on_ground}) == 1
    in_air = truths(world.fly(8, 5.0))
    assert in_air[-1].target_ned_v_m_s != (0.0, 0.0, 0.0)
    assert in_air[-1].target_ned_p_m != on_ground[0].target_ned_p_m


def test_it_may_set_off_at_once(tmp_path: Path) -> None:
    world = World(tmp_path, car_start="immediately")
    try:
        steps = truths(world.fly(8, 0.0))
        assert np.hypot(*steps[-1].target_ned_v_m_s[:2]) > 0.1
    finally:
        world.close()


def test_nothing_goes_out_while_the_pose_is_stale_and_it_recovers(world: World) -> None:
    world.fly(3, 5.0)
    time.sleep(0.6)
    late = [world.run.step(time.monotonic_ns()) for _ in range(3)]
    # At most one picture of the last instant that the poses cover, with a stamp that says so.
    assert len(pictures(late)) <= 1
    assert all(time.monotonic_ns() - (o.capture_ns or 0) > 500_000_000 for o in pictures(late))
    assert world.node.metrics()["stale"] >= 2
    assert len(pictures(world.fly(2, 5.0))) == 2


def test_nobody_reads_nothing_is_rendered(tmp_path: Path) -> None:
    """Neither colour nor depth; and each of them alone, for those who read that."""
    front = {"width": 64, "height": 48, "fx_px": 40.0, "fy_px": 40.0, "cx_px": 31.5, "cy_px": 23.5}
    world = World(tmp_path, camera={"front": {**front, "depth": {"range_max_m": 8.0}}})
    try:
        world.node.has_reader = lambda topic: topic == "truth"
        steps = world.fly(3, 5.0)
        assert not pictures(steps) and len(truths(steps)) == 3
        metrics = world.node.metrics()
        assert metrics["picture_ms_median"] == metrics["depth_ms_median"] == 0.0
        for read, idle in (("sim/camera/front", "depth_ms_median"), ("sim/camera/front/depth", "")):
            world.node.has_reader = lambda topic, read=read: topic == read
            assert {o.topic for o in pictures(world.fly(2, 5.0))} == {read}
            assert not idle or world.node.metrics()[idle] == 0.0
        assert world.node.metrics()["depth_ms_median"] > 0.0
    finally:
        world.close()


@pytest.mark.slow
def test_lost_frames_do_not_come_and_frozen_ones_come_with_new_stamps(tmp_path: Path) -> None:
    world = World(tmp_path, "[radio]\nlost_probability = 0.3\n[sensor]\nnoise_sigma = 5.0\n")
    try:
        steps = world.fly(30, 5.0)
        lost = world.node.metrics()["lost"]
        assert 3 <= lost <= 25
        assert len(pictures(steps)) == 30 - lost and len(truths(steps)) == 30
    finally:
        world.close()
    world = World(tmp_path, "[radio]\nfrozen_probability = 0.2\nfrozen_s = 0.4\n[sensor]\nnoise_sigma = 5.0\n")
    try:
        sent = pictures(world.fly(30, 5.0))
        data = [o.message.data for o in sent if isinstance(o.message, Image)]
        assert len(data) == 30 and len({o.capture_ns for o in sent}) == 30
        assert 30 - len(set(data)) == world.node.metrics()["frozen"] > 3
    finally:
        world.close()


def test_frames_that_fall_out_are_counted_as_late(world: World) -> None:
    world.feeder.send(0.0)
    start_ns = time.monotonic_ns()
    for period in (0, 1, 2, 3, 6, 7):  # periods 4 and 5 fell out
        world.run.step(start_ns + period * PERIOD_NS)
    assert world.node.metrics()["late_fraction"] == pytest.approx(2 / 7)


def test_a_camera_without_gl_is_one_line_that_names_the_packages() -> None:
    code = "from simulation.world.gl import open_context\nopen_context(64, 48)"
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(Path(__file__).parents[2]), "PYOPENGL_PLATFORM": "glx"},
    )
    assert result.returncode != 0
    last = result.stderr.strip().splitlines()[-1]
    assert "GlMissingError" in last and "libegl1" in last and "libgl1-mesa-dri" in last
    assert issubclass(GlMissingError, Exception)


def test_the_picture_has_the_size_of_the_vehicles_camera(tmp_path: Path) -> None:
    scenario = tmp_path / "s.toml"
    scenario.write_text(SCENARIO.format(extra=""))
    small = {
        "down": {
            "width": 320,
            "height": 240,
            "fx_px": 220.0,
            "fy_px": 220.0,
            "cx_px": 159.5,
            "cy_px": 119.5,
            "rate_hz": 10.0,
        }
    }
    port = free_port()
    config = Config({"camera": small, "world": {"scenario": str(scenario), "port": port}}, SECTIONS)
    node = WorldNode(config, "world")
    try:
        assert config.section(CamerasConfig).down.width == 320
        assert getattr(node.trigger, "period_s", None) == pytest.approx(0.1)
        feeder = Feeder(port)
        run = ScriptedRun(node)
        for _ in range(3):
            feeder.send(4.0)
            time.sleep(0.02)
        image = pictures([run.step(time.monotonic_ns())])[0].message
        assert isinstance(image, Image) and len(image.data) == 320 * 240 * 3
        feeder.udp.close()
    finally:
        node.close()
