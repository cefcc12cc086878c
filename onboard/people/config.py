"""Settings of the search for people."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import ConfigError, Fraction, Positive, Section


class FloorConfig(Section, frozen=True, kw_only=True):
    """Floor removal (Al-Kaff 2019, section 4.1)."""

    tilt_deg: Annotated[float, msgspec.Meta(gt=0, lt=90)] = 15.0
    """Largest angle between the floor and the plane across the camera's axis, deg (the paper's epsilon); when the
    attitude is known, between the floor and the horizontal."""
    band_m: Positive = 0.10
    """Points this close to a plane vote for it, m (the paper's d), and no point farther away counts as floor."""
    least_band_m: Positive = 0.05
    """Points this close to the floor always count as floor, m. Between the two bounds the band is three standard
    deviations of the floor's own points, so that a clean picture keeps the legs of a person who lies."""
    hypotheses: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 200
    """Planes through three points that RANSAC tries."""
    votes: Annotated[int, msgspec.Meta(ge=50, le=100_000)] = 1500
    """Points that vote on each plane; the refinement uses all points."""
    least_share: Fraction = 0.2
    """Share of all points that a floor must hold."""
    nearest_m: Positive = 0.4
    """Depths below this are the vehicle itself or noise, m."""
    farthest_m: Positive = 14.0
    """Depths above this are left out, m; a Kinect v2 ends at 8 m by itself."""
    spacing_m: Positive = 0.06
    """Wanted distance between neighbouring points on the floor, m: sets the stride over the depth picture."""

    def check(self) -> None:
        """Refuse bounds that are the wrong way round."""
        if self.least_band_m > self.band_m:
            raise ConfigError(f"least_band_m: got {self.least_band_m}, expected at most band_m ({self.band_m})")
        if self.nearest_m >= self.farthest_m:
            raise ConfigError(f"nearest_m: got {self.nearest_m}, expected less than farthest_m ({self.farthest_m})")


class ClusterConfig(Section, frozen=True, kw_only=True):
    """Clusters above the floor, and which of them may be a person (Al-Kaff 2019, section 4.1).

    The paper's limits are point counts at one height. These are lengths and areas, which do not change with it.
    """

    radius_m: Positive = 0.13
    """Points closer than this belong together, m, measured across the rays at the floor's distance."""
    radius_spacings: Positive = 2.2
    """The radius is at least so many times the distance between neighbouring points on the floor."""
    range_weight: Positive = 0.2
    """What a difference in depth counts against the same difference across the rays: a camera above sees a shoulder and
    the knee below it side by side, and nothing between them."""
    neighbours: Annotated[int, msgspec.Meta(ge=1, le=100)] = 4
    """A point with fewer points than this (itself included) within the radius joins no two clusters: flying pixels."""
    least_length_m: Positive = 0.45
    """Shortest longest side of a person, of whom half may be outside the picture, m."""
    most_length_m: Positive = 2.6
    """Longest side of a person who lies with the arms stretched beyond the head, m."""
    most_height_m: Positive = 3.0
    """Greatest height of a person's highest point above the floor, m: a jump is included."""
    least_area_m2: Positive = 0.05
    """Least area of a person seen from the camera, m²."""
    most_area_m2: Positive = 1.0
    """Largest area of one person seen from the camera, m²; what is larger is split where it can be."""
    split_depth_m: Positive = 0.07
    """Parts that are to be people of their own have to stand out of what joins them by this much, m."""

    def check(self) -> None:
        """Refuse limits that are the wrong way round."""
        if self.least_length_m >= self.most_length_m:
            raise ConfigError(
                f"least_length_m: got {self.least_length_m}, expected less than most_length_m ({self.most_length_m})"
            )
        if self.least_area_m2 >= self.most_area_m2:
            raise ConfigError(
                f"least_area_m2: got {self.least_area_m2}, expected less than most_area_m2 ({self.most_area_m2})"
            )


class PoseFilterConfig(Section, frozen=True, kw_only=True):
    """Human Pose Filter (Al-Kaff 2019, section 4.2). Lengths are shares of the line from the head to the feet.

    Set on pictures of Debian's sample vtest.avi, where people's necks are 0.11 to 0.17 long, trunks 0.34 to 0.44, the
    extent is 0.69 to 0.88 of the box's, the mean confidence 0.74 and the presence 0.89 or more.
    """

    least_presence: Fraction = 0.8
    """What the network must say about a person being there; sign posts and jackets reach 0.98 now and then."""
    least_confidence: Fraction = 0.7
    """Least mean confidence of the joints."""
    least_region_px: Positive = 36.0
    """Shorter regions show too little to tell a person from a jacket, px."""
    least_neck: Positive = 0.09
    """The paper's T, the least distance of head and neck."""
    most_neck: Positive = 0.5
    """The greatest: a sitting person seen from above is short."""
    least_trunk: Positive = 0.3
    """Least distance of neck and waist."""
    least_filled: Positive = 0.65
    """Least extent of the joints along the body over the region's length."""
    most_filled: Positive = 1.25
    """Greatest extent over it."""
    least_inside: Fraction = 0.6
    """Least share of the joints that lie on the region that they were found in."""
    least_head: Fraction = 0.5
    """Least share of the head that lies on a region with depth that no picture's edge cuts. On simulated people who lie
    and sit it is 0.7 and more, on planks that somebody's legs touch at most 0.43."""
    least_upright_m: Positive = 0.6
    """Least height of somebody who is upright below the camera, m: who sits."""
    least_upright_presence: Fraction = 0.15
    """What the network must say about one seen from above; it knows them less well, but of things it says less."""
    least_crown_m2: Positive = 0.005
    """Least area of a head from above, m²."""
    most_crown_m2: Positive = 0.08
    """Largest, hair and what the shoulders add to it included, m²."""
    least_shoulders: Positive = 0.8
    """Least area of the shoulders below it over that of the head: posts have none."""
    most_crown_apart_m: Positive = 0.3
    """Largest distance of the found head from the top of the region, m."""
    least_body_m: Positive = 0.35
    """Shortest extent of the joints, m; sitting people and those seen from straight above are short."""
    most_body_m: Positive = 2.4
    """Greatest extent, m."""
    sure_presence: Fraction = 0.98
    """Presence, …"""
    sure_confidence: Fraction = 0.88
    """… mean confidence, …"""
    sure_height_m: Positive = 0.22
    """… height, m, …"""
    sure_body_m: tuple[Positive, Positive] = (0.9, 2.0)
    """… and extent of the joints, m, that things do not reach together: planks on each other looked like a body at
    0.975, 0.85 and 0.19 m, debris of 0.6 m beside somebody at 1.0, 0.90 and 0.29 m. Two of three looks at people do."""
    sure_sitting_m: Positive = 0.5
    """The least extent, m, of somebody who sits."""


class AssociationConfig(Section, frozen=True, kw_only=True):
    """Association and tracks (Al-Kaff 2019, sections 4.3 and 4.4). Costs are dissimilarities of 0 to about 1."""

    gate: Fraction = 0.22
    """Largest cost at which a detection is a known person; above it, it is a new one. In Debian's sample vtest.avi, as
    people there look from any side, 87 of 100 pairs of boxes of one person cost less and 82 of 100 of two more."""
    pose_weight: Annotated[float, msgspec.Meta(ge=0)] = 1.0
    """How much a pose distance of one body length enlarges the cost."""
    pose_memory_s: Positive = 2.0
    """Time constant with which a pose loses its weight, s."""
    gallery: Annotated[int, msgspec.Meta(ge=2, le=50)] = 6
    """Looks that are kept of each person."""
    same_look: Fraction = 0.95
    """Similarity above which a look is in the gallery already."""
    confirm_hits: Annotated[int, msgspec.Meta(ge=1)] = 2
    """Pictures in which a person must be seen to be believed, and what the looks among them must say together: a clear
    one counts for two, a doubtful one for a half (`evidence`)."""
    provisional_s: Positive = 2.0
    """A person not yet believed who is out of sight for this long is forgotten, s."""
    sight_factor: Fraction = 0.3
    """What unbroken sight of a region leaves of the cost of taking what it shows for the same person as before."""
    near_m: Positive = 0.5
    """Who is seen this near to where somebody was last, m, in the floor's plane, …"""
    near_factor: Fraction = 0.5
    """… is that person at this share of the cost: those who lie and sit stay where they are."""
    walk_m_s: Positive = 2.0
    """How fast people get elsewhere, m/s."""
    slack_m: Positive = 1.0
    """What a position may be wrong besides its covariance, m."""
