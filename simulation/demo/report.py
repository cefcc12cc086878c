"""What a chase is judged by: errors against the truth, losses, latencies."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from common.header import Received
from common.messages import HelmStatus, Setpoint, Track
from common.truth import Truth

REQUEST = "helm/request/pursuit"


@dataclass(frozen=True)
class Criteria:
    """When a chase counts as held."""

    rms_error_m: float = 1.0
    """Largest RMS of the horizontal distance between vehicle and car, m."""
    longest_loss_s: float = 5.0
    """Longest time without the target, s."""
    lost_fraction: float = 0.15
    """Largest share of the time without the target."""
    least_height_m: float = 1.5
    """Lowest height during the chase, m."""
    late_fraction: float = 0.02
    """Above this share of late frames the machine is too slow to judge the flight at all."""


@dataclass
class ChaseRecorder:
    """Collects what a chase's messages tell; call the methods from reader threads, `summary` at the end."""

    errors_m: list[float] = field(default_factory=list)
    heights_m: list[float] = field(default_factory=list)
    latencies_ms: list[float] = field(default_factory=list)
    states: list[tuple[int, str]] = field(default_factory=list)
    helm_states: list[str] = field(default_factory=list)
    selections: int = 0
    """How often the target was chosen by hand."""
    active: bool = False
    """Whether the chase is on: nothing is collected otherwise."""

    def on_truth(self, received: Received[Truth]) -> None:
        """Distance and height of one instant."""
        if self.active:
            truth = received.message
            self.errors_m.append(math.dist(truth.ned_p_m[:2], truth.target_ned_p_m[:2]))
            self.heights_m.append(-truth.ned_p_m[2])

    def on_track(self, received: Received[Track]) -> None:
        """State of the tracker on one picture."""
        if self.active:
            self.states.append((received.header.capture_ns, received.message.state))

    def on_setpoint(self, received: Received[Setpoint]) -> None:
        """Latency from capture to setpoint, for a setpoint that a new request caused."""
        if self.active and received.message.source == "pursuit":
            for reference in received.header.inputs:
                if reference.topic == REQUEST:
                    self.latencies_ms.append((received.header.sent_ns - reference.capture_ns) / 1e6)

    def on_status(self, received: Received[HelmStatus]) -> None:
        """State of helm."""
        if self.active:
            self.helm_states.append(received.message.state)

    def current_loss_s(self) -> float:
        """How long the target has been lost now, s; 0 while it is tracked."""
        start = None
        for stamp, state in reversed(self.states):
            if state == "tracking":
                break
            start = stamp
        return 0.0 if start is None else (self.states[-1][0] - start) / 1e9

    def summary(self) -> dict[str, float]:
        """Flat figures, units in their names; NaN where nothing was collected."""
        losses = self._losses_s()
        span_s = (self.states[-1][0] - self.states[0][0]) / 1e9 if len(self.states) > 1 else math.nan
        errors = np.array(self.errors_m or [math.nan])
        latencies = np.array(self.latencies_ms or [math.nan])
        return {
            "chase_s": span_s,
            "frames": float(len(self.states)),
            "chase_rms_error_m": float(np.sqrt(np.mean(errors**2))),
            "chase_p95_error_m": float(np.percentile(errors, 95)),
            "chase_max_error_m": float(errors.max()),
            "height_min_m": min(self.heights_m, default=math.nan),
            "losses": float(len(losses)),
            "lost_s": sum(losses),
            "longest_loss_s": max(losses, default=0.0),
            "selections": float(self.selections),
            "latency_p50_ms": float(np.percentile(latencies, 50)),
            "latency_p99_ms": float(np.percentile(latencies, 99)),
        }

    def _losses_s(self) -> list[float]:
        losses: list[float] = []
        start: int | None = None
        for stamp, state in self.states:
            if state == "tracking":
                if start is not None:
                    losses.append((stamp - start) / 1e9)
                start = None
            elif start is None:
                start = stamp
        if start is not None:
            losses.append((self.states[-1][0] - start) / 1e9)
        return losses

    def faults(self, criteria: Criteria) -> list[str]:
        """Why the chase did not hold; empty when it did."""
        s = self.summary()
        faults = []
        if not s["frames"]:
            return ["the tracker sent nothing"]
        if not s["chase_rms_error_m"] <= criteria.rms_error_m:
            faults.append(f"chase_rms_error_m {s['chase_rms_error_m']:.2f}, expected {criteria.rms_error_m} or less")
        if s["longest_loss_s"] > criteria.longest_loss_s:
            faults.append(f"longest_loss_s {s['longest_loss_s']:.1f}, expected {criteria.longest_loss_s} or less")
        if s["lost_s"] > criteria.lost_fraction * s["chase_s"]:
            faults.append(
                f"lost {s['lost_s']:.1f} of {s['chase_s']:.1f} s, expected {criteria.lost_fraction:.0%} or less"
            )
        if not s["height_min_m"] >= criteria.least_height_m:
            faults.append(f"height_min_m {s['height_min_m']:.2f}, expected {criteria.least_height_m} or more")
        if s["selections"] > 1:
            faults.append(f"the target had to be chosen {s['selections']:.0f} times, expected once")
        strays = sorted(set(self.helm_states) - {"pursuit"})
        if strays:
            faults.append(f"helm left the state 'pursuit' for {', '.join(strays)}")
        return faults
