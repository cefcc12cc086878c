"""The vehicle follows what the operator chose by itself, while trackers die and freeze; a chase whose link is cut."""

from __future__ import annotations

import itertools
import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from common.messages import Health, Track
from ground.console.page import FOR_FOLLOWER
from onboard.helm.config import HelmConfig
from tests.system.console_page import ConsolePage
from tests.system.flight import Flight, Seen

SCENARIO = """
seed = 5
[car.path]
turn_radius_m = 2.0
start_delay_s = 16.0
waypoints = [
    { north_m = 1.2, east_m = 0.0, speed_m_s = 0.8 },
    { north_m = 1.2, east_m = 9.0, speed_m_s = 1.0 },
    { north_m = 10.0, east_m = 9.0, speed_m_s = 1.0 },
    { north_m = 10.0, east_m = -9.0, speed_m_s = 1.0 },
    { north_m = 1.2, east_m = -9.0, speed_m_s = 0.8 },
]
"""
FOLLOWED_S, GAP_S = 120.0, 25.0
CUT_S = 3.0


def _choose_on_the_console(flight: Flight, track: Seen) -> None:
    """Draw the box around the car on the console's page, where it truly is, and press the button."""
    flight.wait("view of the car", lambda: flight.truth.last is not None and flight.truth.last.target_visible, 20)
    with ConsolePage(flight.stack.console_port) as page:
        page.choose("A box chooses", FOR_FOLLOWER)
        page.await_picture()
        corners = np.array(flight.truth.last.target_corners_px)
        page.draw((*corners.min(axis=0).tolist(), *np.ptp(corners, axis=0).tolist()))
        page.await_note("Choose what to follow: done")
        flight.wait("fused target", lambda: track.last is not None and track.last.state == "tracking", 5)
        time.sleep(0.5)  # helm hears of it
        page.press("Follow")
        page.await_note("Follow: done")


def _errors_m(seen: Seen, since_ns: int) -> np.ndarray:
    """True horizontal distances to the car since a time, m."""
    return np.array([math.dist(r.message.ned_p_m[:2], r.message.target_ned_p_m[:2]) for r in seen.since(since_ns)])


def _moving(flight: Flight) -> bool:
    return math.hypot(*flight.truth.last.target_ned_v_m_s[:2]) > 0.5


@pytest.mark.timeout(300)
def test_the_vehicle_follows_by_itself(make_flight: Callable[..., Flight], tmp_path: Path) -> None:
    scenario = tmp_path / "ring.toml"
    scenario.write_text(SCENARIO)
    flight = make_flight(
        f"world.scenario={scenario}",
        "helm.follow_on_link_loss=true",
        "helm.link_loss_after_s=2",
        'hab_df.members=["dsst", "cmt", "particle_filter"]',
        link=True,
        console=True,
    )
    on_board = flight.stack.bus("onboard", "test-onboard")
    status, setpoints = Seen(on_board, "helm/status"), Seen(on_board, "helm/setpoint")
    truth, track, health = Seen(on_board, "truth"), Seen(on_board, "follow/track"), Seen(on_board, "health/follow")
    flight.take_off(6.0)

    _choose_on_the_console(flight, track)
    begun_ns = time.monotonic_ns()
    assert track.last.state == "tracking" and flight.state == "follow"
    flight.wait("follow of the moving car", lambda: _moving(flight) and flight.error_m < 1.2, 30)
    _follows_on_with_a_dead_and_a_frozen_tracker(flight, begun_ns, truth, setpoints, track, health)

    # The chase flies; its link is cut; the vehicle goes on by itself, and gives back what it took.
    flight.must("follow/do/stop")
    flight.must("helm/do/hold")
    flight.chase()
    flight.wait("chase of the car", lambda: flight.error_m < 1.2 and flight.setpoints.last.source == "pursuit", 15)
    flight.wait("the follower beside the chase", lambda: track.last.state == "tracking" and not track.last.reason, 10)
    flight.wait("a steady chase", lambda: _only(setpoints, "pursuit", 1.5), 20)
    assert flight.link is not None
    cut_ns = time.monotonic_ns()
    flight.link.cut()
    flight.wait("take-over", lambda: status.last.state == "follow", 2)
    time.sleep(CUT_S)
    assert status.last.state == "follow", status.last
    slew_m_s2 = flight.stack.config.section(HelmConfig).containment.acceleration_m_s2
    _did_not_jump(setpoints, cut_ns, "pursuit", "follow", slew_m_s2)
    assert _errors_m(truth, cut_ns).max() < 2.0
    joined_ns = time.monotonic_ns()
    flight.link.join()
    flight.wait(
        "hand-back",
        lambda: (status.last.state == "pursuit" and setpoints.last.source == "pursuit") or not _chase_has_it(flight),
        15,
    )
    if not _chase_has_it(flight):  # it was away for long: the operator draws the box again
        flight.select()
        flight.wait("hand-back", lambda: status.last.state == "pursuit" and setpoints.last.source == "pursuit", 8)
    time.sleep(0.5)
    _did_not_jump(setpoints, joined_ns, "follow", "pursuit", slew_m_s2)
    assert _errors_m(truth, cut_ns).max() < 2.0
    flight.check_machine()


