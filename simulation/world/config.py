"""Configuration of the simulated world; what stands in it is in the scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import NonNegative, Port, Positive, Section


class WorldConfig(Section, frozen=True, kw_only=True):
    """Scenario, source of the vehicle's pose, timing. Picture size and rate are the camera's: `[camera.down]`."""

    scenario: str = "chase"
    """Scenario: a name in `deploy/scenarios`, or a path to a TOML file."""
    seed: int | None = None
    """Seed of everything random in the scenario; None takes the scenario's own."""
    car_start: Literal["airborne", "immediately"] = "airborne"
    """When cars set off: once the vehicle is above `airborne_height_m`, or at once; their path may add a delay."""
    airborne_height_m: Positive = 1.5
    """True height above home from which the vehicle counts as airborne, m."""

    source: Literal["truth", "local"] = "truth"
    """Where the pose comes from: HIL_STATE_QUATERNION of a simulator's truth port, or LOCAL_POSITION_NED with
    ATTITUDE_QUATERNION of a link of the world's own (an autopilot without a truth port)."""
    host: str = "127.0.0.1"
    """Address to listen on, and of the autopilot."""
    port: Port = 19410
    """Port that the pose comes to."""
    autopilot_port: Port = 19450
    """Port that stream rates are asked from while nothing has come; afterwards they are asked from the sender."""
    home: tuple[float, float, float] | Literal["first"] = "first"
    """Latitude and longitude, degrees, and altitude, m, of the NED origin. `first`: the first truth message, which is
    right when the world starts before the takeoff. Set it where the world may restart in flight."""
    truth_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=250)] = 100.0
    """Rate that is asked of the pose messages, Hz."""
    smoothing_s: NonNegative = 0.15
    """Time constant with which the position follows its measurements, integrating velocity between, s (truth positions
    come in steps of 1.1 cm)."""

    render_delay_ms: NonNegative = 3.0
    """How long before the present the picture is taken, ms: its capture stamp. At 100 Hz the pose is then on
    average 2 ms and at most 7 ms ahead of the newest one, carried there by velocity and body rates: below a
    millimetre and 0.1 degrees. More delay would only cost latency."""
    longest_extrapolation_ms: NonNegative = 30.0
    """How far beyond the newest pose a picture may be taken, ms; beyond, its stamp stays behind."""
