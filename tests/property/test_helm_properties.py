"""What arbiter, containment and the pilot promise for every input."""

from __future__ import annotations

import math

from hypothesis import example, given, settings
from hypothesis import strategies as st

from common.messages import Request
from onboard.helm.arbiter import Candidate, Verdict, arbitrate
from onboard.helm.config import ContainmentConfig, HelmConfig
from onboard.helm.containment import contain, slew
from onboard.helm.pilot import Pilot
from onboard.helm.setpoint import AccelerationSetpoint
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.map import NOTHING_KNOWN

NOW = 50_000_000_000
_ANY = st.floats(allow_nan=True, allow_infinity=True)
_SPEED = st.floats(-6.0, 6.0)
_VELOCITY = st.tuples(_SPEED, _SPEED, _SPEED)
BOUNDS = ContainmentConfig(radius_m=20.0, fence_band_m=5.0, height_max_m=10.0)


@st.composite
def _candidate(draw, source: str) -> Candidate:
    request = Request(
        frame=draw(st.sampled_from(["ned", "heading"])),
        vector=(draw(_ANY), draw(_ANY), draw(_ANY)),
        yaw_rate_rad_s=draw(_ANY),
        valid_ms=draw(st.floats(0.0, 10_000.0)),
    )
    basis_ns = NOW + draw(st.integers(-2_000_000_000, 500_000_000))
    return Candidate(source, request, basis_ns, basis_ns + draw(st.integers(0, 1_000_000_000)))


@given(st.one_of(st.none(), _candidate("operator")), st.one_of(st.none(), _candidate("pursuit")), _ANY)
@settings(max_examples=400)
def test_nothing_stale_and_nothing_that_is_no_number_passes(operator, pursuit, yaw):
    verdict = arbitrate([c for c in (operator, pursuit) if c is not None], NOW, yaw, 0.3)
    assert all(math.isfinite(c) for c in (*verdict.ned_v_m_s, verdict.yaw_rate_rad_s))
    chosen = {"operator": operator, "pursuit": pursuit, "helm": None}[verdict.source]
    if chosen is None:
        assert verdict.ned_v_m_s == (0.0, 0.0, 0.0)
        return
    assert -50.0 <= verdict.age_ms <= min(300.0, chosen.request.valid_ms)
    assert NOW - chosen.basis_ns <= 300_000_000
    assert math.hypot(*verdict.ned_v_m_s) <= math.hypot(*chosen.request.vector) * (1 + 1e-9)


@given(_VELOCITY, st.tuples(st.floats(-30, 30), st.floats(-30, 30), st.floats(-15, 1)))
@settings(max_examples=300)
def test_containment_only_takes_away(asked, position):
    north, east, down = contain(asked, position, BOUNDS)
    assert math.hypot(north, east) <= min(math.hypot(asked[0], asked[1]), BOUNDS.speed_m_s) + 1e-9
    assert abs(down) <= min(abs(asked[2]), BOUNDS.climb_m_s) + 1e-9
    radius = math.hypot(position[0], position[1])
    if radius >= BOUNDS.radius_m:
        assert north * position[0] + east * position[1] <= 1e-6
    if -position[2] >= BOUNDS.height_max_m:
        assert down >= 0.0


@given(_VELOCITY, _VELOCITY, st.floats(0.1, 10.0), st.floats(0.0, 0.2))
def test_the_slew_never_jumps_and_arrives(asked, last, rate, dt):
    out = slew(asked, last, rate, dt)
    assert math.dist(out, last) <= rate * dt + 1e-9
    assert math.dist(out, asked) <= math.dist(last, asked) + 1e-9


def _telemetry(p, v, yaw, t_ns) -> Telemetry:
    attitude = AttitudeSample(t_ns, (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)), (0.0, 0.0, 0.0))
    return Telemetry(found=True, attitude=attitude, position=PositionSample(t_ns, p, v), home_local_m=(0.0, 0.0, 0.0))


