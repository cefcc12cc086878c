"""The dialects that helm has, and which of them an autopilot's HEARTBEAT calls for."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from onboard.helm.dialect.ardupilot import ARDUPILOT
from onboard.helm.dialect.base import Dialect
from onboard.helm.dialect.px4 import PX4

DIALECTS: Mapping[str, Dialect] = MappingProxyType({dialect.name: dialect for dialect in (PX4, ARDUPILOT)})
"""By the name that `helm.dialect` takes."""
AUTO = "auto"
"""`helm.dialect`: the HEARTBEAT decides."""
_MULTICOPTERS = (2, 3, 13, 14, 15, 29, 35)  # MAV_TYPE: quad, coaxial, hexa, octo, tri, dodeca, deca


class UnfitAutopilot(ValueError):
    """Helm has no dialect for what it heard; the text says what it heard and what to do."""


def recognise(autopilot: int, vehicle_type: int, wanted: str = AUTO) -> Dialect:
    """The dialect of an autopilot.

    Args:
        autopilot: MAV_AUTOPILOT of its HEARTBEAT.
        vehicle_type: MAV_TYPE of its HEARTBEAT.
        wanted: `helm.dialect`; a name instead of `auto` is taken at its word, whatever the autopilot calls itself.

    Raises:
        UnfitAutopilot: no dialect, or no vehicle that helm can fly.
    """
    if vehicle_type not in _MULTICOPTERS:
        raise UnfitAutopilot(
            f"got a vehicle of MAV_TYPE {vehicle_type}, expected a multicopter: helm flies no other; "
            f"look at helm.autopilot_url"
        )
    if wanted != AUTO:
        return DIALECTS[wanted]
    for dialect in DIALECTS.values():
        if dialect.autopilot == autopilot:
            return dialect
    known = ", ".join(f"{d.title} ({d.autopilot})" for d in DIALECTS.values())
    raise UnfitAutopilot(
        f"got an autopilot of MAV_AUTOPILOT {autopilot}, expected one of {known}; if it speaks as one of them, "
        f"set helm.dialect to {' or '.join(DIALECTS)}"
    )
