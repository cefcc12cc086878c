"""What counts in the benchmark `pursuit`, on made-up traces, and the roads that its seeds draw."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import pursuit
from benchmarks.base import Settings
from benchmarks.pursuit_count import (
    Columns,
    chase_figures,
    counted,
    found,
    lost_for_good,
    occlusions,
    recoveries_s,
    still_figures,
    turning,
)
from benchmarks.pursuit_road import chase_scenario, still_scenario
from benchmarks.pursuit_strips import Album, around_occlusion, around_reinitialisation, montage
from common.tracking.base import TrackResult
from ground.pursuit.pursuer import Pursued
from simulation.world.path import car_path

RATE_HZ = 20.0
FRAMES = 600


def trace(frames: int = FRAMES) -> dict[str, np.ndarray]:
    """A flight 0.1 m beside a car that is always seen."""
    t_s = 100.0 + np.arange(frames) / RATE_HZ
    level = {name: np.zeros(frames) for name in ("covered", "yaw_error_rad", "target_heading_rad", "reinitialisations")}
    beside = {name: np.full(frames, 0.1) for name in ("error_m", "axis_error_m")}
    return {"t_s": t_s, "seen": np.ones(frames), "off_m": np.full(frames, 0.02), **level, **beside}


def hide(columns: Columns, begin: int, end: int, most: float = 1.0) -> None:
    """Hide the car from one picture to another, its edges covered by a third in the two pictures around."""
    columns["covered"][begin:end] = most
    columns["covered"][[begin - 1, end]] = 0.3
    columns["covered"][[begin, end - 1]] = min(most, 0.7)


def test_an_occlusion_hides_the_whole_car_and_ends() -> None:
    columns = trace()
    hide(columns, 200, 220)
    hide(columns, 300, 320, most=0.9)
    columns["covered"][590:] = 1.0

    spans = occlusions(columns["covered"])

    assert [(s.begin, s.end) for s in spans] == [(200, 220)]


def test_errors_count_until_it_begins_and_from_two_seconds_after_it() -> None:
    columns = trace()
    hide(columns, 200, 220)
    mask = counted(columns["t_s"], columns["covered"])

    assert not mask[:120].any() and mask[120:200].all(), "from 6 s on"
    assert not mask[200:260].any() and mask[260:].all()

    for index, error in ((119, 7.0), (199, 0.4), (200, 8.0), (259, 9.0), (260, 0.3)):
        columns["error_m"][index] = error
    assert chase_figures(columns)["chase_max_error_m"] == 0.4


def test_a_car_that_is_hidden_in_part_counts_all_the_same() -> None:
    columns = trace()
    hide(columns, 300, 320, most=0.9)
    columns["error_m"][310] = 2.0

    assert chase_figures(columns)["chase_max_error_m"] == 2.0


def test_an_occlusion_at_the_end_of_the_flight_does_not_count() -> None:
    columns = trace()
    columns["covered"][590:] = 1.0
    columns["error_m"][595] = columns["off_m"][595] = 5.0
    columns["seen"][590:] = 0.0
    figures = chase_figures(columns)

    assert figures["chase_max_error_m"] == pytest.approx(0.1) and figures["occlusions"] == 0.0
    assert figures["frames_lost_for_good"] == 0.0


def test_nothing_is_lost_for_good_under_a_deck_that_the_flight_s_end_cuts_off() -> None:
    columns = trace()
    columns["covered"][585:590], columns["covered"][590:] = 0.3, 1.0
    columns["seen"][586:] = 0.0
    assert lost_for_good(columns) == 0

    columns["seen"][580:] = 0.0  # lost before anything hid it
    assert lost_for_good(columns) == 5

    columns["covered"][590:] = 0.4  # the flight ends with the car in view
    assert lost_for_good(columns) == 20


def test_rms_is_that_of_the_counted_pictures() -> None:
    columns = trace()
    columns["error_m"][120:360] = 0.3
    figures = chase_figures(columns)

    assert figures["chase_rms_error_m"] == pytest.approx(math.sqrt((0.09 + 0.01) / 2))
    assert figures["counted_share"] == pytest.approx(0.8)


def test_a_recovery_needs_the_right_place() -> None:
    columns = trace()
    hide(columns, 200, 220)
    columns["seen"][201:230] = 0.0
    columns["off_m"][201:240] = 3.0  # from 230 to 240 it takes something else for the car
    hide(columns, 400, 420)
    columns["seen"][401:] = 0.0
    figures = chase_figures(columns)

    assert recoveries_s(columns) == pytest.approx([1.0, math.inf])
    assert (figures["occlusions"], figures["recovered"]) == (2.0, 1.0)
    assert figures["worst_recovery_s"] == pytest.approx(1.0)
    assert not found(columns)[235] and found(columns)[240]
    assert lost_for_good(columns) == FRAMES - 460, "all but the occlusion and its two seconds"


def test_a_target_without_place_is_not_found() -> None:
    columns = trace()
    columns["off_m"][300:] = math.nan

    assert lost_for_good(columns) == 300


def test_turns_are_told_by_the_heading_rate_and_over_half_a_circle() -> None:
    columns = trace()
    turned = 3.0 + np.clip(np.arange(FRAMES) - 300, 0, 60) * 0.5 / RATE_HZ
    columns["target_heading_rad"][:] = np.remainder(turned + math.pi, 2 * math.pi) - math.pi
    columns["yaw_error_rad"][301:360] = math.radians(10.0)
    mask = turning(columns["t_s"], columns["target_heading_rad"])

    assert mask[301:360].all() and not mask[:300].any() and not mask[362:].any()
    assert chase_figures(columns)["chase_yaw_rms_deg"] == pytest.approx(10.0, rel=0.03)


def test_stabilisation_is_the_largest_error_after_the_settling() -> None:
    columns = trace()
    columns["error_m"][50] = 4.0
    columns["error_m"][400] = 0.2
    columns["yaw_error_rad"][401] = -math.radians(2.0)
    figures = still_figures(columns)

    assert figures["stabilise_max_error_m"] == 0.2
    assert figures["stabilise_max_yaw_deg"] == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(12))
def test_every_seed_draws_right_angles_stops_and_bridges(seed: int) -> None:
    scenario = chase_scenario(seed)
    scenario.car.path.check()
    motion = car_path(scenario.car).at(np.arange(0.0, 500.0, 0.05))
    speed = np.linalg.norm(motion.ned_v_m_s, axis=1)
    corners = np.array([(w.north_m, w.east_m) for w in scenario.car.path.waypoints])
    legs = np.roll(corners, -1, axis=0) - corners
    turns = np.abs((legs * np.roll(legs, -1, axis=0)).sum(axis=1))

    assert 1.2 < speed.max() <= 2.0 + 1e-6
    assert np.hypot(*motion.ned_p_m[0]) < 1.0, "it begins at home, where the vehicle takes off"
    assert turns.max() < 1e-6 or (turns < 1e-6).sum() >= len(turns) - 1, "right angles, and straight on at home"
    assert len(scenario.occluders) == 4 and len(scenario.distractors) == 2
    passed: list[int] = []
    for bridge in scenario.occluders:
        away = np.hypot(*(motion.ned_p_m - [bridge.north_m, bridge.east_m]).T)
        passed += np.flatnonzero((away[1:] < 0.3) & (away[:-1] >= 0.3)).tolist()
    assert np.diff([0, *sorted(passed)]).max() < 1000, "the car is hidden at least every 1,000 pictures"
    assert sum(index < 1100 for index in passed) >= 2, "and twice in a quick flight"


def test_another_seed_is_another_scene() -> None:
    assert chase_scenario(5) == chase_scenario(5) and still_scenario(5) == still_scenario(5)
    assert chase_scenario(5).car != chase_scenario(6).car and still_scenario(5).car != still_scenario(6).car


def test_quick_is_shorter_and_flies_the_same() -> None:
    long, short = pursuit.flights(Settings(seed=2)), pursuit.flights(Settings(seed=2, quick=True))

    assert [f._replace(duration_s=0.0) for f in long] == [f._replace(duration_s=0.0) for f in short]
    assert {f.duration_s for f in long if f.scene == "chase"} == {500.0}
    assert {f.duration_s for f in short if f.scene == "chase"} == {60.0}


def test_strips_take_the_pictures_around_the_events() -> None:
    columns = trace()
    assert around_occlusion(columns) == around_reinitialisation(columns) == []
    hide(columns, 200, 220)
    columns["seen"][205:226] = 0.0
    assert around_occlusion(columns) == [190, 200, 210, 219, 226, 246]
    columns["seen"][300:340] = 0.0
    columns["reinitialisations"][320:] = 1.0
    assert around_reinitialisation(columns) == [], "what it found then was not the car"
    columns["reinitialisations"][340:] = 2.0
    assert around_reinitialisation(columns) == [289, 299, 319, 339, 340, 360]


def test_a_strip_shows_the_states_and_replaces_a_lost_picture_by_the_one_before() -> None:
    columns, album = trace(), Album()
    hide(columns, 200, 220)
    columns["seen"][205:226] = 0.0
    result = TrackResult((320.0, 240.0), (96.0, 48.0), 0.0, 0.9, 0.5, "tracking", angle_std_rad=0.0)
    for number in range(1, FRAMES):
        if number != 210:
            state = "tracking" if columns["seen"][number] else "predicted"
            album.take(number, np.zeros((480, 640, 3), np.uint8), Pursued(replace(result, state=state), None, None))
    strip = album.strips(columns)["occlusion"]
    assert [still.kept.state for still in strip] == ["seen", "seen", "predicted", "predicted", "seen", "seen"]
    assert [round(still.t_s, 2) for still in strip] == [-0.5, 0.0, 0.45, 0.95, 1.3, 2.3]
    assert montage(strip).shape == (480, 960, 3)
