"""Commands that change the autopilot itself: reboot."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.unit.autopilot_rig import Rig

REBOOT = 246


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig()
    yield rig
    rig.close()


def first_times(rig: Rig) -> dict[str, float]:
    """When each message was first received after the inbox was emptied, rig time, s."""
    first: dict[str, float] = {}
    for t_s, message in rig.companion.inbox:
        first.setdefault(message.get_type(), t_s)
    return first


def test_reboot_is_acknowledged_then_silent_and_the_start_repeats_with_the_clock_at_zero(rig: Rig) -> None:
    rig.run(5.0)
    rig.companion.command(REBOOT, 1.0)
    rig.run(0.39)
    assert rig.companion.acks(REBOOT) == [0]
    rig.run(0.05)
    for peer in rig.peers:
        peer.inbox.clear()
    rig.run(1.9)
    assert [peer.inbox for peer in rig.peers] == [[], [], []]
    restarted_s = rig.t_s
    rig.run(4.7)
    first = first_times(rig)
    for name, t_s in (("HIGHRES_IMU", 0.3), ("HEARTBEAT", 1.35), ("ATTITUDE", 1.8), ("GLOBAL_POSITION_INT", 2.9)):
        assert first[name] - restarted_s == pytest.approx(t_s, abs=0.1), name
    assert rig.companion.got("ATTITUDE")[0].time_boot_ms == pytest.approx(1800, abs=20)
    states = [m.onboard_control_sensors_health >> 28 & 1 for m in rig.companion.got("SYS_STATUS")]
    assert states[0] == 0 and states[-1] == 1


def test_reboot_keeps_parameters_and_place_and_starts_the_local_frame_there(rig: Rig) -> None:
    rig.take_off()
    for index in range(100):
        rig.companion.setpoint(0x5E3, vx=2.0, z=-3.0)
        if index == 4:
            rig.companion.command(176, 1.0, 6.0)
        rig.run(0.05)
    rig.companion.command(21)
    rig.run(14.0)
    before = rig.vehicle.truth.ned_p_m
    assert before[0] > 5.0 and not rig.vehicle.modes.armed
    rig.vehicle.parameters.set("COM_OBL_RC_ACT", 5)
    rig.companion.command(511, 30.0, 500_000.0)
    rig.companion.command(REBOOT, 1.0)
    rig.run(8.0)
    assert rig.vehicle.parameters["COM_OBL_RC_ACT"] == 5
    assert rig.vehicle.truth.ned_p_m == pytest.approx(before, abs=0.01)
    assert rig.autopilot.links[0].interval_us(30) == 10_000, "message rates are the defaults again"
    local, home = rig.companion.got("LOCAL_POSITION_NED")[-1], rig.companion.got("HOME_POSITION")[-1]
    assert (local.x, local.y) == pytest.approx((0.0, 0.0), abs=0.2)
    north_deg = before[0] / 6371000.0 * 57.29578
    assert home.latitude * 1e-7 - rig.vehicle.config.home_lat_deg == pytest.approx(north_deg, abs=2e-7)
    rig.companion.command(400, 1.0)
    rig.companion.command(22)
    rig.run(8.0)
    assert -rig.vehicle.truth.ned_p_m[2] == pytest.approx(2.5, abs=0.3)


def test_reboot_is_denied_while_armed_whatever_the_force_field_says(rig: Rig) -> None:
    rig.take_off()
    rig.companion.command(REBOOT, 1.0)
    rig.companion.command(REBOOT, 1.0, 0.0, 0.0, 0.0, 0.0, 20190226.0)
    rig.run(2.0)
    assert rig.companion.acks(REBOOT) == [2, 2]
    assert rig.vehicle.t_s > 10.0 and -rig.vehicle.truth.ned_p_m[2] > 2.0
    rig.companion.command(REBOOT, 0.0)
    rig.run(1.0)
    assert rig.companion.acks(REBOOT) == [2, 2, 0] and rig.vehicle.modes.armed, "0 asks for nothing"


def test_what_is_sent_to_an_autopilot_that_reboots_is_lost(rig: Rig) -> None:
    rig.run(5.0)
    rig.companion.command(REBOOT, 1.0)
    rig.run(1.0)
    rig.companion.command(400, 1.0)
    rig.run(7.0)
    assert rig.companion.acks(400) == [] and not rig.vehicle.modes.armed
