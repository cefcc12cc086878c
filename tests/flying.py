"""The state of a vehicle that flies, and of its helm, for tests of what looks at them."""

from __future__ import annotations

from typing import Any

from common.messages import HelmStatus, VehicleState


def flying(up_m: float = 5.0, **changes: Any) -> VehicleState:
    """A level vehicle that hovers above home, nose north, in offboard control, but for the changes."""
    state: dict[str, Any] = {
        "ned_p_m": (0.0, 0.0, -up_m),
        "ned_v_m_s": (0.0, 0.0, 0.0),
        "ned_q_body": (1.0, 0.0, 0.0, 0.0),
        "body_rates_rad_s": (0.0, 0.0, 0.0),
        "armed": True,
        "in_air": True,
        "mode": "OFFBOARD",
        "battery_fraction": 0.9,
    }
    return VehicleState(**state | changes)


def helm_status(state: str, **changes: Any) -> HelmStatus:
    """Helm in flight in this state, with the source of the same name and nothing near, but for the changes."""
    status: dict[str, Any] = {
        "state": state,
        "source": state,
        "reason": "",
        "streaming": True,
        "mode": "OFFBOARD",
        "armed": True,
        "in_air": True,
        "limiter_zone": "safe",
        "limiter_distance_m": -1.0,
        "request_age_ms": 10.0,
    }
    return HelmStatus(**status | changes)
