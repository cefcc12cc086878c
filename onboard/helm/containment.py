"""Where and how fast the vehicle may fly, whoever asks: speed, climb, height band, fence, acceleration."""

from __future__ import annotations

import math

from common.messages import Vec3
from onboard.helm.config import ContainmentConfig

_HEIGHT_GAIN_1_S = 1.0
_ALONG_FRACTION = 0.25
_LEAN_S = 0.25
"""Time that the vehicle takes to lean as it is asked, s."""
_LEARN_S, _FORGET_S = 0.5, 0.15
"""Time over which what holds it back is learnt, and forgotten where less does, s."""
_UNNOTICED_S = 0.2
"""What held the vehicle back, should it end at once, makes it faster by what it does in so long, s: until it is noticed
and the vehicle has leant back. Tuned on a vehicle that leans within 0.2 to 0.4 s and has a drag of up to 1 N per m/s
and kg, in winds that end or turn round (`tests/property/test_helm_properties.py`)."""


def contain(ned_v_m_s: Vec3, ned_p_m: Vec3, config: ContainmentConfig) -> Vec3:
    """Velocity within the limits, NED, m/s.

    Horizontal speed and climb rate are cut to their maxima (direction kept). Near the fence the outward component may
    not exceed gain · distance to the fence (falling linearly to zero within the band), beyond it is zero; the part
    along the fence fades in the last quarter of the band; the inward part stays. In the same way the vertical part
    fades towards the ends of the height band.

    Args:
        ned_v_m_s: asked velocity.
        ned_p_m: position from home, NED, m.
        config: the limits.
    """
    if not all(math.isfinite(c) for c in (*ned_v_m_s, *ned_p_m)):
        return (0.0, 0.0, 0.0)
    north, east, down = ned_v_m_s
    speed = math.hypot(north, east)
    if speed > config.speed_m_s:
        north, east = north * config.speed_m_s / speed, east * config.speed_m_s / speed
    north, east = _fence(north, east, ned_p_m[0], ned_p_m[1], config)
    height_m = -ned_p_m[2]
    up = min(max(-down, -config.climb_m_s), config.climb_m_s)
    up = min(up, max((config.height_max_m - height_m) * _HEIGHT_GAIN_1_S, 0.0))
    up = max(up, min((config.height_min_m - height_m) * _HEIGHT_GAIN_1_S, 0.0))
    return (north, east, -up)


def _fence(north: float, east: float, p_north: float, p_east: float, config: ContainmentConfig) -> tuple[float, float]:
    radius = math.hypot(p_north, p_east)
    if radius <= config.radius_m - config.fence_band_m or radius == 0.0:
        return north, east
    n, e = p_north / radius, p_east / radius
    outward = north * n + east * e
    room_m = max(config.radius_m - radius, 0.0)
    radial = min(outward, room_m / config.fence_band_m * config.speed_m_s)
    # Along a curved fence a vehicle that lags behind its setpoint drifts outwards: slow down in the innermost part.
    along = min(room_m / (_ALONG_FRACTION * config.fence_band_m), 1.0)
    return radial * n + (north - outward * n) * along, radial * e + (east - outward * e) * along


class Resistance:
    """What drag and wind take of the accelerations that are asked for.

    A vehicle that leans against the wind to hold its speed does not gain any: what is asked for, as it is flown, less
    what is gained, both over half a second, is what holds it back. Wind may end at once: so less is learnt sooner than
    more, and no more is granted than leaves the vehicle below its largest speed when all of it ends.
    """

    def __init__(self) -> None:
        self._ned_a_m_s2 = (0.0, 0.0)
        self._flown_m_s2 = (0.0, 0.0)
        self._last_v_m_s: tuple[float, float] | None = None

    def reset(self) -> None:
        """Forget everything: no accelerations are asked for."""
        self.__init__()

    def learn(self, ned_v_m_s: Vec3, asked_m_s2: tuple[float, float], dt_s: float) -> None:
        """Take the newest velocity, NED, m/s, and what was asked for since the last one, m/s²."""
        now = (ned_v_m_s[0], ned_v_m_s[1])
        if self._last_v_m_s is not None and dt_s > 0.0:
            lean, learn, forget = (min(dt_s / time_s, 1.0) for time_s in (_LEAN_S, _LEARN_S, _FORGET_S))
            n, e = (f + lean * (a - f) for f, a in zip(self._flown_m_s2, asked_m_s2, strict=True))
            self._flown_m_s2 = (n, e)
            gained = [(v - last) / dt_s for v, last in zip(now, self._last_v_m_s, strict=True)]
            seen = [f - g for f, g in zip(self._flown_m_s2, gained, strict=True)]
            n, e = (
                r + (learn if s * r >= r * r else forget) * (s - r) for r, s in zip(self._ned_a_m_s2, seen, strict=True)
            )
            self._ned_a_m_s2 = (n, e)
        self._last_v_m_s = now

    def against(
        self, ned_a_m_s2: tuple[float, float], ned_v_m_s: tuple[float, float], largest_m_s: float
    ) -> tuple[float, float]:
        """The part of an acceleration that only holds the speed, m/s²: along it, and never more than it.

        Args:
            ned_a_m_s2: acceleration, north and east.
            ned_v_m_s: velocity, north and east, m/s.
            largest_m_s: largest speed, m/s: not passed should that part make the vehicle faster until it is noticed.
        """
        size2 = ned_a_m_s2[0] ** 2 + ned_a_m_s2[1] ** 2
        if size2 == 0.0:
            return (0.0, 0.0)
        along = sum(r * a for r, a in zip(self._ned_a_m_s2, ned_a_m_s2, strict=True)) / size2
        share = min(max(along, 0.0), 1.0)
        # The largest share with |v + share a t| <= largest.
        gain2, room2 = size2 * _UNNOTICED_S**2, largest_m_s**2 - ned_v_m_s[0] ** 2 - ned_v_m_s[1] ** 2
        faster = sum(v * a for v, a in zip(ned_v_m_s, ned_a_m_s2, strict=True)) * _UNNOTICED_S
        root = faster * faster + gain2 * room2
        granted = (math.sqrt(root) - faster) / gain2 if root > 0.0 else 0.0
        share = min(share, max(granted, 0.0))
        return (share * ned_a_m_s2[0], share * ned_a_m_s2[1])


def slew(ned_v_m_s: Vec3, last_ned_v_m_s: Vec3, rate_m_s2: float, dt_s: float) -> Vec3:
    """Velocity that differs from the last by at most rate · dt, on the way to the asked one, NED, m/s."""
    delta = tuple(a - b for a, b in zip(ned_v_m_s, last_ned_v_m_s, strict=True))
    size = math.sqrt(sum(c * c for c in delta))
    allowed = rate_m_s2 * max(dt_s, 0.0)
    if size <= allowed:
        return ned_v_m_s
    x, y, z = (b + c * allowed / size for b, c in zip(last_ned_v_m_s, delta, strict=True))
    return (x, y, z)
