"""Configuration of the search for people as a whole: `[people]`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Positive, Section
from common.topics import CAMERAS
from onboard.people.config import AssociationConfig, ClusterConfig, FloorConfig, PoseFilterConfig


class DetectorConfig(Section, frozen=True, kw_only=True):
    """A person detector in a file: where regions come from without depth."""

    file: str
    """Path of an ONNX file, or of a TFLite file that ends in .tflite."""
    decoder: Literal["yolo", "yolo_objectness", "ssd", "ssd_raw"]
    """What its output holds. `yolo`: (1, 4 + classes, boxes) of centre x, y, width, height in px and a score for each
    class. `yolo_objectness`: (1, boxes, 5 + classes), the fifth number a score of there being anything. `ssd`:
    (1, 1, boxes, 7) of picture, class, score and left, top, right, bottom as shares of the sides. `ssd_raw`: what
    TensorFlow's SSD says before that, (1, boxes, 4) of y, x, height, width against its default boxes, and in the output
    `scores` (1, boxes, classes) of logits."""
    output: str = ""
    """Name of the output; empty: the only one."""
    scores: str = ""
    """Name of a second output that holds the scores (`ssd_raw`); empty: they are in the first."""
    size_px: Annotated[int, msgspec.Meta(ge=16, le=4096)] = 640
    """Side of the square picture that goes in, px; ours is fitted into it, grey beside."""
    engine: Literal["classic", "new"] = "classic"
    """OpenCV's engine: they differ in what they can read."""
    colours: Literal["rgb", "bgr"] = "rgb"
    """Order of the channels."""
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Taken from each channel's 0 to 255, in that order."""
    scale: float = 1.0 / 255.0
    """Then multiplied by this."""
    person: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Number of the class that is people."""
    least_score: Fraction = 0.4
    """Boxes of a lower score are left out."""
    most_overlap: Fraction = 0.6
    """Of two boxes that share more of their area than this (IoU) the better one is kept."""
    merged: bool = False
    """Whether it becomes the mean of both, weighted by the squares of their scores: for boxes that fit loosely."""
    tiles: Annotated[int, msgspec.Meta(ge=0, le=16)] = 0
    """Beside the whole picture, squares of it are searched, so many along its shorter side, a third of each common with
    the next: for people who are small in it. Each takes as long as the picture. 0: none."""


class WatchConfig(Section, frozen=True, kw_only=True):
    """Which regions are looked at for a pose, and when."""

    budget_ms: NonNegative = 55.0
    """Time for poses in one picture, ms: no look is begun that is not expected to end within it, but at least one is
    taken. 0: every region in every picture."""
    same_m: Positive = 0.8
    """A region this near to where one was in the picture before is the same, m."""
    same_iou: Fraction = 0.2
    """Without places: a region that shares so much of its box with one of the picture before is the same."""
    changed_m: Positive = 0.25
    """A region that moved so far since its last look has changed, m."""
    changed_share: Positive = 0.25
    """One whose box or size changed by this share has changed, too."""
    refresh_s: Positive = 0.5
    """A person who does not change is looked at so often, s."""
    again_s: Positive = 0.2
    """What was no person and does not change is looked at again after this time, s, then after half as long again, …"""
    again_most_s: Positive = 2.0
    """… and so on up to this, s."""
    carry_s: Positive = 3.0
    """For so long after a pose was found its region counts as that person without another one, s."""
    forget_s: Positive = 1.0
    """A region that is out of sight for so long is forgotten, s; the person is not."""


class PeopleConfig(Section, frozen=True, kw_only=True):
    """The search for people: with which camera, and how its stages work."""

    camera: str = ""
    """Name of the camera that is searched; empty: none, the node has nothing to do."""
    use_depth: bool = True
    """Whether the camera's depth part is used, where it has one."""
    pair_ms: NonNegative = 20.0
    """Largest difference between the capture times of a picture and of the depth that belongs to it, ms."""
    wait_ms: NonNegative = 120.0
    """How long a picture waits for its depth, ms; then it is taken without, which is said."""
    pose_model: str = ""
    """TOML file of a pose network (`onboard.people.pose_network.PoseModel`); empty: BlazePose, which set-up fetches."""
    detector: DetectorConfig | None = None
    """Where regions come from without depth; None: without depth nobody is found."""
    position_sigma_m: Positive = 0.15
    """Standard deviation of the vehicle's own position within a mission, m."""
    attitude_sigma_rad: Positive = 0.02
    """Standard deviation of the attitude and of the camera's mounting, rad; it counts with the distance."""
    seed: int = 1
    """Seed of the floor's hypotheses."""
    floor: FloorConfig = FloorConfig()
    """Floor removal."""
    clusters: ClusterConfig = ClusterConfig()
    """What stands out of the floor."""
    pose_filter: PoseFilterConfig = PoseFilterConfig()
    """Which poses are those of people."""
    association: AssociationConfig = AssociationConfig()
    """Who is who."""
    watch: WatchConfig = WatchConfig()
    """Which regions are looked at, and when."""
    picture_px: Annotated[int, msgspec.Meta(ge=16, le=1024)] = 160
    """Longest side of the picture of a person that goes to the ground, px."""

    def check(self) -> None:
        """Refuse a camera that no vehicle has."""
        if self.camera and self.camera not in CAMERAS:
            raise ConfigError(f"camera: got {self.camera!r}, expected one of {', '.join(CAMERAS)}, or nothing")
