"""What each message type refuses, and that every field says what it is."""

from __future__ import annotations

import ast
import inspect
import math
import sys
from itertools import pairwise
from typing import Any

import msgspec
import pytest

from common.messages import (
    JOINTS,
    CameraInfo,
    HelmStatus,
    Image,
    LimiterStatus,
    Message,
    MessageError,
    Obstacle,
    Obstacles,
    PersonDetection,
    PersonPicture,
    Request,
    Track,
    VehicleState,
    View,
)
from tests.property.strategies import message_types

LEVEL = (1.0, 0.0, 0.0, 0.0)


def state(**changes: Any) -> VehicleState:
    fields: dict[str, Any] = {
        "ned_p_m": (0.0, 0.0, -5.0),
        "ned_v_m_s": (0.0, 0.0, 0.0),
        "ned_q_body": LEVEL,
        "body_rates_rad_s": (0.0, 0.0, 0.0),
        "armed": True,
        "in_air": True,
        "mode": "OFFBOARD",
        "battery_fraction": 0.9,
    }
    return VehicleState(**{**fields, **changes})


def info(**changes: Any) -> CameraInfo:
    fields: dict[str, Any] = {
        "camera": "down",
        "width": 640,
        "height": 480,
        "fx_px": 440.0,
        "fy_px": 440.0,
        "cx_px": 319.5,
        "cy_px": 239.5,
        "body_q_camera": LEVEL,
        "body_p_camera_m": (0.0, 0.0, 0.0),
        "rate_hz": 20.0,
    }
    return CameraInfo(**{**fields, **changes})


def picture(**changes: Any) -> Image:
    fields: dict[str, Any] = {"camera": "down", "width": 4, "height": 2, "encoding": "bgr8", "data": bytes(24)}
    return Image(**{**fields, **changes})


def view(**changes: Any) -> View:
    fields: dict[str, Any] = {
        "ned_q_sensor": (1.0, 0.0, 0.0, 0.0),
        "half_width_rad": math.pi,
        "half_height_rad": 0.5,
        "range_m": 8.0,
        "columns": 3,
        "rows": 2,
        "seen": (True, False) * 3,
    }
    return View(**{**fields, **changes})


def limited(**changes: Any) -> LimiterStatus:
    fields: dict[str, Any] = {
        "zone": "safe",
        "distance_m": -1.0,
        "ned_direction": (0.0, 0.0, 0.0),
        "asked_m_s": 1.0,
        "allowed_m_s": 1.0,
        "why": "clear",
        "h_min_m": 0.8,
        "h_desired_m": 1.5,
        "h_mid_m": 2.5,
        "h_max_m": 6.0,
        "sectors_m": (-1.0,) * 72,
        "seen": (False,) * 72,
    }
    return LimiterStatus(**{**fields, **changes})


def person(**changes: Any) -> PersonDetection:
    fields: dict[str, Any] = {
        "number": 1,
        "box_px": (10.0, 20.0, 30.0, 60.0),
        "joints_px": ((12.0, 30.0, 0.9),) * len(JOINTS),
        "presence": 1.0,
        "fresh": True,
        "with_depth": False,
    }
    return PersonDetection(**{**fields, **changes})


