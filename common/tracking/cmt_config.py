"""Settings of the keypoint tracker (`[cmt]`)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Fraction, NonNegative, Positive, Section


class CmtConfig(Section, frozen=True, kw_only=True):
    """Clustering of static-adaptive correspondences."""

    side_px: Annotated[float, msgspec.Meta(ge=40, le=240)] = 60.0
    """Square root of the target's area in the picture in which keypoints are found, px."""
    view: Annotated[float, msgspec.Meta(gt=1, le=5)] = 2.4
    """Side of the searched window over the target's."""
    keypoints: Annotated[int, msgspec.Meta(ge=20, le=2000)] = 300
    """Most keypoints of the window."""
    spacing_px: Positive = 3.0
    """Least distance of two keypoints in that picture, px."""
    flow_error: Positive = 0.05
    """Largest forward-backward error of a followed keypoint, target sizes."""
    match_distance: Fraction = 0.25
    """Largest share of differing bits of a match anywhere (the paper: 0.25)."""
    match_ratio: Fraction = 0.8
    """Its largest ratio to the second-best (the paper: 0.8)."""
    near_distance: Fraction = 0.3
    """Largest share of differing bits of a match where the keypoint is expected."""
    cluster: Positive = 0.2
    """Distance at which two votes for the centre are one, target sizes (the paper: 20 px)."""
    least_share: Fraction = 0.1
    """Least share of the target's keypoints that must agree (the paper: 0.1)."""
    least_points: Annotated[int, msgspec.Meta(ge=2)] = 4
    """Least number of them."""
    unlike_margin: Fraction = 0.11
    """The mean share of differing bits, over the target's keypoints and what is where they should be, may be so much
    above that of the first pictures, which is the sensor's noise; above that, what agrees on the centre is another
    thing."""
    renew_margin: Fraction = 0.04
    """The same for the learning of new keypoints within the target."""
    renew_every: Annotated[int, msgspec.Meta(ge=1)] = 5
    """Pictures between two times of learning."""
    model_keypoints: Annotated[int, msgspec.Meta(ge=20, le=1000)] = 200
    """Most keypoints of the target that are known at once."""
    max_scale: Annotated[float, msgspec.Meta(gt=1)] = 4.0
    """Bound of the size against the first one, either way."""
    patience: Annotated[int, msgspec.Meta(ge=0)] = 3
    """Pictures without the target after which it is searched in the whole picture."""
    lost_after_s: NonNegative = 1.0
    """Time without the target after which it is called lost, s."""
