"""Who stands beside the target is somebody else, and stays so while she is seen, whoever goes before whom."""

from __future__ import annotations

import numpy as np
import pytest

from onboard.follow.config import FollowConfig
from onboard.follow.law import Vehicle
from onboard.follow.others import Others
from onboard.follow.steering import Steering
from onboard.follow.things import DepthView
from onboard.fusion.config import DepthConfig
from onboard.fusion.foreseen import Foreseen
from tests.unit import test_follow_solid
from tests.unit.test_follow_solid import CAMERA, EYE_M, POSE, S, box_at, depth_of

HE_M = (4.0, 0.0)
HE_THERE = (*HE_M, 0.0)


class Watched:
    """He and she in depth pictures, 30 a second; who is known to be another at each column."""

    def __init__(self) -> None:
        self._view = DepthView(CAMERA)
        self._others, self._t_ns = Others(self._view), S

    def see(
        self,
        *people: tuple[float, float, float],
        he: tuple[float, float] = HE_M,
        seconds: float = 0.5,
        sure: bool = True,
        lean: float = 0.0,
    ) -> np.ndarray:
        """The same for a time; returns who is known to be another in the last picture, (h, w)."""
        depth, mask = depth_of(*people, lean=lean), None
        for _ in range(round(30 * seconds)):
            self._t_ns += S // 30
            target = np.array([*he, -0.7])
            mask, _ = self._others.look(self._t_ns, POSE, depth, self._view.free(POSE, depth), target, 0.5)
            if sure:
                self._others.learn(self._t_ns, box_at(*he), target)
        return np.zeros(depth.shape, bool) if mask is None else mask

    def forget(self) -> None:
        self._others.forget()


def _on(mask: np.ndarray, ahead_m: float, right_m: float) -> float:
    """Share of somebody's middle that is known to be of another."""
    u, v = 79.5 + right_m / ahead_m * 114.0, 59.5 + 0.6 / ahead_m * 114.0
    return float(mask[round(v) - 5 : round(v) + 5, round(u) - 3 : round(u) + 4].mean())


def test_who_stands_beside_him_is_another_once_both_have_been_seen_for_a_while() -> None:
    watched, both = Watched(), ((4.0, 0.0, 0.0), (3.6, 0.9, 0.0))
    assert not watched.see(*both, seconds=0.25).any(), "too little was seen yet"
    mask = watched.see(*both, seconds=0.2)
    assert _on(mask, 3.6, 0.9) == 1.0 and _on(mask, 4.0, 0.0) == 0.0


@pytest.mark.parametrize("sure", [False, True])
def test_nobody_is_another_where_he_was_not_surely_seen_beside_her(sure: bool) -> None:
    watched = Watched()
    assert not watched.see((4.0, 0.0, 0.0), (3.6, 0.9, 0.0), seconds=1.0, sure=False).any()
    assert not watched.see((3.2, 0.3, 0.0), seconds=1.0, sure=sure).any(), "his own thing is not seen, and may be that"
    assert not watched.see((4.0, 0.0, 0.0), (4.0, 0.5, 0.0), seconds=1.0, sure=sure).any(), "one leans on the other"


def test_she_is_another_though_he_is_beyond_what_the_camera_measures() -> None:
    watched = Watched()
    assert _on(watched.see((6.0, 0.9, 0.0), he=(9.0, 0.0)), 6.0, 0.9) == 1.0


def test_she_is_another_also_where_she_has_gone_before_him_and_he_is_nobody_when_he_comes_out() -> None:
    watched = Watched()
    watched.see((4.0, 0.0, 0.0), (3.2, 0.9, 0.0))
    for k in range(28):  # at 1.5 m/s she goes before him
        mask = watched.see((4.0, 0.0, 0.0), (3.2, 0.9 - 0.05 * k, 0.0), seconds=1 / 30, sure=k < 6)
        assert _on(mask, 3.2, 0.9 - 0.05 * k) == 1.0
    for k in range(25):  # and stays, while he goes on to the other side
        mask = watched.see((4.0, -0.05 * k, 0.0), (3.2, -0.45, 0.0), he=(4.0, -0.05 * k), seconds=1 / 30, sure=False)
    assert _on(mask, 3.2, -0.45) == 1.0 and _on(mask, 4.0, -1.2) == 0.0


def test_while_two_are_seen_as_one_she_is_the_part_where_she_should_be() -> None:
    watched = Watched()
    watched.see((4.0, 0.0, 0.0), (4.0, 0.9, 0.0))
    for right_m in np.arange(0.85, 0.5, -0.05):
        watched.see((4.0, 0.0, 0.0), (4.0, right_m, 0.0), seconds=1 / 30)
    mask = watched.see((4.0, 0.0, 0.0), (4.0, 0.48, 0.0), seconds=1 / 30, sure=False)
    assert _on(mask, 4.0, 0.48) > 0.8 and _on(mask, 4.0, 0.0) == 0.0
    watched.see((4.0, 0.0, 0.0), (4.0, 0.48, 0.0), seconds=1.0, sure=False)
    mask = watched.see((4.0, 0.0, 0.0), (4.0, 0.6, 0.0), seconds=0.1, sure=False)
    assert _on(mask, 4.0, 0.6) == 1.0 and _on(mask, 4.0, 0.0) == 0.0, "she has not become he"


def test_he_alone_is_not_taken_for_her_and_somebody_else() -> None:
    watched = Watched()
    watched.see((4.0, 0.0, 0.1), (4.0, 0.7, 0.0))
    assert not watched.see((4.0, 0.0, 0.1), seconds=0.3).any(), "she is gone"


