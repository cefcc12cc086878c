"""BlazePose on the sample video: the numbers of one crop, and the filter on people and things.

OpenCV's engines do not compute the same: the numbers are what ENGINE_CLASSIC of OpenCV 5.0.0 gives, checked by eye.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.people_pose import Annotated, annotated, turn
from benchmarks.sample_video import sample_frames
from onboard.people.config import PoseFilterConfig
from onboard.people.pose import upright_crop
from onboard.people.pose_file import blazepose_file
from onboard.people.pose_filter import pose_refusal
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork, blazepose

WALKER = Annotated(198, 604, 263, 41, 105, True)
JOINTS_PX = [
    [130.4, 48.9], [123.2, 69.3], [110.3, 70.7], [98.3, 98.5], [96.0, 131.2], [136.0, 68.0], [144.4, 91.5],
    [156.3, 109.4], [118.3, 126.8], [132.4, 167.4], [130.3, 202.7], [131.3, 124.2],
    [128.0, 161.0], [103.9, 183.9], [124.8, 125.5],
]  # fmt: skip
CONFIG = PoseFilterConfig()


@pytest.fixture(scope="module")
def network() -> PoseNetwork:
    return PoseNetwork(blazepose(blazepose_file()))


def test_the_numbers_of_one_crop(network: PoseNetwork):
    picture = sample_frames([WALKER.frame])[WALKER.frame]
    crop, _ = upright_crop(picture, (624.5, 315.5), (0.0, -1.0), 136.5, 256)
    joints, confidence, presence = network(crop)
    np.testing.assert_allclose(joints, JOINTS_PX, atol=0.5)
    assert presence == pytest.approx(0.9998, abs=0.002)
    assert confidence.min() == pytest.approx(0.821, abs=0.02)


def test_people_pass_and_things_do_not(network: PoseNetwork):
    finder = PoseFinder(network)
    boxes = [b for b in annotated() if b.frame == 396]
    people, things = [b for b in boxes if b.person], [b for b in boxes if not b.person][::6]
    assert len(people) == 3 and len(things) > 4
    frame = sample_frames([396])[396]
    refusals = {b: pose_refusal(finder.find(frame, b.region()), b.region(), CONFIG) for b in (*people, *things)}
    assert [refusals[b] for b in people] == ["", "", ""]
    assert all(refusals[b] for b in things)


def test_a_walker_who_lies_across_the_picture_is_found(network: PoseNetwork):
    picture, region, up = turn(sample_frames([WALKER.frame])[WALKER.frame], WALKER, math.radians(110))
    pose = PoseFinder(network).find(picture, region)
    assert pose_refusal(pose, region, CONFIG) == ""
    assert pose.up @ up > math.cos(math.radians(15))
