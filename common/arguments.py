"""Types of command-line options: each refuses what cannot be meant, in one line."""

from __future__ import annotations

import argparse
import contextlib
import math


def seconds(text: str) -> float:
    """A time, 0 s or more.

    Raises:
        ArgumentTypeError: something else.
    """
    with contextlib.suppress(ValueError):
        if 0.0 <= (value := float(text)) < math.inf:
            return value
    raise argparse.ArgumentTypeError(f"got {text!r}, expected seconds, 0 or more")


def seed(text: str) -> int:
    """A seed of randomness, a whole number, 0 or more.

    Raises:
        ArgumentTypeError: something else.
    """
    with contextlib.suppress(ValueError):
        if (value := int(text)) >= 0:
            return value
    raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number, 0 or more")
