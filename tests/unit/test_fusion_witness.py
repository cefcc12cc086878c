"""The witness of the fused answer: whom it doubts, whom it lets speak, and what it learns."""

from __future__ import annotations

import cv2
import numpy as np

from common.tracking.base import Box
from onboard.fusion.answer import agreed
from onboard.fusion.center import Fused, FusionState
from onboard.fusion.config import FusionConfig
from onboard.fusion.doubt import doubted
from onboard.fusion.pictures import PictureFusion, whole
from onboard.fusion.riding import Stretch
from onboard.fusion.source import Judgement
from onboard.fusion.witness import Witness

GREY = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (240, 320), np.uint8), (0, 0), 2.0)
BOX: Box = (100.0, 80.0, 40.0, 30.0)
LARGER: Box = (94.0, 78.0, 52.0, 34.0)
ELSEWHERE: Box = (220.0, 150.0, 40.0, 30.0)
NEARBY: Box = (116.0, 88.0, 40.0, 30.0)


def _fused(state: FusionState, *reliabilities: float) -> Fused:
    sources = {f"m{i}": Judgement(r, 0.0, 0.0, 0.0, 0.0, np.ones(4)) for i, r in enumerate(reliabilities)}
    return Fused(0, state, np.array([120.0, 95.0, 30.0, 40.0]), np.zeros(4), np.eye(8), 0.9, sources, ())


def test_a_box_elsewhere_that_looks_like_nothing_known_is_doubted_and_one_at_the_same_place_is_not() -> None:
    witness = Witness(GREY, BOX, 0)
    verdict = witness.judge(GREY, {"a": BOX, "b": ELSEWHERE}, True, None, 0)
    assert verdict.doubted == {"b"}
    assert not verdict.silent
    verdict = witness.judge(GREY, {"a": BOX, "grown": LARGER}, True, None, 0)
    assert not verdict.doubted, "of a size the witness cannot judge"
    assert witness.judge(GREY, {"b": ELSEWHERE}, True, None, 0).doubted == {"b"}


def test_after_a_while_without_support_the_most_similar_speaks_with_those_that_agree() -> None:
    witness = Witness(GREY, BOX, 0)
    boxes: dict[str, Box] = {"a": BOX, "same": LARGER, "b": ELSEWHERE}
    lost, second = _fused("predicted"), 1_000_000_000
    witness.judge(GREY, boxes, True, _fused("tracking", 1.0, 0.1), second)
    assert not witness.judge(GREY, {"a": BOX, "b": NEARBY}, True, lost, second + 50_000_000).silent
    verdict = witness.judge(GREY, boxes, True, lost, second + 100_000_000)
    assert verdict.silent == {"b"}
    assert set(verdict.begun) == {"a", "same"}
    again = witness.judge(GREY, boxes, True, lost, second + 150_000_000)
    assert (again.silent, again.begun) == ({"b"}, ())
    nearby: dict[str, Box] = {"a": BOX, "b": NEARBY}
    assert not witness.judge(GREY, nearby, True, _fused("tracking", 1.0, 1.0), second + 200_000_000).silent


def test_what_is_out_of_reach_is_not_heard_unless_the_target_is_lost_anyway() -> None:
    boxes: dict[str, Box] = {"a": ELSEWHERE, "b": ELSEWHERE}
    assert Witness(GREY, BOX, 0).judge(GREY, boxes, True, _fused("predicted"), 50_000_000).silent == {"a", "b"}
    assert not Witness(GREY, BOX, 0).judge(GREY, boxes, True, _fused("lost"), 50_000_000).silent


def test_of_two_that_look_alike_the_one_that_is_where_the_target_is_foreseen_is_heard() -> None:
    twin: Box = (155.0, 80.0, 40.0, 30.0)
    both = GREY.copy()
    both[78:112, 153:197] = GREY[78:112, 98:142]
    boxes: dict[str, Box] = {"here": BOX, "a": twin, "b": twin}
    on_target = _fused("tracking", 1.0, 0.1)
    assert Witness(GREY, BOX, 0).judge(both, boxes, True, on_target, 0).silent == {"a", "b"}
    assert Witness(GREY, BOX, 0).judge(both, boxes, True, on_target, 0, BOX).silent == {"a", "b"}
    verdict = Witness(GREY, BOX, 0).judge(both, boxes, True, on_target, 0, twin)
    assert verdict.silent == {"here"}, "the answer has gone astray; they have not"


