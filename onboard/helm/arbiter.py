"""Whose request is obeyed: operator over task, and only one that is fresh, finite and in its frame; else hover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from common.messages import Request, Vec3

_ABSURD = 1e3  # m/s, m/s² and rad/s: no vehicle moves so; beyond about 1e154 a square overflows
_FUTURE_TOLERANCE_S = 0.05


@dataclass(frozen=True)
class Candidate:
    """A request with what is known of its age, all on helm's own clock."""

    source: str
    """`operator`, `pursuit`, `follow`, `approach` or `search`."""
    request: Request
    """What is asked."""
    basis_ns: int
    """Newest vehicle stamp that it was computed from, as echoed in its header, ns."""
    received_ns: int
    """When helm received it, ns."""


@dataclass(frozen=True)
class Verdict:
    """What the arbiter decided."""

    source: str
    """Who is obeyed; `helm` when nobody is (hover)."""
    ned_v_m_s: Vec3
    """Asked velocity, NED, m/s; zero for hover; horizontally zero beside an acceleration."""
    yaw_rate_rad_s: float
    """Asked heading rate, rad/s."""
    age_ms: float
    """Age of the obeyed request by its basis, ms; -1 when none is obeyed."""
    refused: tuple[tuple[str, str], ...] = ()
    """(source, reason) of each request that was not obeyed."""
    basis_ns: int = 0
    """Basis of the obeyed request, ns; 0 when none is obeyed."""
    ned_a_m_s2: tuple[float, float] | None = None
    """Asked horizontal acceleration, north and east, m/s²; None where a velocity is asked."""


HOVER = Verdict("helm", (0.0, 0.0, 0.0), 0.0, -1.0)


def arbitrate(candidates: Sequence[Candidate], t_ns: int, yaw_rad: float, freshness_s: float) -> Verdict:
    """The first candidate, in the order given (operator before task), that may be obeyed.

    Args:
        candidates: newest request of each source that may command now, highest rank first.
        t_ns: helm's clock, ns.
        yaw_rad: heading of the vehicle, rad, for requests in the `heading` frame.
        freshness_s: greatest age of a request's basis, s; its own `valid_ms` applies as well.
    """
    refused: list[tuple[str, str]] = []
    for candidate in candidates:
        reason = fault(candidate, t_ns, freshness_s)
        if reason is None and candidate.request.frame == "heading" and not math.isfinite(yaw_rad):
            reason = "no heading"
        if reason is not None:
            refused.append((candidate.source, reason))
            continue
        x, y, z = to_ned(candidate.request, yaw_rad)
        accelerates = candidate.request.kind == "acceleration"
        return Verdict(
            candidate.source,
            (0.0, 0.0, z) if accelerates else (x, y, z),
            candidate.request.yaw_rate_rad_s,
            (t_ns - candidate.basis_ns) / 1e6,
            tuple(refused),
            candidate.basis_ns,
            (x, y) if accelerates else None,
        )
    return Verdict("helm", (0.0, 0.0, 0.0), 0.0, -1.0, tuple(refused))


def fault(candidate: Candidate, t_ns: int, freshness_s: float) -> str | None:
    """Why a request may not be obeyed at t, or None: `not finite`, `absurd`, `from the future`, `stale`, `expired`."""
    request = candidate.request
    if not all(math.isfinite(c) for c in (*request.vector, request.yaw_rate_rad_s, request.valid_ms)):
        return "not finite"
    if max(map(abs, (*request.vector, request.yaw_rate_rad_s))) > _ABSURD:
        return "absurd"
    age_s = (t_ns - candidate.basis_ns) / 1e9
    if age_s < -_FUTURE_TOLERANCE_S:
        return "from the future"
    if age_s > freshness_s or (t_ns - candidate.received_ns) / 1e9 > freshness_s:
        return "stale"
    return "expired" if age_s * 1e3 > request.valid_ms else None


def to_ned(request: Request, yaw_rad: float) -> Vec3:
    """The request's vector in NED: `heading` has x along the vehicle's heading and y to its right."""
    x, y, z = request.vector
    if request.frame == "ned":
        return (x, y, z)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return (c * x - s * y, s * x + c * y, z)