@given(st.lists(st.tuples(_VELOCITY, st.integers(1, 250)), min_size=1, max_size=6))
@settings(max_examples=40, deadline=None)
def test_a_vehicle_that_is_asked_for_accelerations_stays_inside(wishes):
    """Whatever tilt is asked, it stays within fence and height band, and no setpoint asks for more than braking."""
    pilot = Pilot(HelmConfig(containment=BOUNDS, takeoff_height_max_m=9.0), LimiterConfig())
    p, v, a, t_ns = [0.0, 0.0, -4.0], [0.0, 0.0, 0.0], [0.0, 0.0], 0
    pilot.reset(_telemetry((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), 0.0, t_ns), t_ns)
    for wish, cycles in wishes:
        for _ in range(cycles):
            t_ns += 50_000_000
            verdict = Verdict("pursuit", (0.0, 0.0, wish[2]), 0.0, 10.0, ned_a_m_s2=wish[:2])
            flown = pilot.fly(verdict, _telemetry(tuple(p), tuple(v), 0.0, t_ns), NOTHING_KNOWN, t_ns)
            assert flown is not None and isinstance(flown.local, AccelerationSetpoint)
            asked = (flown.local.north_m_s2, flown.local.east_m_s2)
            assert math.hypot(*asked) <= BOUNDS.braking_m_s2 + 1e-9
            for i in range(2):
                a[i] += (asked[i] - a[i]) * 0.05 / 0.2
                v[i] += a[i] * 0.05
            v[2] += (flown.local.local_z_m - p[2] - v[2]) * 0.05 / 0.4
            for i in range(3):
                p[i] += v[i] * 0.05
            assert math.hypot(*v[:2]) <= 1.3 * BOUNDS.speed_m_s
            assert math.hypot(p[0], p[1]) <= BOUNDS.radius_m + 0.5
            assert BOUNDS.height_min_m - 0.6 <= -p[2] <= BOUNDS.height_max_m + 0.6


@given(st.lists(st.tuples(_VELOCITY, st.integers(1, 250)), min_size=1, max_size=6), st.booleans())
@example(wishes=[((0.0, 3.0, 0.0), 141), ((3.0, 0.0, 1.0), 143)], obeyed=True)  # spiralled out along the fence
@settings(max_examples=40, deadline=None)
def test_a_simulated_vehicle_stays_inside(wishes, obeyed):
    """Whatever is asked, a vehicle with PX4's stopping distance stays within fence and height band."""
    config = HelmConfig(containment=BOUNDS, takeoff_height_max_m=9.0)
    pilot = Pilot(config, LimiterConfig())
    p, v, t_ns = [0.0, 0.0, -4.0], [0.0, 0.0, 0.0], 0
    pilot.reset(_telemetry((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), 0.0, t_ns), t_ns)
    for wish, cycles in wishes:
        for _ in range(cycles):
            t_ns += 50_000_000
            verdict = Verdict("pursuit" if obeyed else "helm", wish if obeyed else (0.0, 0.0, 0.0), 0.0, 10.0)
            flown = pilot.fly(verdict, _telemetry(tuple(p), tuple(v), 0.0, t_ns), NOTHING_KNOWN, t_ns)
            assert flown is not None
            local = flown.local
            assert math.hypot(local.north_m_s, local.east_m_s) <= BOUNDS.speed_m_s + 1e-9
            wanted = (local.north_m_s, local.east_m_s, local.local_z_m - p[2])
            for i in range(3):
                v[i] += (wanted[i] - v[i]) * 0.05 / 0.4
                p[i] += v[i] * 0.05
            assert math.hypot(p[0], p[1]) <= BOUNDS.radius_m + 0.5
            assert BOUNDS.height_min_m - 0.6 <= -p[2] <= BOUNDS.height_max_m + 0.6


_WIND = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))


@given(_WIND, _WIND, st.sampled_from([0.1, 0.3, 1.0]), st.floats(0.2, 0.3), st.tuples(_SPEED, _SPEED))
@settings(max_examples=25)
def test_no_wind_that_ends_or_turns_leads_beyond_the_largest_speed(before, after, drag, lean_s, wish):
    """A chase that holds a velocity by accelerations, on a vehicle of 1 kg with up to the drag of PX4's own quadrotor,
    N per m/s: past the largest speed by 3 % at most when the wind changes at once, whatever it was."""
    pilot, v, lean, total, t_ns = Pilot(HelmConfig(), LimiterConfig()), [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], NOW
    largest, fastest = HelmConfig().containment.speed_m_s, 0.0
    for k in range(200):
        t_ns += 40_000_000
        error = [w - x for w, x in zip(wish, v, strict=True)]
        total = [s + 0.8 * e * 0.04 for s, e in zip(total, error, strict=True)]
        asked = tuple(1.8 * e + s for e, s in zip(error, total, strict=True))
        verdict = Verdict("pursuit", (0.0, 0.0, 0.0), 0.0, 0.0, ned_a_m_s2=(asked[0], asked[1]))
        flown = pilot.fly(verdict, _telemetry((0.0, 0.0, -5.0), (*v, 0.0), 0.0, t_ns), NOTHING_KNOWN, t_ns)
        assert flown is not None and isinstance(flown.local, AccelerationSetpoint)
        for i, a in enumerate((flown.local.north_m_s2, flown.local.east_m_s2)):
            lean[i] += (a - lean[i]) * 0.04 / lean_s
            v[i] += (lean[i] - drag * (v[i] - (before if k < 120 else after)[i])) * 0.04
        fastest = max(fastest, math.hypot(*v)) if k >= 120 else 0.0
    assert fastest <= 1.03 * largest
