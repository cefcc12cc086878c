"""The height from the target's size in the picture: an outer loop around the height that helm holds.

Teulière 2011 (section III) leaves the height to the vehicle's own sensors. The tracker's fourth state, 1/sqrt(A),
measures it as well, and over the target: on a slope, or where the barometer drifts, that is the height which counts.
"""

from __future__ import annotations

import math

import numpy as np

from common.geometry.camera import Camera
from common.tracking.base import TrackResult
from ground.pursuit.config import PursuitConfig


def height_over_size(camera: Camera, tangents: np.ndarray, result: TrackResult) -> float:
    """Height over the target in units of its size, the square root of its area as seen from above.

    A flat patch of area A at a height h, seen along the optical ray (x, y, 1) whose part straight down is d, lies at
    the depth h / d; its area in the picture is A f^2 d / depth^2 = A f^2 d^3 / h^2, so that

        h / sqrt(A) = f d^(3/2) / sqrt(A_px)

    and neither tilt nor a target beside the middle passes for a height.

    Args:
        camera: calibration; its distortion is small over a target.
        tangents: (2,), the target's ray in the level frame (`ground.pursuit.view.View`).
        result: the tracker's answer.
    """
    ray = camera.rays([result.center_px])[0]
    down = float(np.linalg.norm(ray)) / math.sqrt(1.0 + float(tangents @ tangents))
    focal_px = math.sqrt(camera.fx_px * camera.fy_px)
    return focal_px * down**1.5 / math.sqrt(result.size_px[0] * result.size_px[1])


def is_cut(camera: Camera, result: TrackResult) -> bool:
    """Whether the target's rectangle reaches out of the picture: then the tracker's size is a guess."""
    x, y = result.corners_px().T
    return bool(x.min() < 0 or y.min() < 0 or x.max() > camera.width - 1 or y.max() > camera.height - 1)


class AltitudeLaw:
    """P law from the target's size to an upward velocity (`pursuit.altitude = "scale"`).

    The wanted size is that of `altitude_m` over a target of `target_size_m`, where both are known, and else the one at
    the start, averaged over `altitude_memory_s`.

    Args:
        config: the pursuit's settings.
    """

    def __init__(self, config: PursuitConfig):
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Another target: forget its size."""
        c = self._config
        self._wanted = c.altitude_m / c.target_size_m if c.altitude_m > 0.0 and c.target_size_m > 0.0 else None
        self.freeze()

    def freeze(self) -> float:
        """Upward velocity without a size to go by: none, m/s. What was seen before then counts no more."""
        self._log_seen = 0.0
        self._seen_s = 0.0
        self._last_ns: int | None = None
        return 0.0

    def climb(self, height_over_size: float, height_m: float, t_ns: int) -> float:
        """Upward velocity, m/s.

        Args:
            height_over_size: what the picture says, see the function of that name.
            height_m: height over the target as the vehicle has it, m: a gain, not the measurement.
            t_ns: the picture's capture time, ns.
        """
        c = self._config
        dt_s = 0.0 if self._last_ns is None else (t_ns - self._last_ns) / 1e9
        # The mean of all at first, then one that forgets: a single picture's size is off by some per cent.
        share = 1.0 if dt_s == 0.0 else min(1.0, dt_s / min(self._seen_s + 2.0 * dt_s, c.altitude_memory_s))
        self._log_seen += share * (math.log(height_over_size) - self._log_seen)
        self._seen_s, self._last_ns = self._seen_s + dt_s, t_ns
        if self._wanted is None:
            if self._seen_s < c.altitude_memory_s:
                return 0.0
            self._wanted = math.exp(self._log_seen)
        relative = self._wanted / math.exp(self._log_seen) - 1.0
        return float(np.clip(c.altitude_gain_1_s * height_m * relative, -c.sink_m_s, c.climb_m_s))
