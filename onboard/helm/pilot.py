"""From the arbiter's verdict to the setpoint: hover or obey, slew, contain, limit, hold height and heading.

The limiter comes last: there is no path around it, for the climb to the held height neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from common.geometry.rotation import wrap_angle
from common.messages import Setpoint, Vec3
from onboard.helm.arbiter import Verdict
from onboard.helm.config import HelmConfig
from onboard.helm.containment import Resistance, contain, slew
from onboard.helm.setpoint import AccelerationSetpoint, LocalSetpoint, hover_velocity
from onboard.helm.telemetry import Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.limiter import Limited, limit
from onboard.limiter.surroundings import Surroundings

_STEP_MAX_S = 0.1
_HORIZON_MIN_S = 0.2
_STILL_M_S = 0.4
_BRAKE_MAX_S = 4.0
_HEIGHT_LEAD_M = 1.0
_HOLD_BAND_M = 0.3
_STANDSTILL: Vec3 = (0.0, 0.0, 0.0)
_HEADING_LEAD_RAD = 0.5
_ASIDE_SHARE = 0.2  # of the speed home while the nose still points elsewhere: it goes on even where it cannot turn


@dataclass(frozen=True)
class Flown:
    """One setpoint, for the autopilot and for the bus."""

    local: LocalSetpoint
    """What goes to the autopilot."""
    message: Setpoint
    """What goes to the bus."""
    limited: Limited
    """What the limiter did."""


class Pilot:
    """Holds height, heading and the hover anchor between setpoints.

    Args:
        config: helm's settings.
        limiter: the limiter's.
    """

    def __init__(self, config: HelmConfig, limiter: LimiterConfig):
        self._config = config
        self._configured = limiter
        self.limiter = limiter
        """The limiter's settings as they are flown: without push-back where the operator says so."""
        self._horizon_s = max(limiter.stop_delay_s, _HORIZON_MIN_S)
        self._height_m = self._sent_height_m = math.nan
        self._yaw_rad = math.nan
        self._anchor_m: tuple[float, float] | None = None
        self._hover_since_ns: int | None = None
        self._last_v = _STANDSTILL
        self._last_ns = 0
        self._braking = _STANDSTILL
        self._resistance = Resistance()
        self._asked_m_s2: tuple[float, float] | None = None

    def reset(self, telemetry: Telemetry, t_ns: int, height_m: float | None = None) -> None:
        """Start from where the vehicle is: its height (or the one given, m above home), heading and velocity."""
        position, attitude = telemetry.position, telemetry.attitude
        self._height_m = telemetry.height_m if height_m is None else height_m
        self._yaw_rad = attitude.yaw_rad if attitude else math.nan
        north, east, _ = position.ned_v_m_s if position else (0.0, 0.0, 0.0)
        self._last_v = (north, east, 0.0)
        self._braking = _STANDSTILL
        self._anchor_m, self._hover_since_ns = None, None
        self._last_ns = t_ns

    def push_back(self, on: bool) -> None:
        """Let the limiter back away as fast as configured, or not at all."""
        speed_m_s = self._configured.push_back_m_s if on else 0.0
        self.limiter = msgspec.structs.replace(self._configured, push_back_m_s=speed_m_s)

    def fly(self, verdict: Verdict, telemetry: Telemetry, around: Surroundings | None, t_ns: int) -> Flown | None:
        """The setpoint for this control cycle; None without an estimate of position and heading.

        Args:
            verdict: who is obeyed, and what is asked.
            telemetry: the autopilot.
            around: obstacles and sight now; None where the vehicle must stand still.
            t_ns: now.
        """
        ned_p_m, position, attitude = telemetry.ned_p_m(), telemetry.position, telemetry.attitude
        if ned_p_m is None or position is None or attitude is None:
            return None
        if not math.isfinite(self._height_m + self._yaw_rad):
            self.reset(telemetry, t_ns)
        dt_s = min(max((t_ns - self._last_ns) / 1e9, 0.0), _STEP_MAX_S)
        self._last_ns = t_ns
        bounds, held = self._config.containment, (0.0, 0.0)
        if verdict.ned_a_m_s2 is None:
            self._asked_m_s2 = None
            intended, rate = self._wanted(verdict, ned_p_m, position.ned_v_m_s, t_ns)
            intended = contain(intended, ned_p_m, bounds)
            wanted = slew(intended, self._last_v, rate, dt_s)
        else:
            intended = wanted = self._led_to(verdict.ned_a_m_s2, verdict.ned_v_m_s[2], position.ned_v_m_s)
            held = self._held_back((wanted[0], wanted[1]), position.ned_v_m_s, dt_s)
        north, east, down = contain((wanted[0] - held[0], wanted[1] - held[1], wanted[2]), ned_p_m, bounds)
        limited = self._limit((north + held[0], east + held[1], down), intended, telemetry, around, dt_s)
        # Only what was asked of the climb goes on from here: the way to the held height, or over what is in the way, is
        # no request to climb. Taken for one it would move the held height, and the vehicle would rise for ever.
        north, east, down = self._last_v
        self._last_v = (north, east, min(max(down, min(wanted[2], 0.0)), max(wanted[2], 0.0)))
        yaw_rate = self._turn(verdict.yaw_rate_rad_s, attitude.yaw_rad, dt_s)
        home_z = telemetry.home_local_m[2] if telemetry.home_local_m else 0.0
        north, east, down = limited.ned_v_m_s
        local = LocalSetpoint(north, east, home_z - self._sent_height_m, down, yaw_rate)
        acceleration = None
        if verdict.ned_a_m_s2 is not None:
            acceleration = self._asked_m_s2 = self._acceleration_to(limited.ned_v_m_s, position.ned_v_m_s)
            north, east, _ = contain((north, east, 0.0), ned_p_m, bounds)
            local = AccelerationSetpoint(north, east, home_z - self._sent_height_m, down, yaw_rate, *acceleration)
        message = Setpoint(
            source=verdict.source,
            asked_ned_v_m_s=verdict.ned_v_m_s if verdict.ned_a_m_s2 is None else wanted,
            ned_v_m_s=(north, east, down),
            height_m=self._sent_height_m,
            yaw_rad=self._yaw_rad,
            ned_a_m_s2=acceleration,
        )
        return Flown(local, message, limited)

    def _wanted(self, verdict: Verdict, ned_p_m: Vec3, ned_vehicle_v_m_s: Vec3, t_ns: int) -> tuple[Vec3, float]:
        """The asked velocity, or the hover's, NED, m/s, and how fast the setpoint may change towards it, m/s²."""
        bounds = self._config.containment
        if verdict.ned_v_m_s[:2] == (0.0, 0.0):
            return self._hover(verdict.ned_v_m_s[2], ned_p_m, ned_vehicle_v_m_s, t_ns), bounds.braking_m_s2
        self._anchor_m, self._hover_since_ns = None, None
        return verdict.ned_v_m_s, bounds.acceleration_m_s2

    def _led_to(self, ned_a_m_s2: tuple[float, float], down_m_s: float, ned_vehicle_v_m_s: Vec3) -> Vec3:
        """Velocity that an acceleration, cut to its maximum, leads to within the braking horizon; NED, m/s.

        This is what the limiter judges, whatever wind and drag take of it: the vehicle can still be stopped from it.
        """
        self._anchor_m, self._hover_since_ns = None, None
        size, most = math.hypot(*ned_a_m_s2), self._config.containment.tilt_m_s2
        share = min(1.0, most / size) * self._horizon_s if size > 0.0 else 0.0
        north, east, _ = ned_vehicle_v_m_s
        return (north + share * ned_a_m_s2[0], east + share * ned_a_m_s2[1], down_m_s)

    def _held_back(self, led_to_m_s: tuple[float, float], ned_vehicle_v_m_s: Vec3, dt_s: float) -> tuple[float, float]:
        """What drag and wind take, within the horizon, of a velocity that an acceleration would lead to, m/s.

        Containment judges the rest: an acceleration that only holds the speed against the wind does not lead beyond it.
        """
        if self._asked_m_s2 is None:
            self._resistance.reset()
        self._resistance.learn(ned_vehicle_v_m_s, self._asked_m_s2 or (0.0, 0.0), dt_s)
        v = (ned_vehicle_v_m_s[0], ned_vehicle_v_m_s[1])
        change = [(a - b) / self._horizon_s for a, b in zip(led_to_m_s, v, strict=True)]
        largest_m_s = self._config.containment.speed_m_s
        north, east = self._resistance.against((change[0], change[1]), v, largest_m_s)
        return (north * self._horizon_s, east * self._horizon_s)

    def _acceleration_to(self, ned_v_m_s: Vec3, ned_vehicle_v_m_s: Vec3) -> tuple[float, float]:
        """Acceleration, north and east, m/s², that reaches a velocity within the horizon: braking may be harder."""
        change = [(a - b) / self._horizon_s for a, b in zip(ned_v_m_s[:2], ned_vehicle_v_m_s[:2], strict=True)]
        size, most = math.hypot(*change), self._config.containment.braking_m_s2
        share = min(1.0, most / size) if size > 0.0 else 0.0
        # The next velocity request, or hover, begins from the vehicle's own velocity.
        self._last_v = (ned_vehicle_v_m_s[0], ned_vehicle_v_m_s[1], self._last_v[2])
        return (change[0] * share, change[1] * share)

    def _hover(self, down_m_s: float, ned_p_m: Vec3, ned_v_m_s: Vec3, t_ns: int) -> Vec3:
        """Brake first; where the vehicle has come to rest is the anchor. (An anchor taken at speed would be overshot
        by the 1.2 to 2.3 m that a stop takes, and flown back to.)"""
        if self._hover_since_ns is None:
            self._hover_since_ns = t_ns
        if self._anchor_m is None:
            still = math.hypot(ned_v_m_s[0], ned_v_m_s[1]) < _STILL_M_S
            if not still and (t_ns - self._hover_since_ns) / 1e9 < _BRAKE_MAX_S:
                return (0.0, 0.0, down_m_s)
            self._anchor_m = (ned_p_m[0], ned_p_m[1])
        north, east, _ = hover_velocity(
            self._anchor_m, ned_p_m, self._config.hover_gain_1_s, self._config.hover_speed_m_s
        )
        return (north, east, down_m_s)

    def _limit(
        self, ned_v_m_s: Vec3, intended: Vec3, telemetry: Telemetry, around: Surroundings | None, dt_s: float
    ) -> Limited:
        """The limiter over the whole motion that the setpoint will cause, climbing to the held height included.

        The vertical request moves the held height, which leads the vehicle by 1 m at most; the vehicle climbs
        towards it at gain · lead, by the autopilot's own loop or by the velocity that helm sends. That climb is what
        the limiter sees; what it changes is changed in the height that is sent, not in the one that is held.
        """
        bounds, gain_1_s, height_m = self._config.containment, telemetry.dialect.height_gain_1_s, telemetry.height_m
        low, high = min(bounds.height_min_m, self._height_m), max(bounds.height_max_m, self._height_m)
        held_m = min(max(self._height_m - ned_v_m_s[2] * dt_s, low), high)
        lead_m = min(max(held_m - height_m, -_HEIGHT_LEAD_M), _HEIGHT_LEAD_M)
        down_m_s = -gain_1_s * lead_m
        limited = limit(
            (ned_v_m_s[0], ned_v_m_s[1], down_m_s),
            around,
            self.limiter,
            ned_vehicle_v_m_s=telemetry.position.ned_v_m_s if telemetry.position else (0.0, 0.0, 0.0),
            ned_intended_v_m_s=(intended[0], intended[1], down_m_s),
            ned_p_m=telemetry.ned_p_m(),
            braking_ned_v_m_s=self._braking,
            dt_s=dt_s,
        )
        self._braking = limited.braking_ned_v_m_s
        north, east, limited_down = limited.ned_v_m_s
        cut = limited_down != down_m_s
        if cut and limited.why in ("blind", "no data") and limited.ned_v_m_s == _STANDSTILL:
            # Standing still, for want of sight alone, includes the height: the present one, sent, would be lost to any
            # drift. The one held before is sent, as far as it is near and no other way than what was just judged.
            most_m = min(max(lead_m, -_HOLD_BAND_M), _HOLD_BAND_M)
            lead_m = min(max(self._height_m - height_m, min(most_m, 0.0)), max(most_m, 0.0))
            cut = False
        self._height_m = height_m + lead_m
        self._sent_height_m = height_m + (-limited_down / gain_1_s if cut else lead_m)
        self._last_v = (north, east, limited_down if cut else ned_v_m_s[2])
        return limited

    def _turn(self, yaw_rate_rad_s: float, yaw_rad: float, dt_s: float) -> float:
        """Integrate the heading rate into the held heading; returns the rate that keeps it, rad/s."""
        largest = self._config.containment.yaw_rate_rad_s
        asked = min(max(yaw_rate_rad_s, -largest), largest)
        ahead = wrap_angle(self._yaw_rad + asked * dt_s - yaw_rad)
        ahead = min(max(ahead, -_HEADING_LEAD_RAD), _HEADING_LEAD_RAD)
        self._yaw_rad = wrap_angle(yaw_rad + ahead)
        return min(max(asked + self._config.yaw_gain_1_s * ahead, -largest), largest)


