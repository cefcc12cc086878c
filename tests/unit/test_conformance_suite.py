"""Running checks: what is not flown, what is put back, and what an interruption leaves behind."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from simulation.conformance.judge import Judge
from simulation.conformance.registry import CHECKS, Check
from simulation.conformance.suite import run_checks
from simulation.conformance.vehicle import Vehicle
from tests.unit.conformance_rig import ConformanceRig


@pytest.fixture
def rig() -> Iterator[ConformanceRig]:
    rig = ConformanceRig()
    yield rig
    rig.close()


def test_without_leave_nothing_that_moves_is_run(rig: ConformanceRig) -> None:
    checks = [CHECKS[name] for name in ("home", "arming", "velocity", "land", "reboot")]
    results = run_checks(rig.vehicle, checks, may_fly=False)
    assert [r.outcome for r in results] == ["pass", "not flown", "not flown", "not flown", "not flown"]
    assert not rig.wire.autopilot.vehicle.modes.armed


def test_a_changed_parameter_is_put_back(rig: ConformanceRig) -> None:
    def change(vehicle: Vehicle, judge: Judge) -> None:
        """Changes a parameter."""
        judge.truth("written", vehicle.set_param("COM_OBL_RC_ACT", 5), "", "")
        judge.equal("now", rig.wire.autopilot.vehicle.parameters["COM_OBL_RC_ACT"], 5)

    (result,) = run_checks(rig.vehicle, [Check("change", change)], may_fly=False)
    assert result.outcome == "pass"
    assert rig.wire.autopilot.vehicle.parameters["COM_OBL_RC_ACT"] == 0


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_whatever_ends_a_flight_lands_it_and_restores_its_parameters(
    rig: ConformanceRig, error: type[BaseException]
) -> None:
    def interrupted(vehicle: Vehicle, judge: Judge) -> None:
        """Ends early."""
        vehicle.set_param("COM_OBL_RC_ACT", 5)
        raise error

    with pytest.raises(error):
        run_checks(rig.vehicle, [Check("interrupted", interrupted, "air")], may_fly=True)
    vehicle = rig.wire.autopilot.vehicle
    assert vehicle.landed and not vehicle.modes.armed
    assert vehicle.parameters["COM_OBL_RC_ACT"] == 0


def test_a_check_that_compares_nothing_has_not_passed(rig: ConformanceRig) -> None:
    (result,) = run_checks(rig.vehicle, [Check("empty", lambda vehicle, judge: None)], may_fly=False)
    assert result.failed