def test_two_that_agree_for_long_against_the_one_that_is_heard_are_followed_if_they_look_no_less_like_it() -> None:
    twin: Box = (155.0, 80.0, 40.0, 30.0)
    both = GREY.copy()
    both[78:112, 153:197] = GREY[78:112, 98:142]
    boxes: dict[str, Box] = {"here": BOX, "a": twin, "b": twin}
    witness, tracking = Witness(GREY, BOX, 0), _fused("tracking", 1.0, 0.1)
    verdicts = {k: witness.judge(both, boxes, True, tracking, k * 100_000_000, BOX) for k in range(7)}
    assert all(verdicts[k].silent == {"a", "b"} for k in range(5))
    assert (verdicts[6].silent, verdicts[6].begun) == ({"here"}, ("a", "b"))
    unlike: dict[str, Box] = {"here": BOX, "a": ELSEWHERE, "b": ELSEWHERE}
    witness = Witness(GREY, BOX, 0)
    for k in range(10):
        verdict = witness.judge(both, unlike, True, tracking, k * 100_000_000, BOX)
    assert verdict.silent == {"a", "b"} and not verdict.begun
    for k in range(6):
        verdict = witness.judge(both, {**unlike, "c": ELSEWHERE}, True, tracking, (10 + k) * 100_000_000, BOX)
    assert (verdict.silent, verdict.begun) == ({"here"}, ("a", "b", "c")), "three whatever their look"
    verdict = witness.judge(both, unlike, True, tracking, 1_600_000_000, BOX)
    assert verdict.silent == {"here"}, "the answer does not go back when one of them fails"
    alone = Witness(GREY, BOX, 0)
    for k in range(10):  # one against one
        assert alone.judge(both, {"here": BOX, "a": twin}, True, tracking, k * 100_000_000, BOX).silent == {"a"}


def test_two_of_whom_one_is_heard_anyway_are_followed_too() -> None:
    twin: Box = (155.0, 80.0, 40.0, 30.0)
    both = GREY.copy()
    both[78:112, 153:197] = GREY[78:112, 98:142]
    both[78:112, 98:142] = 0.4 * GREY[78:112, 98:142] + 0.6 * GREY[10:44, 10:54]
    boxes: dict[str, Box] = {"here": BOX, "a": twin, "b": (160.0, 82.0, 40.0, 30.0)}
    witness, tracking = Witness(GREY, BOX, 0), _fused("tracking", 1.0, 0.1)
    verdicts = [witness.judge(both, boxes, True, tracking, k * 100_000_000, BOX) for k in range(7)]
    assert verdicts[1].silent == {"b"} and (verdicts[6].silent, verdicts[6].begun) == ({"here"}, ("a", "b"))


def test_who_agrees_with_another_source_where_the_target_is_measured_is_believed_whatever_its_look() -> None:
    boxes: dict[str, Box] = {"a": ELSEWHERE, "b": ELSEWHERE, "c": BOX}
    witness, lost = Witness(GREY, BOX, 0), _fused("lost")
    assert witness.judge(GREY, boxes, True, lost, 0, ELSEWHERE).doubted == {"a", "b"}
    measured = frozenset({"a", "b"})
    assert not witness.judge(GREY, boxes, True, lost, 0, ELSEWHERE, confirmed=measured).doubted


def test_it_learns_only_where_two_agree_and_then_vouches_for_what_it_learned() -> None:
    witness = Witness(GREY, BOX, 0)
    alone, both = _fused("tracking", 1.0, 0.1), _fused("tracking", 1.0, 0.9)
    assert not agreed(alone)
    assert agreed(both)
    before = witness.likeness(GREY, ELSEWHERE)
    witness.learn(GREY, ELSEWHERE, alone)
    assert witness.likeness(GREY, ELSEWHERE) == before
    assert not witness.vouches(GREY, ELSEWHERE, alone)
    witness.learn(GREY, ELSEWHERE, both)
    assert witness.likeness(GREY, ELSEWHERE) > 0.9
    assert witness.vouches(GREY, ELSEWHERE, alone)


