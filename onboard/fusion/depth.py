"""Distance of a target from a time-of-flight camera and from its size in the picture (Echeverri 2016, 3.3 and 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from onboard.fusion.config import DepthConfig
from onboard.fusion.motion import MotionFilter
from onboard.fusion.weights import combine, outlier_weight

_NOT_MEASURED = 1e9
"""Variance of a depth that nothing measured, m²."""
_MOST_CORRECTED = 1.5
"""How many times as large as at first K_z may be said to be: somebody drives up to the target by it."""


@dataclass(frozen=True)
class DepthEstimate:
    """Where the target is."""

    position: np.ndarray
    """u, v (px) and distance z (m), (3,)."""
    rate: np.ndarray
    """Their rates, px/s and m/s, (3,)."""
    covariance: np.ndarray
    """Covariance of position and rate, (6, 6)."""
    reliability: float
    """R_ζ of eq. 3.12: 0 the time-of-flight distance counts, 1 the one from the size."""
    tof_m: float
    """Time-of-flight distance, m; NaN without a pixel that has one."""
    scale_m: float
    """Distance from the size, m; NaN until K_z is known."""


def tof_distance(depth_m: np.ndarray) -> tuple[float, float]:
    """Mean of the pixels that have a depth, m, and the share r₀ of those that have none (section 3.4).

    Args:
        depth_m: depth inside the target's box, (h, w), m; 0 where the camera could not tell.

    Returns:
        Distance (NaN without a valid pixel) and r₀ in 0 to 1.

    Raises:
        ValueError: no pixel, not two dimensions, or a depth that is negative or not finite.
    """
    if depth_m.ndim != 2 or depth_m.size == 0 or not np.isfinite(depth_m).all() or (depth_m < 0).any():
        raise ValueError(f"depth: got an array {depth_m.shape}, expected (h, w) of finite depths in m, 0 for none")
    valid = depth_m[depth_m > 0]
    return (float(valid.mean()) if len(valid) else math.nan), 1.0 - len(valid) / depth_m.size


def unreliability(empty_share: float, eta: float, zeta: float) -> float:
    """R_ζ of eq. 3.12 for a share r₀ of pixels without depth: from 0 (trust it) to 1; the sigmoid of eq. 4.4."""
    return outlier_weight(empty_share, eta, zeta)


def size_ratio(size_px: tuple[float, float], image_px: tuple[float, float]) -> float:
    """Root of the picture's area over the target's (eq. 3.11), which is proportional to its distance."""
    return math.sqrt(image_px[0] * image_px[1] / (size_px[0] * size_px[1]))


class DepthFusion:
    """Six-state filter of u, v, z and their rates (eqs 3.1 to 3.10) over both distances.

    Args:
        config: parameters.
        image_px: width and height of the picture, px.
    """

    def __init__(self, config: DepthConfig, image_px: tuple[float, float]):
        self._config = config
        self._image_px = image_px
        self._filter: MotionFilter | None = None
        self._taught = 0
        self._first_scale_m = math.inf
        self.scale_m: float | None = None
        """K_z of eq. 3.11, m; None until the first valid time-of-flight distance."""

    def update(
        self,
        t_ns: int,
        center_px: tuple[float, float],
        size_px: tuple[float, float],
        depth_m: np.ndarray | None,
        control: np.ndarray | None = None,
    ) -> DepthEstimate | None:
        """Estimate from one picture; None as long as no distance was ever measured.

        Args:
            t_ns: capture stamp, ns, not before the last.
            center_px: the target's centre u, v, px.
            size_px: its width and height, px.
            depth_m: depth inside its box, (h, w), m, 0 for none; None without a depth picture.
            control: known acceleration of u, v (px/s²) and z (m/s²) by the platform's commands, (3,): B·u.

        Raises:
            ValueError: a place or size that is not finite or not positive, a bad depth, or a stamp that goes back.
        """
        if not all(map(math.isfinite, (*center_px, *size_px))) or min(size_px) <= 0:
            raise ValueError(f"target: got centre {center_px}, size {size_px} px, expected finite, and a size above 0")
        if self._filter is not None and t_ns < self._filter.t_ns:
            raise ValueError(f"t_ns: got {t_ns}, expected at least the last stamp, {self._filter.t_ns}")
        tof_m, empty = (math.nan, 1.0) if depth_m is None else tof_distance(depth_m)
        doubt = unreliability(empty, self._config.eta, self._config.zeta)
        ratio = size_ratio(size_px, self._image_px)
        self._teach(tof_m, doubt, ratio)
        scale_m = math.nan if self.scale_m is None else self.scale_m * ratio
        distance = self._distance(tof_m, scale_m, doubt)
        if distance is None and self._filter is None:
            return None
        self._take_in(t_ns, center_px, distance, control)
        if self._filter is None:
            return None
        state, covariance = self._filter.state.copy(), self._filter.covariance.copy()
        return DepthEstimate(state[:3], state[3:], covariance, doubt, tof_m, scale_m)

    def correct(self, size_px: tuple[float, float], distance_m: float) -> None:
        """The target, of this width and height, px, is farther, m, than its size says: it is seen too large.

        K_z grows to no more than 1.5 times what was learned at first.

        Raises:
            ValueError: a size or a distance that is not finite or not positive.
        """
        if not all(math.isfinite(v) and v > 0.0 for v in (*size_px, distance_m)):
            raise ValueError(f"target: got size {size_px} px, {distance_m} m, expected finite, and above 0")
        if self.scale_m is not None:
            farther_m = distance_m / size_ratio(size_px, self._image_px)
            self.scale_m = max(self.scale_m, min(farther_m, _MOST_CORRECTED * self._first_scale_m))

    def _teach(self, tof_m: float, doubt: float, ratio: float) -> None:
        """Learn K_z at the first reliable distance, and refine it by a mean that forgets slowly."""
        if doubt > self._config.reliable or not math.isfinite(tof_m):
            return
        self._taught += 1
        seen_m = tof_m / ratio
        gain = max(self._config.least_gain, 1.0 / self._taught)
        if self.scale_m is None:
            self.scale_m = self._first_scale_m = seen_m
        self.scale_m += gain * (seen_m - self.scale_m)

    def _distance(self, tof_m: float, scale_m: float, doubt: float) -> tuple[float, float] | None:
        """Both distances as one, m, and its variance, m² (eqs 3.13 to 3.15 with their floors)."""
        config = self._config
        known = []
        if math.isfinite(tof_m):
            known.append((tof_m, config.tof_noise_m**2 + config.kappa * doubt))
        if math.isfinite(scale_m):
            known.append((scale_m, (config.scale_noise * scale_m) ** 2 + config.kappa * (1.0 - doubt)))
        if not known:
            return None
        values, variances = np.array(known).T
        value, variance = combine(values[:, None], variances[:, None], 0.0)
        return float(value[0]), float(variance[0])

    def _take_in(
        self,
        t_ns: int,
        center_px: tuple[float, float],
        distance: tuple[float, float] | None,
        control: np.ndarray | None,
    ) -> None:
        config = self._config
        density = np.array([config.acceleration_px_s, config.acceleration_px_s, config.acceleration_m_s]) ** 2
        z_m, variance = (0.0, _NOT_MEASURED) if distance is None else distance
        value, variances = np.array([*center_px, z_m]), np.array([config.pixel_noise_px**2] * 2 + [variance])
        if self._filter is None:
            start_rate = np.array([config.acceleration_px_s, config.acceleration_px_s, config.acceleration_m_s])
            self._filter = MotionFilter(value, t_ns, np.sqrt(variances), start_rate)
            return
        self._filter.predict(t_ns, density, control)
        self._filter.update(value, variances)