@pytest.mark.parametrize(
    "message",
    [
        state(),
        state(battery_fraction=-1.0),
        info(),
        picture(),
        picture(encoding="gray8", data=bytes(8)),
        picture(encoding="jpeg", data=b"\xff\xd8\xff\xd9"),
        Obstacles(obstacles=()),
        Obstacle(distance_m=0.0, ned_direction=(0.0, 0.6, 0.8)),
        Obstacles(obstacles=(), views=(view(),)),
        limited(),
        person(),
        person(ned_p_m=(1.0, 2.0, 0.0), ned_p_cov_m2=(0.1, 0.0, 0.0, 0.1, 0.0, 0.1), size_m=(1.7, 0.5, 0.3)),
        PersonPicture(number=1, taken_ns=0, jpeg=b"\xff\xd8\xff\xd9"),
        Request(frame="ned", vector=(1.0, 0.0, 0.0)),
        Track(state="idle"),
    ],
)
def test_good_messages_pass(message: Message) -> None:
    assert message.check() is None


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (state(ned_p_m=(0.0, math.nan, 0.0)), "ned_p_m: got nan, expected a finite number"),
        (state(battery_fraction=math.inf), "battery_fraction: got inf"),
        (state(ned_q_body=(1.0, 1.0, 0.0, 0.0)), "ned_q_body: got norm 1.4142, expected a unit quaternion"),
        (state(ned_q_body=(0.0, 0.0, 0.0, 0.0)), "ned_q_body: got norm 0.0000"),
        (info(body_q_camera=(0.5, 0.0, 0.0, 0.0)), "body_q_camera: got norm 0.5000"),
        (info(fx_px=0.0), "fx_px: got 0.0, expected 1.0 to 100000.0"),
        (info(distortion=(0.0, 0.0, math.nan, 0.0, 0.0)), "distortion: got nan"),
        (picture(data=bytes(23)), r"data: got 23 bytes, expected 24 for 4x2 bgr8 \(a truncated frame\?\)"),
        (picture(encoding="gray8"), "data: got 24 bytes, expected 8 for 4x2 gray8"),
        (picture(encoding="jpeg", data=b"\xff\xd8 cut off"), "no whole JPEG"),
        (picture(width=0, data=b""), "width: got 0, expected 1 to 16384"),
        (picture(height=20_000), "height: got 20000"),
        (Obstacle(distance_m=-0.1, ned_direction=(0.0, 0.0, 1.0)), "distance_m: got -0.1"),
        (
            Obstacle(distance_m=1.0, ned_direction=(0.0, 0.0, 0.0)),
            "ned_direction: got norm 0.0000, expected a unit vector",
        ),
        (Obstacles(obstacles=(Obstacle(distance_m=math.nan, ned_direction=(0.0, 0.0, 1.0)),)), "distance_m: got nan"),
        (view(seen=(True,) * 5), "seen: got 5 cells, expected 6 = 3 columns x 2 rows"),
        (view(half_width_rad=3.2), "half_width_rad: got 3.2, expected 0.001 to 3.14"),
        (view(ned_q_sensor=(0.0, 0.0, 0.0, 0.0)), "ned_q_sensor: got norm 0.0000"),
        (Obstacles(obstacles=(), views=(view(columns=0, seen=()),)), "columns: got 0, expected 1 to 1024"),
        (limited(sectors_m=(1.0,) * 71), "sectors_m: got 71 sectors, expected 72"),
        (limited(sectors_m=(math.inf,) * 72), "sectors_m: got inf"),
        (person(number=0), "number: got 0, expected 1"),
        (person(joints_px=((1.0, 2.0, 0.9),) * 14), "joints_px: got 14 joints, expected 15"),
        (person(ned_p_m=(1.0, math.nan, 0.0)), "ned_p_m: got nan"),
        (PersonPicture(number=1, taken_ns=0, jpeg=b"\xff\xd8 cut off"), "jpeg: got 10 bytes that are no whole JPEG"),
        (limited(seen=(True,) * 71), "seen: got 71 sectors, expected 72"),
        (Request(frame="ned", vector=(1.0, 0.0, -math.inf)), "vector: got -inf"),
        (Request(frame="ned", vector=(1.0, 0.0, 0.0), valid_ms=-1.0), "valid_ms: got -1.0, expected 0.0 to 10000.0"),
    ],
)
def test_content_that_breaks_a_promise_is_named(message: Message, words: str) -> None:
    with pytest.raises(MessageError, match=words):
        message.check()


def test_the_key_of_a_bad_number_in_a_table_is_named() -> None:
    from common.messages import Health

    health = Health(
        node="n",
        pid=1,
        steps=0,
        step_ms_median=0.0,
        step_ms_max=0.0,
        input_age_ms={"camera/down/jpeg": math.nan},
        dropped={},
        rejected={},
        errors=0,
    )

    with pytest.raises(MessageError, match=r"input_age_ms\.camera/down/jpeg: got nan"):
        health.check()


@pytest.mark.parametrize(
    ("plain", "words"),
    [
        ({"state": "hunting"}, "Invalid enum value 'hunting'"),
        ({"state": "idle", "x": 3.0}, "unknown field `x`"),
        ({"state": "idle", "x_px": "left"}, "Expected `float`, got `str`"),
        ({}, "missing required field `state`"),
        ({"state": "idle", "error": [1.0]}, "length 2"),
    ],
)
def test_shape_and_type_are_held_by_the_type(plain: dict, words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(plain, Track)


def test_messages_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        state().armed = False  # type: ignore[misc]


def test_defaults_are_not_shared() -> None:
    fields: dict[str, Any] = {
        "state": "standby",
        "source": "",
        "reason": "",
        "streaming": False,
        "mode": "HOLD",
        "armed": False,
        "in_air": False,
        "limiter_zone": "safe",
        "limiter_distance_m": -1.0,
        "request_age_ms": -1.0,
    }
    assert HelmStatus(**fields).counters is not HelmStatus(**fields).counters


@pytest.mark.parametrize("kind", message_types(), ids=lambda k: k.__name__)
def test_every_field_is_documented_and_typed_for_the_wire(kind: type[Message]) -> None:
    tree = ast.parse(inspect.getsource(sys.modules[kind.__module__]))
    body = next(n.body for n in tree.body if isinstance(n, ast.ClassDef) and n.name == kind.__name__)
    documented = {
        item.target.id
        for item, after in pairwise(body)
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and isinstance(after, ast.Expr)
        and isinstance(after.value, ast.Constant)
    }

    assert documented == set(kind.__struct_fields__)
    assert kind.__doc__
    assert all(f.type is not Any for f in msgspec.structs.fields(kind))
