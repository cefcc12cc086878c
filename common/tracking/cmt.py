"""CMT: keypoints found again and keypoints followed, of which those that agree on the centre are the target.

Nebehay and Pflugfelder 2014 (DOI 10.1109/WACV.2014.6836013) and 2015 (DOI 10.1109/CVPR.2015.7298895). The static
correspondences are matches with what the target first looked like, which is never changed; the adaptive ones are
keypoints that optical flow carries on from the picture before. Both vote for the centre; the largest cluster of votes
is the target, and what lies outside it is thrown away: background that flow has slid onto, false matches.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.tracking.base import Box
from common.tracking.box_tracker import BoxTracker, Step
from common.tracking.cmt_config import CmtConfig
from common.tracking.cmt_consensus import largest_cluster, rotated, similarity_of, squared_distances
from common.tracking.cmt_keypoints import Keypoints, View, differing, unique_matches
from common.tracking.flow import follow_points

_SCALES_SEARCHED = (1.0, 0.75, 1.33)
_SEARCHED_KEYPOINTS = 1200
"""Keypoints of the whole picture."""
_NOISE_PICTURES = 5
"""Pictures from which the noise is taken."""
_LEAST_NOISE, _MOST_NOISE = 0.18, 0.27
"""Bounds of the share of differing bits that counts as noise."""
_LARGEST_SEARCH_PX = 1280
"""Longer side of the picture in which the whole is searched, px."""


class CmtTracker(BoxTracker):
    """Tracks a rotating and growing box. See `common.tracking.base.Tracker`.

    Args:
        config: its parameters.
        rng: not used; the tracker has no randomness.
    """

    config_type = CmtConfig
    name = "cmt"

    def __init__(self, config: CmtConfig, rng: np.random.Generator):
        del rng
        super().__init__(config)
        self._config = config

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the keypoints within the box, and those around it as what is not the target."""
        self._begin(frame, box, angle_rad, t_ns)
        self._angle = angle_rad
        self._side = math.sqrt(float(self._base.prod()))
        self._keypoints = Keypoints(self._config.spacing_px)
        self._grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        places, descriptors = self._look(self._grey, self._config.keypoints)
        offsets = rotated(places - self._center, 1.0, -angle_rad)
        own = (np.abs(offsets) <= self._base / 2).all(axis=1)
        self._model, self._descriptors = offsets[own], descriptors[own]
        self._background = descriptors[~own]
        self._first = len(self._model)
        self._noise: list[float] = []
        self._active = np.arange(self._first)
        self._places = places[own].astype(np.float32)
        self._result = self._report(1.0, "tracking")

    def place(self, frame: np.ndarray, box: Box) -> None:
        """Go on from a box that somebody else found; what is known of the target is unchanged.

        Raises:
            ValueError: not started, or a bad box.
        """
        super().place(frame, box)
        self._active, self._places = np.zeros(0, int), np.zeros((0, 2), np.float32)

    def _step(self, frame: np.ndarray) -> Step:
        """Follow, match, vote; a search of the whole picture where too few agree."""
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        before = (self._center, self._scale, self._angle)
        score, again = self._follow(grey), False
        if score < 0.5:
            self._center, self._scale, self._angle = before
            if self._unseen >= self._config.patience:
                score = self._search(grey)
                again = score >= 0.5
                if not again:
                    self._center, self._scale, self._angle = before
        self._grey = grey
        if score < 0.5 and self._unseen >= self._config.patience:
            self._active, self._places = np.zeros(0, int), np.zeros((0, 2), np.float32)
        return Step(score, score >= 0.5, again)

    def _follow(self, grey: np.ndarray) -> float:
        """Carry the keypoints on and look around where they went; returns the score, 0.5 at its limit."""
        places, error = follow_points(self._grey, grey, self._places, self._expected_px)
        held = error <= max(0.5, self._config.flow_error * self._side * self._scale)
        if held.any():
            moved = np.median(places[held] - self._places[held], axis=0)
            self._center = self._center + moved - (0.0 if self._expected_px is None else self._expected_px)
        places_seen, descriptors = self._look(grey, self._config.keypoints)
        return self._agree(self._active[held], places[held], places_seen, descriptors)

    def _search(self, grey: np.ndarray) -> float:
        """Match the whole picture at one of several sizes; returns the score there."""
        scale = self._scale * _SCALES_SEARCHED[self._number % len(_SCALES_SEARCHED)]
        zoom = min(self._config.side_px / (self._side * scale), _LARGEST_SEARCH_PX / max(grey.shape))
        size = (round(grey.shape[1] * zoom), round(grey.shape[0] * zoom))
        middle = ((grey.shape[1] - 1) / 2, (grey.shape[0] - 1) / 2)
        view = View(middle, zoom, 0.0, size)
        found, descriptors = self._keypoints.find(view.cut(grey), _SEARCHED_KEYPOINTS)
        self._scale = self._bounded(scale)
        nobody = np.zeros(0, int), np.zeros((0, 2), np.float32)
        score = self._agree(*nobody, view.in_picture(found), descriptors)
        if len(self._active) < self._config.least_points or score == 0.0:
            return score
        # Corners that are weak in the whole picture are there in a window of its own.
        return self._agree(self._active, self._places, *self._look(grey, self._config.keypoints))

    def _look(self, grey: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Keypoints around the target: places (n, 2) in the picture, px, and descriptors (n, 4)."""
        config = self._config
        zoom = config.side_px / (self._side * self._scale)
        shape = self._base / self._side * config.side_px
        margin = (config.view - 1) * config.side_px
        size = (round(float(shape[0] + margin)), round(float(shape[1] + margin)))
        view = View((float(self._center[0]), float(self._center[1])), zoom, self._angle, size)
        found, descriptors = self._keypoints.find(view.cut(grey), count)
        return view.in_picture(found), descriptors

    def _agree(
        self, followed: np.ndarray, followed_places: np.ndarray, places: np.ndarray, descriptors: np.ndarray
    ) -> float:
        """Fuse both kinds of correspondences, vote, and add what is found where it is then expected.

        Args:
            followed: (k,) numbers of the model's keypoints that flow carried here.
            followed_places: (k, 2), px.
            places: (n, 2) of all keypoints that were found, px.
            descriptors: (n, 4) of them.
        """
        config = self._config
        own = differing(descriptors, self._descriptors)
        rows, columns = self._matches(own, descriptors)
        fresh = ~np.isin(columns, followed)
        numbers = np.concatenate([followed, columns[fresh]])
        seen = np.concatenate([followed_places, places[rows[fresh]]])
        together = self._consensus(self._model[numbers], seen)
        if together is None:
            return 0.0
        numbers, seen = numbers[together], seen[together]
        reach = config.cluster * self._side * self._scale
        numbers, seen = self._add_near(numbers, seen, places, own, reach)
        self._active, self._places = numbers, seen.astype(np.float32)
        limit = max(config.least_points, config.least_share * len(self._model))
        unlike = self._unlike(places, own, reach)
        if len(self._noise) < _NOISE_PICTURES:
            self._noise.append(unlike)
        noise = min(max(float(np.median(self._noise)), _LEAST_NOISE), _MOST_NOISE)
        if self._number % config.renew_every == 0 and unlike <= noise + config.renew_margin and len(numbers) >= limit:
            self._renew(places, descriptors, own, reach)
        likeness = (0.5 - unlike) / (
            0.5 - noise - config.unlike_margin
        )  # unrelated descriptors differ in half of their bits
        return float(min(1.0, 0.5 * min(len(numbers) / limit, likeness)))

    def _matches(self, own: np.ndarray, descriptors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k,) and the model's numbers (k,) of keypoints that look like one of the target and like nothing else.

        Args:
            own: (n, m) distances to the model.
            descriptors: (n, 4).
        """
        config = self._config
        rows, columns = unique_matches(own, config.match_distance)
        # Of the same corner the model may have learned several looks: they are no rivals of each other.
        elsewhere = squared_distances(self._model[columns], self._model) > (config.cluster * self._side) ** 2
        second = np.where(elsewhere, own[rows], np.float32(1.0)).min(axis=1)
        if len(self._background) and len(rows):
            second = np.minimum(second, differing(descriptors[rows], self._background).min(axis=1))
        good = own[rows, columns] <= config.match_ratio * second
        return rows[good], columns[good]

    def _consensus(self, model: np.ndarray, seen: np.ndarray) -> np.ndarray | None:
        """Set size, rotation and centre by what most points (n, 2) say; which do so, (n,) bool, or None without any.

        Besides the medians over all pairs, of which half may be wrong, the last known size and rotation are tried.
        """
        poses = [(self._scale, self._angle)]
        if (change := similarity_of(model, seen)) is not None:
            poses.append(change)
        best = None
        for scale, angle in poses:
            scale = self._bounded(scale)
            reach = self._config.cluster * self._side * scale
            together = largest_cluster(seen - rotated(model, scale, angle), reach)
            if best is None or together.sum() > best.sum():
                best = together
        change = None if best is None else similarity_of(model[best], seen[best])
        if best is None or change is None:
            return None
        self._scale, self._angle = self._bounded(change[0]), change[1]
        self._center = np.median(seen[best] - rotated(model[best], self._scale, self._angle), axis=0)
        return best

    def _unlike(self, places: np.ndarray, own: np.ndarray, reach: float) -> float:
        """Mean distance of the model's keypoints to the most similar one where each should be, 0 to 1."""
        if not len(places):
            return 1.0
        near = np.where(self._near(places, np.arange(len(self._model)), reach), own, np.float32(0.5))
        return float(np.minimum(near.min(axis=0), 0.5).mean())

    def _near(self, places: np.ndarray, numbers: np.ndarray, reach: float) -> np.ndarray:
        """Which places (n, 2) are where the model's keypoints of these numbers (m,) should be, (n, m) bool."""
        expected = self._center + rotated(self._model[numbers], self._scale, self._angle)
        return squared_distances(places, expected) <= reach * reach

    def _renew(self, places: np.ndarray, descriptors: np.ndarray, own: np.ndarray, reach: float) -> None:
        """Learn keypoints within the target that are like none of the model there; the first ones are kept for ever."""
        offsets = rotated(places - self._center, 1.0 / self._scale, -self._angle)
        known = (self._near(places, np.arange(len(self._model)), reach) & (own < self._config.near_distance)).any(
            axis=1
        )
        fresh = (np.abs(offsets) <= 0.45 * self._base).all(axis=1) & ~known
        if not fresh.any():
            return
        old = len(self._model)
        self._model = np.concatenate([self._model, offsets[fresh]])
        self._descriptors = np.concatenate([self._descriptors, descriptors[fresh]])
        self._active = np.concatenate([self._active, np.arange(old, len(self._model))])
        self._places = np.concatenate([self._places, places[fresh].astype(np.float32)])
        surplus = len(self._model) - max(self._config.model_keypoints, self._first)
        if surplus > 0:
            self._drop(np.arange(self._first, self._first + surplus))

    def _drop(self, numbers: np.ndarray) -> None:
        """Forget keypoints of the model."""
        kept = np.ones(len(self._model), bool)
        kept[numbers] = False
        self._model, self._descriptors = self._model[kept], self._descriptors[kept]
        active = kept[self._active]
        self._active = (np.cumsum(kept) - 1)[self._active[active]]
        self._places = self._places[active]

    def _add_near(
        self, numbers: np.ndarray, seen: np.ndarray, places: np.ndarray, own: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Keypoints that are where the model has one that is missing, and look like it."""
        missing = np.setdiff1d(np.arange(len(self._model)), numbers)
        distances = np.where(self._near(places, missing, reach), own[:, missing], np.float32(1.0))
        rows, columns = unique_matches(distances, self._config.near_distance)
        return np.concatenate([numbers, missing[columns]]), np.concatenate([seen, places[rows]])
