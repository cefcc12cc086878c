"""What the target's own motion rules out: boxes out of reach, of another size, and things alike elsewhere."""

from __future__ import annotations

from common.tracking.base import Box
from onboard.fusion.prior import as_foreseen, elsewhere, gone, out_of_reach, outshining, rivals

LAST: Box = (100.0, 100.0, 40.0, 40.0)
NEAR: Box = (110.0, 95.0, 40.0, 40.0)
TWIN: Box = (150.0, 130.0, 40.0, 40.0)
FAR: Box = (300.0, 100.0, 40.0, 40.0)
HUGE: Box = (60.0, 60.0, 130.0, 130.0)


def test_what_is_too_far_or_too_large_is_another_thing_until_time_has_passed() -> None:
    boxes = {"near": NEAR, "twin": TWIN, "far": FAR, "huge": HUGE}
    assert out_of_reach(boxes, LAST, 0.0) == {"far", "huge"}
    assert out_of_reach(boxes, LAST, 0.6) == {"far", "huge"}
    assert out_of_reach(boxes, LAST, 0.8) == set()


def test_two_at_a_twin_do_not_outvote_the_one_that_went_on_where_the_target_was_expected() -> None:
    boxes = {"here": NEAR, "a": TWIN, "b": TWIN}
    assert elsewhere({"here": 0.8, "a": 0.85, "b": 0.7}, boxes, LAST) == {"a", "b"}
    assert elsewhere({"here": 0.8, "a": 0.95, "b": 0.7}, boxes, LAST) == {"b"}, "one clearly more alike is heard"
    assert not elsewhere({"here": 0.4, "a": 0.45, "b": 0.3}, boxes, LAST), "what is there does not look like it either"
    assert elsewhere({"here": 0.4, "a": 0.45, "b": 0.3}, boxes, LAST, least=0.4) == {"a", "b"}
    assert not elsewhere({"a": 0.85, "b": 0.7}, {"a": TWIN, "b": TWIN}, LAST), "nobody is there"


def test_all_have_left_the_target_that_still_is_where_it_was_expected_unless_they_look_more_like_it() -> None:
    boxes = {"a": TWIN, "b": TWIN}
    assert gone({"a": 0.55, "b": 0.5}, boxes, LAST, 0.5) == {"a", "b"}
    assert not gone({"a": 0.65, "b": 0.5}, boxes, LAST, 0.5), "one looks clearly more like it"
    assert not gone({"a": 0.3, "b": 0.3}, boxes, LAST, 0.35), "what is left there does not look like it"
    assert not gone({"here": 0.5, "a": 0.5}, {"here": NEAR, "a": TWIN}, LAST, 0.5), "one has stayed"


def test_somebody_beside_the_place_where_the_target_is_foreseen_or_of_another_size_is_not_the_target() -> None:
    foreseen: Box = (100.0, 100.0, 25.0, 90.0)
    assert as_foreseen((112.0, 105.0, 25.0, 90.0), foreseen) and as_foreseen((98.0, 90.0, 30.0, 110.0), foreseen)
    assert not as_foreseen((146.0, 100.0, 25.0, 90.0), foreseen), "0.9 m beside somebody of 1.75 m"
    assert not as_foreseen((105.0, 110.0, 16.0, 60.0), foreseen)


def test_two_that_agree_elsewhere_overrule_those_at_the_answer_if_they_look_more_like_it_or_are_more() -> None:
    boxes: dict[str, Box] = {"here": NEAR, "too": LAST, "a": TWIN, "b": TWIN}
    assert rivals({"here": 0.6, "too": 0.6, "a": 0.8, "b": 0.7}, boxes, LAST) == {"a", "b"}
    assert not rivals({"here": 0.6, "too": 0.6, "a": 0.65, "b": 0.7}, boxes, LAST), "hardly more alike"
    one: dict[str, Box] = {"here": NEAR, "a": TWIN, "b": TWIN}
    assert rivals({"here": 0.7, "a": 0.65, "b": 0.7}, one, LAST) == {"a", "b"}, "two against one"
    assert not rivals({"here": 0.9, "a": 0.65, "b": 0.7}, one, LAST)
    assert rivals({"here": 0.6, "too": 0.6, "a": 0.65, "b": 0.6}, boxes, LAST, frozenset({"too"})) == {"a", "b"}, (
        "one was put there"
    )
    nobody: dict[str, Box] = {"a": TWIN, "b": TWIN}
    assert rivals({"a": 0.9, "b": 0.8}, nobody, LAST) == {"a", "b"}, "nobody is there, and they surely look like it"
    assert not rivals({"a": 0.6, "b": 0.7}, nobody, LAST)
    assert not rivals({"here": 0.2, "a": 0.9}, {"here": NEAR, "a": TWIN}, LAST), "one alone overrules nobody"


def test_one_elsewhere_outshines_those_at_the_answer_only_if_it_surely_is_the_target_and_they_hardly() -> None:
    boxes: dict[str, Box] = {"here": NEAR, "a": TWIN, "b": TWIN}
    assert outshining({"here": 0.55, "a": 0.9, "b": 0.6}, boxes, LAST) == {"a", "b"}
    assert not outshining({"here": 0.7, "a": 0.9, "b": 0.6}, boxes, LAST), "that may be it, too"
    assert not outshining({"here": 0.3, "a": 0.65, "b": 0.6}, boxes, LAST), "no more than likely"
    assert not outshining({"a": 0.9, "b": 0.9}, {"a": TWIN, "b": TWIN}, LAST), "nobody is there: it may have gone on"
