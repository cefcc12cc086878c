"""Helm and the vehicle's own follower: its command, the take-over when the chase falls silent, the way back."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest

from common.messages import Request
from tests.unit.helm_double import Desk

AHEAD = Request(frame="ned", vector=(1.0, 0.2, 0.0))


def _chase(**helm: Any) -> Desk:
    desk = Desk(link_loss_after_s=5.0, **helm).fly().chase((1.0, 0.0, 0.0))
    desk.follow = AHEAD
    desk.go(3.0)
    return desk


def _silent(desk: Desk) -> None:
    desk.pursuit, desk.tracking = None, None


def test_the_follower_is_obeyed_until_its_target_is_away_for_long():
    desk = Desk(containment={"chase_without_target_s": 3.0}).fly()
    refused = desk.call("follow")
    assert refused.answer is not None and "`outrider do follow-select`" in refused.answer.reason
    desk.follow = AHEAD
    desk.step()
    done = desk.call("follow")
    assert done.answer is not None and done.answer.outcome == "done"
    desk.go(2.0)
    assert (desk.state, desk.setpoints[-1].source) == ("follow", "follow")
    assert desk.vehicle.v[:2] == pytest.approx([1.0, 0.2], abs=0.1)
    desk.follow = None
    desk.go(0.5)
    assert (desk.state, desk.setpoints[-1].source) == ("follow", "helm"), "without a request: hover"
    assert desk.go(4.0, until="hold")
    assert "no target for" in desk.node.flight.machine.reason


def test_the_stick_ends_a_follow():
    desk = Desk().fly()
    desk.follow = AHEAD
    desk.step()
    desk.call("follow")
    desk.operator = Request(frame="heading", vector=(0.0, 1.0, 0.0))
    desk.go(0.5)
    assert desk.state == "operator"


def test_the_follower_takes_over_without_a_jump_and_hands_back():
    desk = _chase(follow_on_link_loss=True)
    assert desk.state == "pursuit" and desk.setpoints[-1].source == "pursuit", "the chase while it speaks"
    before = len(desk.setpoints)
    _silent(desk)
    assert desk.go(1.0, until="follow")
    desk.go(5.0)
    flown = desk.setpoints[before - 1 :]
    assert "helm" not in {s.source for s in flown}, "no hover between the two"
    changes = [math.dist(a.ned_v_m_s[:2], b.ned_v_m_s[:2]) for a, b in itertools.pairwise(flown)]
    assert max(changes) <= 2.5 * 0.1 + 1e-6, "helm's slew holds for it as for anyone"
    assert desk.state == "follow" and "following the chase's target" in desk.node.flight.machine.reason

    desk.pursuit, desk.tracking = Request(frame="ned", vector=(0.9, 0.1, 0.0)), "lost"
    desk.go(2.0)
    assert desk.state == "follow", "a chase that has not got its target does not get the vehicle"
    desk.tracking = "tracking"
    desk.go(0.8)
    assert desk.state == "follow", "not at once"
    assert desk.go(0.5, until="pursuit")
    desk.step()
    assert desk.setpoints[-1].source == "pursuit"


def test_without_being_told_helm_hands_nothing_over():
    desk = _chase()
    _silent(desk)
    desk.go(2.0)
    assert (desk.state, desk.setpoints[-1].source) == ("pursuit", "helm")
    assert desk.go(5.0, until="returning")


def test_a_take_over_ends_as_the_lost_link_would_have():
    alone = _chase(follow_on_link_loss=True, follow_without_link_s=4.0)
    _silent(alone)
    assert alone.go(1.0, until="follow") and not alone.go(3.0, until="returning")
    assert alone.go(2.0, until="returning"), "it does not follow for ever"

    blind = _chase(follow_on_link_loss=True, link_loss_action="hover")
    _silent(blind)
    assert blind.go(1.0, until="follow")
    blind.follow = None
    blind.go(1.0)
    assert blind.setpoints[-1].source == "helm", "hover without a target"
    assert blind.go(6.0, until="hold")


def test_a_commanded_follow_is_not_handed_to_the_chase():
    desk = Desk(follow_on_link_loss=True).fly()
    desk.follow = AHEAD
    desk.step()
    desk.call("follow")
    desk.pursuit, desk.tracking = Request(frame="ned", vector=(0.9, 0.1, 0.0)), "tracking"
    desk.go(4.0)
    assert desk.state == "follow"
