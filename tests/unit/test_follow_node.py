"""The follow node with scripted inputs and its real trackers: a choice, a follow, a chase beside which it tracks."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, straight
from common.messages import Command, FollowMembers, Image, Reply, Request, Setpoint, Track
from common.node import CommandCall, Output, ScriptedRun
from common.processes import load_config
from onboard.follow.node import FollowNode
from onboard.fusion.config import FusionConfig, HabDfConfig
from tests.flying import flying, helm_status

S = 1_000_000_000
ZERO = (0.0, 0.0, 0.0)
SETTINGS = ('hab_df.members=["dsst"]', "follow.answer_within_s=2.0", "follow.frozen_after_s=20.0")


class Rig:
    """The node on a vehicle that hovers 5 m up, above a car that drives along a row of the picture."""

    def __init__(self, *settings: str):
        self.node = FollowNode(load_config("kite", [*SETTINGS, *settings]), "follow")
        self.run = ScriptedRun(self.node)
        self.frames = Scene(straight(60.0, start_px=260.0), seed=2).frames(10.0)
        self.t_ns = 0
        self.pose = Pose(0.0, 0.0)

    def picture(self) -> list[Output]:
        """Feed the next picture and a state, and step."""
        stamp_ns, frame, self.pose = next(self.frames)
        self.t_ns = S + stamp_ns
        self.run.feed("helm/state", flying(), self.t_ns)
        raw = Image(camera="down", width=640, height=480, encoding="bgr8", data=frame.tobytes())
        self.run.feed("camera/down/raw", raw, self.t_ns)
        return self.run.step(self.t_ns + 1_000_000)

    def call(self, name: str, command: Command) -> str:
        call, _ = self.run.call(f"follow/do/{name}", command, self.t_ns)
        answer = self.answered(call)
        return f"{answer.outcome}: {answer.reason}"

    def answered(self, call: CommandCall) -> Reply:
        """Step, without a further picture, until the trackers are up."""
        end_s = time.monotonic() + 40.0
        while call.answer is None:
            assert time.monotonic() < end_s
            self.run.step(self.t_ns)
            time.sleep(0.02)
        return call.answer

    def requests(self, count: int) -> list[Request]:
        found = []
        for _ in range(count):
            found += [o.message for o in self.picture() if isinstance(o.message, Request)]
        return found

    def target(self) -> Track:
        """The track of the next picture."""
        return next(o.message for o in self.picture() if isinstance(o.message, Track))


def test_without_a_target_nothing_is_asked_and_no_tracker_runs() -> None:
    rig = Rig()
    told = [o for _ in range(12) for o in rig.picture()]
    topics = [o.topic for o in told]
    assert set(topics) == {"follow/track", "follow/members"}
    assert 2 <= topics.count("follow/track") == topics.count("follow/members") <= 4, "five a second"
    assert all(o.message == FollowMembers(camera="down") for o in told if o.topic == "follow/members")
    assert rig.node.metrics() == {}
    assert rig.call("select", Command()) == "refused: select: got no box, expected x, y, width, height in px"
    assert rig.call("stop", Command()).startswith("done")


@pytest.mark.slow
def test_what_was_chosen_is_followed_until_it_is_away_for_long() -> None:
    rig = Rig()
    try:
        rig.picture()
        late = rig.call("select", Command(box_px=rig.pose.box(), capture_ns=rig.t_ns + S))
        assert late == "refused: select: got a box on a picture that is not kept; draw it on the live picture"
        assert rig.call("select", Command(box_px=rig.pose.box(), capture_ns=rig.t_ns)).startswith("done")
        asked = rig.requests(30)
        assert len(asked) >= 28, "from the second picture on"
        # 60 px/s to the right at 4.7 m above the target's top, 440 px focal length: 0.64 m/s east.
        sent = Setpoint(source="pursuit", asked_ned_v_m_s=ZERO, ned_v_m_s=(-0.7, 0.3, 0.0), height_m=5.0, yaw_rad=0.0)
        rig.run.feed("helm/setpoint", sent, rig.t_ns + 20_000_000)
        (taken_over,) = rig.requests(1)
        assert math.dist(taken_over.vector[:2], (-0.7, 0.3)) < 0.1, "it begins at what helm flew before"
        rig.run.feed("helm/status", helm_status("follow"), rig.t_ns)
        asked = rig.requests(30)
        east_m_s = 60.0 / 440.0 * 4.65
        assert asked[-1].vector[1] > east_m_s - 0.1, "as fast as the car, and what it takes to come above it"
        track = rig.target()
        assert track.state == "tracking" and math.hypot(track.x_px - rig.pose.x_px, track.y_px - rig.pose.y_px) < 6.0
        words = [o.message for _ in range(6) for o in rig.picture() if isinstance(o.message, FollowMembers)]
        assert 1 <= len(words) <= 4, "ten a second"
        (member,) = words[-1].members
        assert member.name == "dsst" and member.box_px is not None
        assert abs(member.box_px[0] + member.box_px[2] / 2 - rig.pose.x_px) < 12.0
        assert rig.node._follower is not None
        as_offline = HabDfConfig().of_boxes(FusionConfig())
        assert rig.node._follower.fusion._config == as_offline and as_offline.common_jumps, "boxes jump together"
        assert rig.call("stop", Command()).startswith("done")
        assert rig.requests(3) == []
    finally:
        rig.node.close()


def test_a_choice_waits_beside_the_loop_and_is_superseded_by_the_next_command() -> None:
    rig = Rig()
    try:
        rig.picture()
        first, _ = rig.run.call("follow/do/select", Command(box_px=rig.pose.box()), rig.t_ns)
        assert first.answer is None, "the trackers come up in another thread"
        said = [o.message for o in rig.run.step(rig.t_ns + S) if isinstance(o.message, Track)]
        assert [(m.state, m.reason) for m in said] == [("idle", "the trackers start")]
        assert rig.call("stop", Command()).startswith("done")
        assert first.answer is not None and first.answer.reason == "select: superseded by follow/do/stop from unknown"
    finally:
        rig.node.close()


@pytest.mark.slow
def test_beside_a_chase_it_tracks_what_the_chase_tracks() -> None:
    rig = Rig("helm.follow_on_link_loss=true")
    try:
        rig.picture()
        end = time.monotonic() + 40.0
        while rig.node._follower is None or not rig.node._follower.fusion.pool.await_ready(0.1):
            rig.run.step(rig.t_ns)
            assert time.monotonic() < end
        rig.picture()
        _chase(rig)
        assert rig.requests(10), "it asks beside the chase"
        track = rig.target()
        assert abs(track.x_px - rig.pose.x_px) < 8.0
        for _ in range(20):  # the chase moves on to something else, and the follower after it
            _chase(rig, aside_px=150.0)
            rig.picture()
        assert abs(rig.target().y_px - rig.pose.y_px) > 75.0
    finally:
        rig.node.close()


def _chase(rig: Rig, aside_px: float = 0.0) -> None:
    x, y, width, height = rig.pose.box()
    track = Track(
        state="tracking", x_px=x + width / 2, y_px=y + height / 2 + aside_px, width_px=width, height_px=height
    )
    rig.run.feed("pursuit/track", track, rig.t_ns)


def test_a_depth_picture_belongs_to_its_moment() -> None:
    node = FollowNode(load_config("heron", ["follow.camera=front"]), "follow")
    run = ScriptedRun(node)
    depth = np.full((240, 320), 2500, "<u2")
    image = Image(camera="front", width=320, height=240, encoding="depth_mm", data=depth.tobytes())
    run.feed("camera/front/depth", image, S)
    from common.node import Inputs

    near, far = node._depth_at(Inputs(run.store, S), S + 20_000_000), node._depth_at(Inputs(run.store, S), 2 * S)
    assert near is not None and near.shape == (240, 320) and near[0, 0] == 2.5
    assert far is None
