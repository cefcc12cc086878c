"""What every message is: immutable, unknown fields refused, numbers finite; and the checks that messages share."""

from __future__ import annotations

import math
from typing import Any

import msgspec

Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


class MessageError(ValueError):
    """A message whose content is refused; the text says what was got and what was expected."""


class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all messages: immutable, unknown fields refused, numbers finite."""

    def check(self) -> None:
        """Raise MessageError when a value is outside what the field docs promise (here: a number is not finite)."""
        for name in self.__struct_fields__:
            check_finite(name, getattr(self, name))


def check_finite(name: str, value: Any) -> None:
    """Raise MessageError when a number in the value, however deep, is not finite."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise MessageError(f"{name}: got {value}, expected a finite number")
    elif isinstance(value, (tuple, list)):
        for item in value:
            check_finite(name, item)
    elif isinstance(value, dict):
        for key, item in value.items():
            check_finite(f"{name}.{key}", item)
    elif isinstance(value, Message):
        value.check()


def check_quaternion(name: str, quat: Quat) -> None:
    """Raise MessageError unless the quaternion has unit length, within 1 %."""
    norm = math.sqrt(sum(c * c for c in quat))
    if abs(norm - 1.0) > 1e-2:
        raise MessageError(f"{name}: got norm {norm:.4f}, expected a unit quaternion")


def check_direction(name: str, direction: Vec3) -> None:
    """Raise MessageError unless the vector has unit length, within 1 %."""
    norm = math.sqrt(sum(c * c for c in direction))
    if abs(norm - 1.0) > 1e-2:
        raise MessageError(f"{name}: got norm {norm:.4f}, expected a unit vector")


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Raise MessageError unless low <= value <= high."""
    if not low <= value <= high:
        raise MessageError(f"{name}: got {value}, expected {low} to {high}")
