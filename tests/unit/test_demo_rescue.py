"""How the rescue is judged: who is who, and what counts as a fault."""

from __future__ import annotations

import math
import threading
from typing import Any, cast

import pytest

from common.header import Header, Received
from common.messages import JOINTS, LimiterStatus, Message, People, PeopleDetections, Person, PersonDetection, Vec3
from common.truth import Truth, TruthObstacle
from simulation.demo.report import Criteria
from simulation.demo.rescue import RescueMission, match

MS = 1_000_000


def test_people_are_matched_to_the_nearest_and_to_nobody_far_off():
    there = {"person 1": (0.0, 0.0), "person 2": (1.0, 0.0), "person 3": (9.0, 0.0)}
    found = match({4: (0.7, 0.0), 5: (2.2, 1.1), 6: (8.4, 0.0), 7: (7.4, 0.0)}, there)
    assert found[4].label == "person 2" and found[4].error_m == pytest.approx(0.3)
    assert found[6].label == "person 3" and found[6].error_m == pytest.approx(0.6)
    assert found[5].label == found[7].label == "" and math.isinf(found[7].error_m)
    assert match({}, there) == {} and match({1: (0.0, 0.0)}, {})[1].label == ""


class Mission(RescueMission):
    """Fed by hand."""

    def __init__(self) -> None:
        super().__init__(cast(Any, None), threading.Event(), headless=True)
        self._watching = True
        self._figures["approach_m"] = 2.5
        self.ms = 0

    def see(self, found: dict[int, Vec3], there: dict[str, Vec3], nearest_m: float = 4.0) -> None:
        self.ms += 100
        things = [
            TruthObstacle(label=name, ned_p_m=p, ned_v_m_s=(0.0, 0.0, 0.0), distance_m=nearest_m, ned_nearest_m=p)
            for name, p in there.items()
        ]
        self.on_truth(self._received(_truth(tuple(things))))
        people = [
            Person(
                number=n,
                name=f"person {n}",
                state="seen",
                ned_p_m=p,
                first_seen_ns=0,
                last_seen_ns=self.ms * MS,
                pictures=4,
            )
            for n, p in found.items()
        ]
        self._on_roll(self._received(People(people=tuple(people))))
        seen = [
            PersonDetection(
                number=n,
                box_px=(0.0, 0.0, 9.0, 9.0),
                joints_px=((0.0, 0.0, 1.0),) * len(JOINTS),
                presence=1.0,
                fresh=True,
                with_depth=True,
                ned_p_m=p,
            )
            for n, p in found.items()
        ]
        detections = PeopleDetections(camera="down", width=640, height=480, people=tuple(seen), with_depth=True)
        self._on_detections(self._received(detections))

    def faults(self) -> tuple[dict[str, float], list[str]]:
        status = {"asked_m_s": 0.0, "allowed_m_s": 0.0, "why": "clear", "h_mid_m": 2.5, "h_max_m": 6.0}
        self._limiter = LimiterStatus(
            zone="safe",
            distance_m=4.0,
            ned_direction=(0.0, 0.0, 1.0),
            h_min_m=0.8,
            h_desired_m=1.5,
            sectors_m=(-1.0,) * 72,
            seen=(False,) * 72,
            **status,
        )
        return self.judge(Criteria())

    def _received(self, message: Message) -> Received[Any]:
        t_ns = self.ms * MS
        return Received(message, Header(0, "test", 1, 0, t_ns, t_ns), t_ns)


def _truth(things: tuple[TruthObstacle, ...]) -> Truth:
    zero = (0.0, 0.0, 0.0)
    return Truth(
        ned_p_m=zero,
        ned_v_m_s=zero,
        ned_q_body=(1.0, 0.0, 0.0, 0.0),
        target_ned_p_m=zero,
        target_ned_v_m_s=zero,
        target_heading_rad=0.0,
        target_visible=False,
        obstacles=things,
    )


THERE: dict[str, Vec3] = {"person 1": (0.0, 3.0, -0.2), "person 2": (4.0, 0.0, -0.9), "barrel 1": (1.0, 1.0, -0.4)}


def test_everybody_found_is_no_fault():
    mission = Mission()
    for _ in range(5):
        mission.see({1: (0.1, 3.0, -0.1)}, THERE)
        mission.see({1: (0.1, 3.0, -0.1), 2: (4.0, 0.2, -0.9)}, THERE)
    figures, faults = mission.faults()
    assert faults == []
    assert (figures["people_in_scene"], figures["people_found"], figures["people_reported"]) == (2, 2, 2)
    assert figures["position_error_max_m"] == figures["map_error_max_m"] == pytest.approx(0.2)
    assert figures["people_rate_hz"] == pytest.approx(10.0) and figures["closest_m"] == 4.0


def test_who_is_missing_who_is_nobody_and_who_is_two_are_named():
    mission = Mission()
    mission.see({1: (0.1, 3.0, -0.1), 7: (8.0, 8.0, 0.0)}, THERE, nearest_m=0.5)
    _, faults = mission.faults()
    assert faults == [
        "did not find person 2",
        "reported people where nobody is: person 7",
        "came to 0.50 m of somebody or something, expected 0.8 or more",
    ]
    mission = Mission()
    mission.see({1: (0.1, 3.0, -0.1)}, THERE)
    mission.see({1: (4.0, 0.0, -0.1)}, THERE)
    assert mission.faults()[1] == ["one number for several people: person 1"]


def test_a_place_on_the_map_that_the_last_picture_moved_away_is_a_fault():
    mission = Mission()
    for _ in range(9):
        mission.see({1: (0.0, 3.0, -0.1), 2: (4.0, 0.2, -0.9)}, THERE)
    mission.see({1: (0.7, 3.0, -0.1)}, THERE)
    assert mission.faults()[1] == ["map_error_max_m 0.70, expected 0.5 or less"]
