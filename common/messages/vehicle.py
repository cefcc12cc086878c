"""Messages about the vehicle and who commands it: its state, helm's, requests to helm, and what helm sent.

Units and frames as in `common.messages`.
"""

from __future__ import annotations

from typing import Literal

from common.messages.base import Message, Quat, Vec3, check_quaternion, check_range


class VehicleState(Message, frozen=True, kw_only=True):
    """The autopilot's estimate, published by helm; the header's `capture_ns` is its time on the vehicle clock."""

    ned_p_m: Vec3
    """Position from home, NED, m."""
    ned_v_m_s: Vec3
    """Velocity, NED, m/s."""
    ned_q_body: Quat
    """Attitude."""
    body_rates_rad_s: Vec3
    """Angular velocity in the body frame (FRD), rad/s."""
    armed: bool
    """Motors armed."""
    in_air: bool
    """The autopilot reports flight."""
    mode: str
    """The autopilot's flight mode (`OFFBOARD`, `HOLD`, `LAND`, …)."""
    battery_fraction: float
    """Remaining charge, 0 to 1; -1 when unknown."""
    body_f_m_s2: Vec3 | None = None
    """Specific force in the body frame (FRD), as the accelerometers read it, m/s²; None when none is told."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        check_quaternion("ned_q_body", self.ned_q_body)


class Setpoint(Message, frozen=True, kw_only=True):
    """What helm sent to the autopilot in this control cycle; its header lists what it was computed from."""

    source: str
    """Whose request it is: `pursuit`, `operator`, or `helm` for hover, return and containment."""
    asked_ned_v_m_s: Vec3
    """Velocity that won the arbitration, NED, m/s."""
    ned_v_m_s: Vec3
    """Velocity after limiter and containment, as sent, NED, m/s; with an acceleration, the one that it leads to."""
    height_m: float
    """Height above home that is held, m."""
    yaw_rad: float
    """Heading that is held, rad from north, clockwise."""
    ned_a_m_s2: tuple[float, float] | None = None
    """Horizontal acceleration after limiter and containment, as sent, north and east, m/s²; None for a velocity."""


class PreflightItem(Message, frozen=True, kw_only=True):
    """One line of the gate that is checked before arming."""

    name: str
    """What is checked."""
    ok: bool
    """Whether it lets the vehicle fly."""
    detail: str
    """What was found and expected; when that is not right, `; ` and what to do."""

    def found_and_cure(self) -> tuple[str, str]:
        """The two halves of `detail`; the second is empty when there is nothing to do."""
        found, _, cure = (self.detail, "", "") if self.ok else self.detail.partition("; ")
        return found, cure


class HelmStatus(Message, frozen=True, kw_only=True):
    """State of helm: who commands, why, and what stands in the way."""

    state: str
    """State of the machine in `onboard.helm.states`."""
    source: str
    """Source of the setpoint in force (`pursuit`, `operator`, `helm`), empty when helm sends none."""
    reason: str
    """Why it is in this state, in one sentence."""
    streaming: bool
    """Whether setpoints go to the autopilot."""
    mode: str
    """The autopilot's flight mode."""
    armed: bool
    """Motors armed."""
    in_air: bool
    """In flight."""
    limiter_zone: str
    """`safe`, `warning`, `transition` or `collision`; `blind` without obstacle data."""
    limiter_distance_m: float
    """Distance of the nearest obstacle, m; -1 when there is none."""
    request_age_ms: float
    """Age of the request in force, ms; -1 when there is none."""
    preflight: tuple[PreflightItem, ...] = ()
    """The gate, item by item."""
    counters: dict[str, int] = {}
    """Events since the start: setpoints, stale requests, refusals by reason, yields, takeoff retries, …"""


class Request(Message, frozen=True, kw_only=True):
    """A wish for motion from a task or the operator; helm obeys it while it is fresh, finite and within limits."""

    kind: Literal["velocity", "acceleration"] = "velocity"
    """Domain of `vector`: `acceleration` is a tilt (Teulière 2011's orientation), as what it causes."""
    frame: Literal["ned", "heading"]
    """`ned`, or `heading`: x along the vehicle's heading, y to its right, z down."""
    vector: Vec3
    """Velocity, m/s; or horizontal acceleration, m/s², beside a vertical velocity, m/s. The vertical part moves the
    held height in either case."""
    yaw_rate_rad_s: float = 0.0
    """Heading rate, clockwise seen from above, rad/s."""
    valid_ms: float = 300.0
    """How long after its basis the request may be obeyed, ms; helm's own limit applies as well."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        check_range("valid_ms", self.valid_ms, 0.0, 10_000.0)