def _only(setpoints: Seen, source: str, seconds: float) -> bool:
    """Whether all setpoints of the last seconds are of one source."""
    newest = setpoints.since(time.monotonic_ns() - int(seconds * 1e9))
    return len(newest) > 10 * seconds and {s.message.source for s in newest} == {source}


def _chase_has_it(flight: Flight) -> bool:
    """Whether the ground's tracker, if it speaks again, has the car."""
    return not flight.pursuit_answers() or flight.tracking


def _follows_on_with_a_dead_and_a_frozen_tracker(
    flight: Flight, begun_ns: int, truth: Seen, setpoints: Seen, track: Seen, health: Seen
) -> None:
    def pid(name: str) -> int:
        message: Health = health.last
        return int(message.metrics[f"pid_{name}"])

    moving_ns = time.monotonic_ns()
    time.sleep(GAP_S)
    killed, frozen = pid("dsst"), pid("cmt")
    os.kill(killed, signal.SIGKILL)
    time.sleep(GAP_S)
    os.kill(frozen, signal.SIGSTOP)
    time.sleep(FOLLOWED_S - (time.monotonic_ns() - begun_ns) / 1e9)
    errors = _errors_m(truth, moving_ns)
    assert len(errors) > 15 * (FOLLOWED_S - 20.0)
    assert np.percentile(errors, 95) < 1.0, np.round(errors[::20], 1)
    assert errors.max() < 1.6, np.round(errors[::20], 1)
    sources = [s.message.source for s in setpoints.since(begun_ns)]
    assert sources.count("follow") > 0.97 * len(sources), "it kept following"
    tracks: list[Track] = [r.message for r in track.since(begun_ns)]
    assert sum(t.state == "tracking" for t in tracks) > 0.95 * len(tracks)
    travelled = np.abs(np.diff([r.message.ned_p_m[:2] for r in truth.since(begun_ns)], axis=0)).sum()
    assert travelled > 0.5 * FOLLOWED_S, "it flew after the car"
    assert (pid("dsst"), pid("cmt")) != (killed, frozen)
    assert pid("dsst") != killed and pid("cmt") != frozen, "both were begun anew"
    assert flight.state == "follow"


def _did_not_jump(setpoints: Seen, since_ns: int, giver: str, taker: str, slew_m_s2: float) -> None:
    """No hover between the two, and the setpoint of the first one flown is that of the other before, within bounds."""
    most_m_s2 = 1.25 * slew_m_s2  # stamps of two setpoints may be a quarter off on a busy machine
    around = setpoints.since(since_ns - 500_000_000)
    sources = [s.message.source for s in around]
    first = sources.index(taker)
    assert set(sources[:first]) == {giver} and set(sources[first:]) == {taker}, sources
    before, after = around[first - 1], around[first]
    step = math.dist(before.message.ned_v_m_s[:2], after.message.ned_v_m_s[:2])
    apart_s = (after.header.capture_ns - before.header.capture_ns) / 1e9
    print(f"hand-over {giver} to {taker}: {step:.3f} m/s between setpoints {apart_s:.3f} s apart")
    assert step <= most_m_s2 * max(apart_s, 0.02) + 0.05, (step, apart_s)  # what helm's slew allows
    turn = math.remainder(after.message.yaw_rad - before.message.yaw_rad, math.tau)
    assert abs(turn) < 0.1 and abs(after.message.height_m - before.message.height_m) < 0.1, (before, after)
    for earlier, later in itertools.pairwise(around[max(0, first - 3) : first + 10]):
        change = math.dist(earlier.message.ned_v_m_s[:2], later.message.ned_v_m_s[:2])
        apart_s = (later.header.capture_ns - earlier.header.capture_ns) / 1e9
        assert change <= most_m_s2 * max(apart_s, 0.02) + 0.05, (change, apart_s)
