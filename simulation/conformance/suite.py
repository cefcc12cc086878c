"""Runs checks on a vehicle: brings it to where each begins, judges, and leaves it landed, disarmed and as it was."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from simulation.conformance.judge import Judge
from simulation.conformance.registry import Check
from simulation.conformance.report import Result
from simulation.conformance.vehicle import CannotFly, Vehicle


def run_checks(
    vehicle: Vehicle, checks: Sequence[Check], may_fly: bool, tell: Callable[[Result], None] = lambda result: None
) -> list[Result]:
    """Run checks in order; whatever happens, the vehicle is cleaned up.

    Args:
        vehicle: what they are run on.
        checks: in the order in which they run.
        may_fly: whether motors may spin; without it those checks are reported as not flown.
        tell: called with each result.

    Raises:
        CannotFly: the clean-up failed; the text says what was left.
    """
    results: list[Result] = []
    try:
        for check in checks:
            result = _run(vehicle, check) if may_fly or not check.moves else Result(check, "not flown")
            results.append(result)
            tell(result)
    finally:
        vehicle.clean_up()
    return results


def _run(vehicle: Vehicle, check: Check) -> Result:
    judge, start_s = Judge(), vehicle.client.now_s
    reason = ""
    try:
        if check.place == "ground":
            if vehicle.armed:
                vehicle.land()
        else:
            vehicle.hover()
        check.run(vehicle, judge)
    except CannotFly as error:
        reason = str(error)
    finally:
        left = vehicle.after_check()
    if left:
        judge.truth("parameters put back", False, ", ".join(left), "all")
    outcome = "not run" if reason and not judge.lines else "pass" if judge.ok and not reason else "differs"
    return Result(check, outcome, tuple(judge.lines), reason, vehicle.client.now_s - start_s)