def test_who_was_away_is_not_known_any_more_nor_who_has_been_one_with_him_for_long() -> None:
    watched = Watched()
    watched.see((4.0, 0.0, 0.0), (4.0, 0.9, 0.0))
    watched.see((4.0, 0.0, 0.0), seconds=0.6)
    assert not watched.see((4.0, 0.0, 0.0), (4.0, 0.9, 0.0), seconds=0.2).any()
    watched = Watched()
    watched.see((4.0, 0.0, 0.0), (4.0, 0.7, 0.0))
    watched.see((4.0, 0.0, 0.0), (4.0, 0.48, 0.0), seconds=2.6, sure=False)
    assert not watched.see((4.0, 0.0, 0.0), (4.0, 0.7, 0.0), seconds=0.1, sure=False).any()


def test_pixels_between_two_do_not_make_him_a_part_of_the_screen_beside_him() -> None:
    watched = Watched()
    depth = depth_of((4.0, 0.0, 0.0), (2.8, 1.0, 0.6))
    watched.see((4.0, 0.0, 0.0), (2.8, 1.0, 0.6))
    gap = depth.copy()
    columns = np.nonzero((depth == 4.0).any(axis=0))[0]
    gap[40:90, columns[-1] : np.nonzero((depth == 2.8).any(axis=0))[0][0] + 1] = 0.0
    view, others = DepthView(CAMERA), watched._others
    gap[60:64, columns[-1] : columns[-1] + 30] = np.linspace(4.0, 2.8, 30)
    mask, walls = others.look(watched._t_ns + S // 30, POSE, gap, view.free(POSE, gap), np.array([4.0, 0.0, -0.7]), 0.5)
    assert mask is not None and _on(mask, 4.0, 0.0) == 0.0 and _on(mask, 2.8, 1.0) == 1.0
    assert not walls.any()


def test_what_goes_on_for_longer_than_anybody_is_wide_is_a_wall_and_who_stands_before_it_is_not() -> None:
    depth = depth_of((4.0, 0.0, 0.0))
    depth[(depth == 0.0) | (depth > 6.0)] = 6.0
    depth[:, np.nonzero((depth == 4.0).any(axis=0))[0][-1]] = 0.0  # holes where his edge is
    view = DepthView(CAMERA)
    mask, walls = Others(view).look(S, POSE, depth, view.free(POSE, depth), np.array([4.0, 0.0, -0.7]), 0.5)
    assert mask is None and _on(walls, 6.0, 2.0) == 1.0 and _on(walls, 4.0, 0.0) == 0.0


def test_what_was_known_is_forgotten_with_the_target() -> None:
    watched, both = Watched(), ((4.0, 0.0, 0.0), (3.6, 0.9, 0.0))
    assert watched.see(*both).any()
    watched.forget()
    assert not watched.see(*both, seconds=0.2).any()


def _before_a_wall(*people: tuple[float, float, float]) -> np.ndarray:
    depth = depth_of(*people)
    depth[(depth == 0.0) | (depth > 4.8)] = 4.8
    return depth


class Followed:
    """He before a wall, followed by a vehicle that stands, 30 pictures a second."""

    def __init__(self) -> None:
        self._steering, self._t_ns = Steering(FollowConfig(camera="front"), DepthConfig(), CAMERA), S
        self._vehicle = Vehicle(POSE.ned_p_m, np.zeros(3), 0.0, 0.0)

    def see(self, depth: np.ndarray, seconds: float, *, seen: bool = True) -> Foreseen:
        """The same for a time; what is foreseen in the last picture."""
        box = box_at(*HE_M) if seen else None
        for _ in range(round(30 * seconds)):
            self._t_ns += S // 30
            foreseen = self._steering.expected(self._t_ns, POSE, depth)
            self._steering.step(self._t_ns, box, POSE, self._vehicle, depth, sure=seen)
        assert foreseen is not None
        return foreseen


def test_a_wall_is_not_he_while_he_is_unseen_or_covered_and_who_is_seen_may_lean_on_it() -> None:
    followed = Followed()
    assert followed.see(_before_a_wall((4.0, 0.0, 0.0), (3.0, 1.0, 0.0)), 1.4).around is None
    for right_m in np.arange(0.9, 0.15, -0.1):
        covered = followed.see(_before_a_wall((4.0, 0.0, 0.0), (3.0, right_m, 0.0)), 1 / 30)
    assert covered.others is not None and covered.around is not None and _on(covered.around, 4.8, 1.0) == 1.0
    assert covered.around[115, 80], "the floor"
    unseen = followed.see(_before_a_wall((3.0, 0.2, 0.0)), 0.5, seen=False)
    assert unseen.excluded({"at the wall": box_at(4.3, 0.9)}) == {"at the wall"}


@pytest.mark.parametrize("falls_m_s", [0.1, 0.2, 0.5])
def test_who_walks_down_a_slope_is_never_taken_for_the_floor(falls_m_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    followed = Followed()
    followed.see(depth_of(HE_THERE), 1.0)
    for k in range(60):  # the ground at his feet is lower and lower: the vehicle's height over it is not what it knows
        monkeypatch.setattr(test_follow_solid, "EYE_M", EYE_M + falls_m_s * k / 15)
        foreseen = followed.see(depth_of(HE_THERE), 1 / 15)
        assert not foreseen.excluded({"he": box_at(*HE_M)})


def test_who_leans_on_the_wall_and_cannot_be_told_from_it_is_not_taken_for_the_wall() -> None:
    followed = Followed()
    followed.see(_before_a_wall((4.0, 0.0, 0.0)), 1.0)
    leaning = _before_a_wall()
    leaning[leaning == 4.8] = 4.2
    foreseen = followed.see(leaning, 4.0)
    assert not foreseen.excluded({"he": box_at(4.2, 0.0)})