def homing(ned_p_m: Vec3, ned_v_m_s: Vec3, yaw_rad: float, config: HelmConfig) -> tuple[Verdict, bool]:
    """Velocity on the way home, and whether home is reached (within 0.7 m, slower than 0.5 m/s).

    Climbs to the return height first, then flies home level; it never descends on the way. The nose is turned home, and
    the vehicle flies no faster than it faces the way: a camera that looks ahead sees where it goes.

    Args:
        ned_p_m: position from home, NED, m.
        ned_v_m_s: velocity, NED, m/s.
        yaw_rad: heading, rad; not finite when it is not known: no turn then.
        config: speeds and heights.
    """
    distance = math.hypot(ned_p_m[0], ned_p_m[1])
    if distance < 0.7 and math.hypot(ned_v_m_s[0], ned_v_m_s[1]) < 0.5:
        return Verdict("helm", (0.0, 0.0, 0.0), 0.0, -1.0), True
    short_m = config.return_height_m + ned_p_m[2]
    down = -min(max(short_m, 0.0), config.containment.climb_m_s)
    far = distance > 3.0
    off_rad = wrap_angle(math.atan2(-ned_p_m[1], -ned_p_m[0]) - yaw_rad) if far and math.isfinite(yaw_rad) else 0.0
    turn = config.yaw_gain_1_s * off_rad
    if short_m > 1.0 and far:
        return Verdict("helm", (0.0, 0.0, down), turn, -1.0), False
    speed = min(config.return_speed_m_s, 0.6 * distance) * max(math.cos(off_rad), _ASIDE_SHARE)
    scale = speed / distance if distance > 0.0 else 0.0
    return Verdict("helm", (-ned_p_m[0] * scale, -ned_p_m[1] * scale, down), turn, -1.0), False