def test_one_that_sees_a_target_is_moved_only_where_two_agree_on_a_whole_box() -> None:
    fusion = PictureFusion(("m0", "m1"), FusionConfig(), cv2.cvtColor(GREY, cv2.COLOR_GRAY2BGR), BOX, 0)
    fusion.fused = _fused("tracking", 1.0, 0.9)
    assert fusion.may_move(sees=True)
    fusion.fused = _fused("tracking", 1.0, 0.1)
    assert not fusion.may_move(sees=True)
    assert fusion.may_move(sees=False), "it has nothing of its own to lose"
    both = fusion.fused = _fused("tracking", 1.0, 0.9)
    fusion._witness.found = True
    fusion.put("m1")
    assert not fusion.may_move(sees=True), "one was put on what the other has found"
    fusion._witness.found = False
    fusion.put("m1")
    fusion.fused = Fused(0, "tracking", np.array([120.0, 235.0, 30.0, 40.0]), *_rest(both))
    assert not fusion.may_move(sees=True), "both may have shrunk onto what is left"


def test_a_box_that_touches_the_edge_is_not_whole() -> None:
    shape = (240, 320, 3)
    assert whole(BOX, shape)
    for cut in (
        (0.0, 80.0, 40.0, 30.0),
        (100.0, -1.0, 40.0, 30.0),
        (280.0, 80.0, 40.0, 30.0),
        (100.0, 130.0, 40.0, 115.0),
    ):
        assert not whole(cut, shape)


def test_after_the_answer_broke_off_one_alone_must_be_surer_and_nobody_is_put_on_it() -> None:
    half = GREY.copy()
    half[80:110, 100:130] = GREY[20:50, 20:50]  # something covers a part
    witness = Witness(GREY, BOX, 0)
    witness.learn(GREY, BOX, _fused("tracking", 1.0, 0.9))
    likeness = witness.likeness(half, BOX)
    assert 0.4 < likeness < 0.6
    tracking, lost = _fused("tracking", 1.0, 0.1), _fused("predicted")
    assert not witness.judge(half, {"a": BOX}, True, tracking, 50_000_000).doubted
    assert witness.judge(half, {"a": BOX}, True, lost, 300_000_000).doubted == {"a"}
    assert not witness.judge(half, {"a": BOX}, True, lost, 300_000_000, BOX).doubted, "but not where it is foreseen"
    settled = {"a": Stretch(700_000_000, rides=False)}
    assert witness.judge(half, {"a": BOX}, True, lost, 750_000_000, stretches=settled).doubted == {"a"}
    assert not witness.judge(half, {"a": BOX}, True, lost, 1_300_000_000, stretches=settled).doubted, (
        "what covers passes"
    )
    assert witness.judge(half, {"a": BOX}, True, lost, 300_000_000, ELSEWHERE).doubted == {"a"}
    assert not witness.vouches(GREY, BOX, tracking)
    witness.learn(GREY, BOX, tracking)  # a sure look mends it
    assert witness.vouches(GREY, BOX, tracking)


def test_in_a_picture_that_is_blurred_as_a_whole_less_likeness_is_asked() -> None:
    blurred, tracking = cv2.GaussianBlur(GREY, (0, 0), 30.0), _fused("tracking", 1.0, 0.1)
    used_to_detail, used_to_blur = Witness(GREY, BOX, 0), Witness(GREY, BOX, 0)
    assert 0.15 < used_to_detail.likeness(blurred, BOX) < 0.3
    used_to_blur.judge(blurred, {}, True, tracking, 60_000_000_000)
    assert not used_to_detail.judge(blurred, {"a": BOX}, True, tracking, 50_000_000).doubted
    assert used_to_blur.judge(blurred, {"a": BOX}, True, tracking, 60_050_000_000).doubted == {"a"}


