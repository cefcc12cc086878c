"""Ground truth of the simulated world, as it travels on the bus: for reports and tests. No algorithm may read it."""

from __future__ import annotations

from common.messages import Message, Quat, Vec2, Vec3


class TruthObstacle(Message, frozen=True, kw_only=True):
    """A barrel, wall or person of the simulated world."""

    label: str
    """Kind and number in the scenario file (`barrel 1`, `wall 2`, `person 1`)."""
    ned_p_m: Vec3
    """Centre of its body, NED, m."""
    ned_v_m_s: Vec3
    """Velocity, NED, m/s."""
    distance_m: float
    """Distance from the vehicle's centre to the nearest point of its surface, m; negative inside."""
    ned_nearest_m: Vec3
    """That point, NED, m."""


class Truth(Message, frozen=True, kw_only=True):
    """Ground truth of the simulated world at the header's `capture_ns`. No algorithm may read it."""

    ned_p_m: Vec3
    """Vehicle position, NED, m."""
    ned_v_m_s: Vec3
    """Vehicle velocity, NED, m/s."""
    ned_q_body: Quat
    """Vehicle attitude."""
    target_ned_p_m: Vec3
    """Centre of the chased car, NED, m."""
    target_ned_v_m_s: Vec3
    """Velocity of the car, NED, m/s."""
    target_heading_rad: float
    """Heading of the car, rad from north, clockwise."""
    target_corners_px: tuple[Vec2, ...] = ()
    """Corners of the car's roof rectangle in the picture, px; empty when it is out of view."""
    target_visible: bool
    """Whether most of the car is in view and not occluded."""
    obstacles: tuple[TruthObstacle, ...] = ()
    """Barrels, walls and people; trees, houses and cars are not among them."""
