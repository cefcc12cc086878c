"""What keypoints say together of size, rotation and centre (Nebehay and Pflugfelder 2014, sections 3.3 and 3.4)."""

from __future__ import annotations

import math

import numpy as np

_MOST = 120
"""Points of which all pairs are looked at: 7,140 pairs."""


def similarity_of(model: np.ndarray, seen: np.ndarray) -> tuple[float, float] | None:
    """Scale and rotation (rad) that take points (n, 2) of the model to those seen (n, 2): medians over all pairs.

    None with fewer than two points.
    """
    if len(model) > _MOST:
        chosen = np.linspace(0, len(model) - 1, _MOST).astype(int)
        model, seen = model[chosen], seen[chosen]
    one, other = np.triu_indices(len(model), 1)
    first, now = model[one] - model[other], seen[one] - seen[other]
    before, after = np.hypot(*first.T), np.hypot(*now.T)
    apart = before > 1e-6
    if not apart.any():
        return None
    scale = float(np.median(after[apart] / before[apart]))
    turned = np.arctan2(now[:, 1], now[:, 0]) - np.arctan2(first[:, 1], first[:, 0])
    turned = turned[apart]
    # Median about the mean direction: differences of angles have no order on the circle.
    mean = math.atan2(float(np.sin(turned).sum()), float(np.cos(turned).sum()))
    offset = float(np.median(np.angle(np.exp(1j * (turned - mean)))))
    return scale, math.remainder(mean + offset, 2 * math.pi)


def rotated(points: np.ndarray, scale: float, angle_rad: float) -> np.ndarray:
    """Points (n, 2) scaled and turned about the origin, from the x axis towards the y axis."""
    cosine, sine = scale * math.cos(angle_rad), scale * math.sin(angle_rad)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


def squared_distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Of points (n, 2) from others (m, 2), (n, m)."""
    across, down = (one[:, None, axis] - other[None, :, axis] for axis in (0, 1))
    return across * across + down * down


def largest_cluster(votes: np.ndarray, reach: float) -> np.ndarray:
    """Which votes (n, 2) belong to the largest group under single linkage at a distance, (n,) bool."""
    if not len(votes):
        return np.zeros(0, bool)
    near = squared_distances(votes, votes) <= reach * reach
    labels = np.arange(len(votes))
    while True:
        lower = np.where(near, labels[None], len(votes)).min(axis=1)
        lower = lower[lower]  # the label of one's label: chains shorten by half
        if (lower == labels).all():
            break
        labels = lower
    return labels == np.bincount(labels).argmax()