def test_what_was_found_again_by_two_is_not_learned_and_gives_way_to_two_that_look_more_like_the_target() -> None:
    witness, second = Witness(GREY, BOX, 0), 1_000_000_000
    witness.judge(GREY, {"a": BOX}, True, _fused("tracking", 1.0, 0.9, 0.9), second)
    witness.judge(GREY, {}, True, _fused("predicted"), second + 200_000_000)
    here, there = _fused("tracking", 1.0, 0.9), {"a": ELSEWHERE, "b": ELSEWHERE, "c": BOX, "d": BOX}
    before = witness.likeness(GREY, BOX)
    witness.learn(GREY, BOX, here)
    assert witness.likeness(GREY, BOX) == before
    at_twin = Fused(0, "tracking", np.array([240.0, 165.0, 30.0, 40.0]), *_rest(here))
    verdict = witness.judge(GREY, there, True, at_twin, second + 250_000_000)
    assert (verdict.silent, verdict.begun) == ({"a", "b"}, ("c", "d"))
    witness.learn(GREY, BOX, _fused("tracking", 1.0, 0.9, 0.8))
    firm = witness.judge(GREY, there, True, at_twin, second + 300_000_000)
    assert not firm.begun, "three made the answer firm"


def test_three_that_answer_one_after_the_other_make_an_answer_firm_too() -> None:
    witness, moment = Witness(GREY, BOX, 0), 40_000_000
    witness.judge(GREY, {}, True, _fused("predicted"), 300_000_000)
    for number, name in enumerate(("m0", "m1", "m2")):
        judged = {name: Judgement(1.0, 0.0, 0.0, 0.0, 0.0, np.ones(4))}
        here = _fused("tracking")
        t_ns = 400_000_000 + number * moment
        witness.learn(GREY, BOX, Fused(t_ns, "tracking", here.value, here.rate, here.covariance, 0.9, judged, ()))
    before = witness.likeness(GREY, ELSEWHERE)
    witness.learn(GREY, ELSEWHERE, Fused(600_000_000, "tracking", *_place_of(_fused("tracking", 1.0, 0.9))))
    assert witness.likeness(GREY, ELSEWHERE) > before, "it is learned from again"


def _place_of(fused: Fused) -> tuple:
    return fused.value, *_rest(fused)


def _rest(fused: Fused) -> tuple:
    return fused.rate, fused.covariance, fused.confidence, fused.sources, fused.restart


def test_one_that_has_followed_since_two_agreed_with_what_moves_in_its_box_is_believed_though_it_has_turned() -> None:
    turned, tracking = GREY.copy(), _fused("tracking", 1.0, 0.1)
    turned[80:110, 100:140] = 0.2 * GREY[80:110, 100:140] + 0.8 * GREY[200:230, 20:60]
    ever_since, standing = {"a": Stretch(0, rides=True)}, {"a": Stretch(0, rides=False)}
    witness = Witness(GREY, BOX, 0)
    assert 0.1 < witness.likeness(turned, BOX) < 0.3
    assert not witness.judge(turned, {"a": BOX}, True, tracking, 50_000_000, stretches=ever_since).doubted
    assert witness.judge(turned, {"a": BOX}, True, tracking, 50_000_000, stretches=standing).doubted == {"a"}
    lost_since = {"a": Stretch(20_000_000, rides=True)}
    assert witness.judge(turned, {"a": BOX}, True, tracking, 50_000_000, stretches=lost_since).doubted == {"a"}
    assert witness.judge(GREY, {"a": NEARBY}, True, tracking, 50_000_000, stretches=ever_since).doubted == {"a"}
    assert not witness.vouches(turned, BOX, tracking), "but nobody is put on it"


def test_where_the_answer_rests_on_one_for_long_another_that_surely_is_the_target_is_followed() -> None:
    at_twin = Fused(0, "tracking", np.array([240.0, 165.0, 30.0, 40.0]), *_rest(_fused("tracking", 0.9, 0.0)))
    boxes: dict[str, Box] = {"there": ELSEWHERE, "a": BOX}
    witness = Witness(GREY, BOX, 0)
    begun = {k: witness.judge(GREY, boxes, True, at_twin, k * 50_000_000).begun for k in range(1, 10)}
    assert [k for k, names in begun.items() if names] == [7, 8, 9], (
        "alone for 0.25 s, and of that look since the last picture before"
    )
    assert set(begun[7]) == {"a"}
    foreseen = Witness(GREY, BOX, 0)
    for k in range(1, 10):
        assert not foreseen.judge(GREY, boxes, True, at_twin, k * 50_000_000, ELSEWHERE).begun


