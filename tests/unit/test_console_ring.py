"""The distance ring of the console: where its sectors lie, in which colour, and what it says."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from common.messages import (
    SECTORS,
    LimiterStatus,
)
from ground.console import ring
from ground.console.config import ConsoleConfig

CONFIG = ConsoleConfig()


def limiter_status(**changes: object) -> LimiterStatus:
    """A limiter that sees 8 m in a quarter to the north-east and nothing elsewhere, but for the changes."""
    free = LimiterStatus(
        zone="safe",
        distance_m=-1.0,
        ned_direction=(0.0, 0.0, 0.0),
        asked_m_s=1.0,
        allowed_m_s=1.0,
        why="clear",
        h_min_m=0.8,
        h_desired_m=1.5,
        h_mid_m=2.5,
        h_max_m=6.0,
        sectors_m=tuple(8.0 if k < 18 else -1.0 for k in range(SECTORS)),
        seen=tuple(k < 18 for k in range(SECTORS)),
    )
    return msgspec.structs.replace(free, **changes)


def test_each_sector_of_the_ring_lies_at_its_distance_in_the_colour_of_its_zone() -> None:
    near = limiter_status(
        zone="collision",
        distance_m=0.7,
        ned_direction=(0.0, 1.0, 0.0),
        sectors_m=(0.7, 2.0, 4.0, 8.0, *(-1.0 for _ in range(SECTORS - 4))),
    )
    assert [ring.zone_of(d, near) for d in near.sectors_m[:5]] == [
        "collision",
        "transition",
        "warning",
        "safe",
        "blind",
    ]
    segments, colours = ring.arcs(near)
    assert segments.shape == colours.shape == (2 * SECTORS, 2, 3)
    radii = np.linalg.norm(segments[:, 0], axis=1)
    assert radii[[0, 2, 4, 6]] == pytest.approx([0.7, 2.0, 4.0, 6.36], abs=1e-3), "what is free: just outside h_max"
    assert segments[0, 0] == pytest.approx((0.7, 0.0, 0.0)), "from north"
    assert segments[2, 0] == pytest.approx((2.0 * np.cos(np.radians(5)), 2.0 * np.sin(np.radians(5)), 0.0)), "clockwise"
    filled = ring.wedge(near, "collision")
    assert len(ring.wedge_faces()) == 2 * SECTORS and ring.wedge_faces().max() < len(filled)
    assert np.linalg.norm(filled, axis=1).max() == pytest.approx(0.7), "the other zones' sectors collapse"
    assert (ring.limits(near)[1][-1] == ring.in_scene(ring.ZONES["collision"])).all(), "the rim tells the zone"
    east = ring.nearest_m(near)
    assert east is not None and east == pytest.approx((0.0, 0.7, 0.0))


def test_what_is_remembered_in_unseen_space_frees_none_of_it() -> None:
    behind = limiter_status(sectors_m=(*(8.0 for _ in range(18)), 2.0, 7.0, *(-1.0 for _ in range(SECTORS - 20))))
    near, far, unknown = ring.sectors(behind)[18:21]
    assert (near.zone, near.near_m, near.filled) == ("transition", 2.0, "blind"), "its edge alone"
    assert far == unknown, "beyond the ring it is not drawn as free space up to there"
    assert not np.linalg.norm(ring.wedge(behind, "transition"), axis=1).any()
    safe = np.linalg.norm(ring.wedge(behind, "safe"), axis=1)
    assert (safe > 6.0).sum() == 18 * 3, "what is filled as free was looked at"


def test_the_ring_over_the_picture_says_what_is_slowed_and_why() -> None:
    html = ring.hud_html(limiter_status(asked_m_s=2.1, allowed_m_s=0.4, why="bound", label="<b>"), 1.0)
    assert "rotate(-57.3)" in html, "the nose is up"
    assert "asked 2.1, allowed 0.4 m/s" in html and "what can be braked" in html and "<b>&" not in html
    assert not ring.knows_something(limiter_status(sectors_m=(-1.0,) * SECTORS)), "no sensor, no ring"
    assert ring.knows_something(limiter_status(sectors_m=(-1.0,) * SECTORS, why="no data"))
