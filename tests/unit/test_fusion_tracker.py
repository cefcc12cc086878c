"""HAB-DF over scripted members: majority, drift and new start, loss, and what each tracker is told."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from common.config import ConfigError, build
from common.processes import load_config
from common.tracking.base import Box, Expectation, TrackResult, TrackState
from onboard.fusion.config import FusionConfig, HabDfConfig
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.tracker import HabDfTracker

FRAME = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
BOX = (100.0, 80.0, 40.0, 30.0)


class Scripted:
    """A member that says what it is told, and notes what was asked of it."""

    def __init__(self) -> None:
        self.box: Box = BOX
        self.state: TrackState = "tracking"
        self.started: list[Box] = []
        self.expected: list[Expectation] = []

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        self.started.append(box)
        self.box = box

    def expect(self, expectation: Expectation) -> None:
        self.expected.append(expectation)

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        x, y, width, height = self.box
        return TrackResult((x + width / 2, y + height / 2), (width, height), 0.0, 0.9, 0.5, self.state, 0.0)


class Movable(Scripted):
    """One that can be placed."""

    def __init__(self) -> None:
        super().__init__()
        self.placed: list[Box] = []

    def place(self, frame: np.ndarray, box: Box) -> None:
        self.placed.append(box)
        self.box = box


def fused(*members: Scripted) -> HabDfTracker:
    tracker = HabDfTracker({f"m{i}": m for i, m in enumerate(members)}, FusionConfig())
    tracker.init(FRAME, BOX, 0.0, 0)
    return tracker


def _run(tracker: HabDfTracker, begin: int, end: int) -> TrackResult:
    for k in range(begin, end):
        result = tracker.update(FRAME, k * 40_000_000)
    return result


def test_agreeing_members_give_their_box() -> None:
    tracker = fused(Scripted(), Scripted(), Scripted())
    result = _run(tracker, 1, 10)
    assert result.state == "tracking"
    assert result.overlap(BOX) > 0.98
    assert result.score > 0.9
    assert set(tracker.answers) == {"m0", "m1", "m2"}


def test_drifted_member_is_outvoted_then_started_anew_and_a_placeable_one_only_moved() -> None:
    members = Scripted(), Scripted(), Movable()
    tracker = fused(*members)
    _run(tracker, 1, 20)
    members[2].box = (200.0, 150.0, 40.0, 30.0)
    result = _run(tracker, 20, 30)
    assert result.overlap(BOX) > 0.95
    assert not members[2].placed
    _run(tracker, 30, 50)
    assert len(members[2].placed) == 1
    assert members[2].placed[0] == pytest.approx(BOX, abs=1.0)
    members[1].box = (10.0, 10.0, 40.0, 30.0)
    _run(tracker, 50, 80)
    assert len(members[1].started) == 2
    assert members[1].started[1] == pytest.approx(BOX, abs=1.0)
    assert len(members[0].started) == 1


def test_a_member_where_the_target_cannot_be_is_not_heard_and_is_put_back_though_it_sees_one() -> None:
    members = Movable(), Movable()
    tracker = fused(*members)
    depth = np.full((120, 160), 4.0)
    depth[:, 90:] = 3.0
    for k in range(1, 30):
        if k == 10:
            members[1].box = (200.0, 80.0, 40.0, 30.0)
        tracker.foresee(Foreseen(BOX, 4.0, 0.0, depth, FRAME.shape[:2]))
        result = tracker.update(FRAME, k * 40_000_000)
        assert result.overlap(BOX) > 0.95
    assert len(members[1].placed) == 1 and members[1].placed[0] == pytest.approx(BOX, abs=1.0)
    members[0].box = members[1].box = (80.0, 65.0, 80.0, 60.0)
    for k in range(30, 34):
        tracker.foresee(Foreseen(BOX, 4.0, 0.0, depth, FRAME.shape[:2]))
        result = tracker.update(FRAME, k * 40_000_000)
    assert result.size_px[0] < 1.2 * BOX[2], "twice as large he cannot be, whoever says so"


def test_trackers_that_agree_at_another_distance_for_long_against_one_are_heard() -> None:
    there: Box = (142.0, 85.0, 30.0, 22.0)
    moved = FRAME.copy()
    moved[80:110, 100:140] = FRAME[200:230, 0:40]
    moved[85:107, 142:172] = cv2.resize(FRAME[80:110, 100:140], (30, 22), interpolation=cv2.INTER_AREA)
    depth = np.full((120, 160), 4.0)
    depth[:, 66:] = 5.4
    foreseen = Foreseen(BOX, 4.0, 0.0, depth, FRAME.shape[:2])
    heard = {}
    for number in (1, 2):
        members = [Scripted() for _ in range(3)]
        tracker = fused(*members)
        _run(tracker, 1, 10)
        for member in members[:number]:
            member.box = there
        members[2].state = "lost"
        for k in range(10, 60):
            tracker.foresee(foreseen)
            heard[number, k] = tracker.update(moved, k * 40_000_000).overlap(there) > 0.5
    assert all(heard[2, k] == (k >= 18) for k in (*range(10, 16), *range(24, 60)))
    assert not any(heard[1, k] for k in range(10, 60)), "one by itself may be on anything"


def test_what_stands_at_the_targets_place_is_followed_for_a_while_by_itself_and_overrules_one_that_sees_another() -> (
    None
):
    members = Scripted(), Scripted()
    tracker = fused(*members)
    solid: Box = (104.0, 81.0, 38.0, 31.0)
    there = Foreseen(BOX, 4.0, 0.0, np.full((120, 160), 4.0), FRAME.shape[:2], solid=solid)
    _run(tracker, 1, 10)
    for member in members:
        member.state = "lost"
    states = []
    for k in range(10, 120):
        tracker.foresee(there)
        result = tracker.update(FRAME, k * 40_000_000)
        states.append(result.state)
        assert result.overlap(solid) > 0.9 or k < 15
    assert states[0] == "tracking"
    assert states.index("predicted") == pytest.approx(3.0 / 0.04, abs=2), "it may be anything that stands there"
    members[0].state, members[0].box = "tracking", BOX
    for k in range(120, 125):
        tracker.foresee(there)
        result = tracker.update(FRAME, k * 40_000_000)
    assert result.state == "tracking" and result.overlap(solid) > 0.8
    members[0].box = (150.0, 80.0, 40.0, 30.0)
    for k in range(125, 160):
        tracker.foresee(there)
        result = tracker.update(FRAME, k * 40_000_000)
        assert result.overlap(solid) > 0.8


def test_what_the_platform_does_moves_the_answer_though_no_picture_shows_it() -> None:
    member = Scripted()
    tracker, dark = fused(member), np.zeros_like(FRAME)
    for k in range(1, 10):
        tracker.foresee(Foreseen(BOX, moved_px=(0.0, 0.0)))
        tracker.update(dark, k * 40_000_000)
    member.state = "lost"
    for k in range(10, 16):
        tracker.foresee(Foreseen(BOX, moved_px=(-6.0, 2.0)))
        result = tracker.update(dark, k * 40_000_000)
    assert result.state == "predicted"
    assert result.center_px == pytest.approx((BOX[0] + BOX[2] / 2 - 36.0, BOX[1] + BOX[3] / 2 + 12.0), abs=1.0)


def test_of_members_that_disagree_after_a_loss_the_one_that_looks_like_the_target_speaks() -> None:
    right, wrong = Scripted(), Scripted()
    tracker = fused(wrong, right)
    _run(tracker, 1, 10)
    moved = FRAME.copy()
    there: Box = (220.0, 30.0, 40.0, 30.0)
    moved[30:60, 220:260] = FRAME[80:110, 100:140]
    moved[80:110, 100:140] = FRAME[200:230, 0:40]
    right.state = wrong.state = "lost"
    for k in range(10, 40):
        tracker.update(moved, k * 40_000_000)
    right.box, wrong.box, right.state, wrong.state = there, (20.0, 150.0, 40.0, 30.0), "tracking", "tracking"
    for k in range(40, 44):
        result = tracker.update(moved, k * 40_000_000)
    assert result.state == "tracking"
    assert result.overlap(there) > 0.8
    for k in range(44, 80):
        result = tracker.update(moved, k * 40_000_000)
    assert result.overlap(there) > 0.9
    assert len(wrong.started) == 1, "it is as sure as the other, and nobody else says which is right"


def test_lost_when_all_are() -> None:
    members = Scripted(), Scripted()
    tracker = fused(*members)
    _run(tracker, 1, 10)
    for member in members:
        member.state = "lost"
    assert _run(tracker, 10, 12).state == "predicted"
    assert _run(tracker, 12, 60).state == "lost"
    members[0].state = "tracking"
    assert _run(tracker, 60, 64).state == "tracking"


def test_expectation_reaches_every_member() -> None:
    members = Scripted(), Scripted()
    tracker = fused(*members)
    expectation = Expectation((1.0, 2.0), 0.0, (0.0, 0.0), 0.0, 1.0)
    tracker.expect(expectation)
    assert [m.expected for m in members] == [[expectation]] * 2


def test_members_come_from_the_configuration() -> None:
    config = load_config(None, ['hab_df.members=["dsst", "particle_filter"]'])
    assert list(HabDfTracker.make(config, np.random.default_rng(0)).members) == ["dsst", "particle_filter"]
    with pytest.raises(ConfigError, match="different trackers"):
        build(HabDfConfig, {"members": ["dsst", "dsst"]}, "hab_df")
    with pytest.raises(ConfigError, match=r"members: got 'strukc', expected one of: .* did you mean 'struck'"):
        load_config(None, ['hab_df.members=["strukc"]'])