def test_where_all_go_over_to_a_thing_that_looks_the_same_the_target_is_kept_where_its_motion_leads() -> None:
    twins = GREY.copy()
    twins[118:152, 148:192] = GREY[78:112, 98:142]  # the target and its rim, copied
    moving = Fused(0, "tracking", np.array([100.0, 95.0, 30.0, 40.0]), *_rest(_fused("tracking", 1.0, 0.9)))
    moving.rate[:2] = (400.0, 0.0)  # 20 px a picture: the next one shows it at 120, 95
    gone: dict[str, Box] = {"a": (150.0, 120.0, 40.0, 30.0), "b": (151.0, 120.0, 40.0, 30.0)}
    verdict = Witness(GREY, BOX, 0).judge(twins, gone, True, moving, 50_000_000)
    assert verdict.silent == {"a", "b"}
    assert verdict.kept is not None
    assert np.allclose(verdict.kept, BOX, atol=1.0)
    assert Witness(GREY, BOX, 0).judge(twins, gone, True, moving, 1_100_000_000).kept is None, "too long ago"
    assert Witness(GREY, BOX, 0).judge(twins, gone | {"c": BOX}, True, moving, 50_000_000).kept is None, (
        "one has stayed"
    )
    assert Witness(GREY, BOX, 0).judge(twins, gone, True, moving, 50_000_000, BOX).kept is None, "somebody foresees it"


def test_the_target_is_kept_where_its_motion_leads_until_somebody_has_found_it_again() -> None:
    twins = GREY.copy()
    twins[118:152, 148:192] = GREY[78:112, 98:142]
    found: dict[str, Box] = {"a": (150.0, 120.0, 40.0, 30.0)}
    predicted, tracking = _fused("predicted"), _fused("tracking", 1.0, 0.0)
    witness = Witness(GREY, BOX, 0)
    for k in range(1, 8):
        witness.judge(twins, {}, True, predicted, k * 50_000_000)
    kept = witness.judge(twins, found, True, predicted, 400_000_000).kept
    assert kept is not None and np.allclose(kept, BOX, atol=1.0), "nobody has spoken for the answer since"
    witness.judge(twins, {"a": BOX}, True, tracking, 450_000_000)
    assert witness.judge(twins, found, True, tracking, 500_000_000).kept is None, "that may be another thing"


def test_one_that_has_followed_a_small_fast_target_is_where_the_answer_was() -> None:
    turned, moving = GREY.copy(), _fused("tracking", 1.0, 0.1)
    turned[80:110, 100:140] = 0.2 * GREY[80:110, 100:140] + 0.8 * GREY[200:230, 20:60]
    moving = Fused(0, "tracking", np.array([90.0, 95.0, 30.0, 40.0]), *_rest(moving))
    moving.rate[:2] = (600.0, 0.0)  # 30 px a picture: most of its width
    ever_since = {"a": Stretch(0, rides=True)}
    assert not Witness(GREY, BOX, 0).judge(turned, {"a": BOX}, True, moving, 50_000_000, stretches=ever_since).doubted


def test_one_at_the_answer_is_doubted_for_one_elsewhere_only_if_that_looks_far_more_like_the_target() -> None:
    boxes: dict[str, Box] = {"here": BOX, "twin": ELSEWHERE}
    assert not doubted({"here": 0.42, "twin": 0.6}, boxes, BOX, 0.4, None)
    assert doubted({"here": 0.42, "twin": 0.7}, boxes, BOX, 0.4, None) == {"here"}
    assert doubted({"here": 0.42, "twin": 0.6}, boxes, ELSEWHERE, 0.4, None) == {"here"}, "it is not at the answer"


def test_lenience_with_a_blurred_picture_is_for_what_is_where_the_target_was_expected() -> None:
    blurred = cv2.GaussianBlur(GREY, (0, 0), 30.0)
    blurred[150:180, 220:260] = blurred[80:110, 100:140]
    tracking = _fused("tracking", 1.0, 0.1)
    assert not Witness(GREY, BOX, 0).judge(blurred, {"a": BOX}, True, tracking, 50_000_000).doubted
    elsewhere: dict[str, Box] = {"a": ELSEWHERE}
    assert Witness(GREY, BOX, 0).judge(blurred, elsewhere, True, _fused("lost"), 50_000_000).doubted == {"a"}
