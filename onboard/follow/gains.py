"""Gains by pole placement on a model of how a platform answers a rate that is asked of it.

The AR.Drone's gains of the thesis (4.4.2) are per pixel and per unit of its own stick, and say nothing about another
vehicle. Here a platform is one lag: the asked velocity (or turn rate) c becomes the flown one v by τ v' = c - v. With
the target's own velocity w as feed-forward, the law is

    c = w + Kp e + Kd e',   e' = w - v

and the error of a target that keeps its velocity obeys τ e'' + (1 + Kd) e' + Kp e = 0: wanted poles give both gains.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PdGains:
    """Proportional and differential gain of a rate over an error."""

    kp_1_s: float
    """Rate per error, 1/s."""
    kd: float
    """Rate per rate of the error."""

    def rate(self, error: float, error_rate: float, feed_forward: float = 0.0) -> float:
        """Rate to ask for: w + Kp e + Kd e', in the error's unit a second."""
        return feed_forward + self.kp_1_s * error + self.kd * error_rate


@dataclass(frozen=True)
class PidGains:
    """The same with an integral, for a platform that does not know how its target moves."""

    kp_1_s: float
    """Rate per error, 1/s."""
    ki_1_s2: float
    """Rate per integrated error, 1/s²."""
    kd: float
    """Rate per rate of the error."""


def pd_gains(natural_rad_s: float, damping: float, lag_s: float) -> PdGains:
    """Gains that give the error the poles of s² + 2 ζ ω s + ω².

    Args:
        natural_rad_s: ω, rad/s. Beyond about a quarter of the platform's dead time's inverse the model no longer holds.
        damping: ζ.
        lag_s: τ, s.
    """
    return PdGains(lag_s * natural_rad_s**2, 2.0 * damping * natural_rad_s * lag_s - 1.0)


def pid_gains(natural_rad_s: float, damping: float, slow_1_s: float, lag_s: float) -> PidGains:
    """Gains that give the error the poles of (s + p) (s² + 2 ζ ω s + ω²).

    Without feed-forward the error obeys τ e''' + (1 + Kd) e'' + Kp e' + Ki e = τ w'' + w': none is left of a target
    that keeps its velocity.

    Args:
        natural_rad_s: ω, rad/s.
        damping: ζ.
        slow_1_s: p, 1/s, the pole of the integral.
        lag_s: τ, s.
    """
    both = 2.0 * damping * natural_rad_s
    return PidGains(
        lag_s * (natural_rad_s**2 + both * slow_1_s),
        lag_s * slow_1_s * natural_rad_s**2,
        lag_s * (slow_1_s + both) - 1.0,
    )
