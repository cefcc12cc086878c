"""The gate before arming: what must be right, what was found, what to do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from common.messages import PreflightItem
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.base import Dialect
from onboard.helm.telemetry import LINK_AGED_S, Telemetry

_ESTIMATE_AGE_S = 0.5


@dataclass(frozen=True)
class CameraView:
    """What helm knows of the camera, from its calibration message."""

    picture_age_s: float
    """Age of its newest picture, s."""
    rate_hz: float
    """Nominal rate, Hz."""


def gate(
    telemetry: Telemetry, parameters: Mapping[str, float], camera: CameraView | None, config: HelmConfig, t_ns: int
) -> tuple[PreflightItem, ...]:
    """The items of the gate, in the order in which to put them right.

    Args:
        telemetry: the autopilot now.
        parameters: its parameters as last read back.
        camera: the camera; None when it has sent no calibration.
        config: what is wanted.
        t_ns: now, ns.
    """
    return (
        _link(telemetry, config, t_ns),
        _estimate(telemetry, t_ns),
        _item(
            "autopilot ready",
            telemetry.ready,
            "its own checks pass",
            "its own pre-arm checks do not pass yet; wait, then look at its messages",
        ),
        _item("home", telemetry.home_local_m is not None, "set", "not set; wait for the position estimate"),
        _battery(telemetry, config),
        *_parameters(parameters, telemetry.dialect, config),
        *_camera(camera, config),
    )


def refusal(items: Sequence[PreflightItem]) -> str:
    """Why the gate is closed, in one line; empty when it is open."""
    return "; ".join(f"{item.name}: {item.detail}" for item in items if not item.ok)


def _item(name: str, ok: bool, found: str, cure: str) -> PreflightItem:
    return PreflightItem(name=name, ok=ok, detail=found if ok else cure)


def _link(telemetry: Telemetry, config: HelmConfig, t_ns: int) -> PreflightItem:
    age_s = telemetry.age_s(t_ns)
    return _item(
        "link",
        age_s < LINK_AGED_S,
        f"{telemetry.dialect.title}, heard {max(age_s, 0.0):.1f} s ago" if math.isfinite(age_s) else "",
        telemetry.unfit or f"no word from the autopilot at {config.autopilot_url}; start it, or set helm.autopilot_url",
    )


def _estimate(telemetry: Telemetry, t_ns: int) -> PreflightItem:
    age_s = telemetry.estimate_age_s(t_ns)
    found = f"an estimate {max(age_s, 0.0):.1f} s old" if math.isfinite(age_s) else "no estimate"
    return _item(
        "position and attitude",
        age_s < _ESTIMATE_AGE_S,
        "healthy",
        f"got {found}, expected at most {_ESTIMATE_AGE_S:g} s; wait for the position fix",
    )


def _battery(telemetry: Telemetry, config: HelmConfig) -> PreflightItem:
    charge = telemetry.battery_fraction
    if charge < 0.0:
        return _item(
            "battery",
            not config.battery_required,
            "unknown, not required",
            "charge unknown; wait for BATTERY_STATUS, or set helm.battery_required = false",
        )
    return _item(
        "battery",
        charge >= config.battery_min,
        f"{charge:.0%}",
        f"got {charge:.0%}, expected at least {config.battery_min:.0%}; charge it",
    )


def _parameters(parameters: Mapping[str, float], dialect: Dialect, config: HelmConfig) -> list[PreflightItem]:
    items = []
    for name, wanted in config.parameters_of(dialect).items():
        if name == dialect.takeoff_parameter:
            continue
        got = parameters.get(name)
        ok = got is not None and math.isclose(got, wanted, rel_tol=1e-4, abs_tol=1e-4)
        found = "not read yet" if got is None else f"got {got:g}"
        items.append(
            _item(
                dialect.parameter_titles.get(name, name),
                ok,
                f"{name} = {wanted:g}",
                f"{name}: {found}, expected {wanted:g}; helm writes it on the ground, look at its log",
            )
        )
    return items


def _camera(camera: CameraView | None, config: HelmConfig) -> tuple[PreflightItem, PreflightItem]:
    optional = not config.camera_required
    calibration = _item(
        "calibration",
        camera is not None or optional,
        "present" if camera else "absent, not required",
        "camera/down/info has not come; start the camera node",
    )
    if camera is None:
        return calibration, _item("camera", optional, "absent, not required", "no picture; start the camera node")
    fresh = camera.picture_age_s <= config.camera_max_age_s
    return calibration, _item(
        "camera",
        fresh or optional,
        f"picture {max(camera.picture_age_s, 0.0):.1f} s old",
        f"newest picture is {camera.picture_age_s:.1f} s old, expected at most "
        f"{config.camera_max_age_s:g} s; look at the camera node",
    )
