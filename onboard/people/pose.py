"""Fifteen joints of a person from a picture: an upright crop, a network, and the head's end found (section 4.1).

The network is whatever `PoseModel` describes; two ship: BlazePose (`blazepose`), and any ONNX file with a joint map of
its own (`read_model`). OpenCV runs both. Its engines differ in what they compute, so each model names its own, and a
replay test holds the numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.config import ConfigError, Section, build, read_toml
from common.geometry.rotation import Array
from common.messages import JOINTS
from onboard.people.regions import Region

HEAD, NECK, HIP_R, KNEE_R, ANKLE_R, HIP_L, KNEE_L, ANKLE_L, WAIST = 0, 1, 8, 9, 10, 11, 12, 13, 14
ANKLES = (ANKLE_R, ANKLE_L)
BONES = np.array(
    [
        *((0, 1), (1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 14)),
        *((14, 8), (8, 9), (9, 10), (14, 11), (11, 12), (12, 13)),
    ]
)
"""Pairs of joints."""

_FIRST_MARGIN, _MARGIN = 1.3, 1.45
"""Side of the crop over the length of what it shows: of the region, which may lack the soles, and of the joints, which
lack the crown of the head, the hands and the feet."""

_NECK, _COVERED = 0.35, 0.75
"""Head to neck over the trunk, and the joints' extent over the region's, that an upright body reaches (vtest.avi)."""
_DECIDED = 0.5
"""One end is out when it is rated below this share of the other."""
_NOBODY, _SURE = 0.05, 0.95
"""Presence below which no end of a region is worth a second look, and above which one look may be enough."""
_CLEAR = 3.0
"""Rating (of 4 at most) that a body standing on its head does not reach: the other end need not be tried. In simulated
flights the right end of people was rated 3.1 to 4.0 in nine of ten looks, the wrong one at most 1.6."""
_UPRIGHT, _SAME_WAY = 0.97, 0.8
"""Cosines of the turns between crop and body, and from picture to picture, up to which it is."""

STANDING_M = 1.2
"""Who reaches higher stands."""

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Pose:
    """A person's joints in a picture."""

    joints_px: Array
    """(15, 2), in the order of `JOINTS`."""
    confidence: Array
    """(15,), 0 to 1."""
    presence: float
    """What the network says about a person being there at all, 0 to 1; 1 where it says nothing."""

    @property
    def feet_px(self) -> Array:
        """(2,) middle of the ankles."""
        return self.joints_px[list(ANKLES)].mean(axis=0)

    @property
    def up(self) -> Array:
        """(2,) unit vector from the feet to the head, or up the picture where both are the same."""
        line = self.joints_px[HEAD] - self.feet_px
        length = float(np.linalg.norm(line))
        return line / length if length > 1e-6 else np.array([0.0, -1.0])


class PoseModel(Section, frozen=True, kw_only=True):
    """A pose network in a file, and how to read what it says. A file of this in TOML stands beside an ONNX model."""

    file: str
    """ONNX or TFLite; in a TOML file relative to it."""
    size_px: Annotated[int, msgspec.Meta(ge=16, le=2048)] = 256
    """Side of the square picture that goes in, px."""
    engine: Literal["classic", "new"] = "classic"
    """OpenCV's engine: they differ, see there."""
    colours: Literal["rgb", "bgr"] = "rgb"
    """Order of the channels."""
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Taken from each channel's 0 to 255, in that order."""
    scale: float = 1.0 / 255.0
    """Then multiplied by this."""
    output: str = "output"
    """Name of the output that holds the joints."""
    kind: Literal["points", "heatmaps"] = "points"
    """`points`: rows of x, y and more for each point; `heatmaps`: a map (H, W) for each point."""
    row: Annotated[int, msgspec.Meta(ge=2, le=16)] = 3
    """Numbers in a row of `points`."""
    unit: Literal["pixels", "fractions"] = "pixels"
    """Whether x and y count pixels of the picture that went in or shares of its side."""
    confidence: Annotated[int, msgspec.Meta(ge=-1, le=15)] = 2
    """Place of the confidence in a row; -1 when there is none. Of a heatmap it is the peak."""
    logistic: bool = False
    """Whether the confidence is a logit."""
    presence: str = ""
    """Name of the output that holds the presence, 0 to 1; none when empty."""
    joints: Annotated[tuple[tuple[int, ...], ...], msgspec.Meta(min_length=15, max_length=15)]
    """For each of the fifteen joints the points whose middle it is: `[[0], [5, 6], …]`."""

    def check(self) -> None:
        """Refuse a map that leaves a joint out."""
        for name, points in zip(JOINTS, self.joints, strict=True):
            if not points or min(points) < 0:
                raise ConfigError(f"joints: got {list(points)} for {name}, expected the numbers of one or more points")


def blazepose(file: Path) -> PoseModel:
    """MediaPipe's BlazePose, `pose_landmark_full.tflite` (Bazarevsky et al. 2020, arXiv 2006.10204; Apache-2.0).

    Its output `Identity` has rows of x, y, z, visibility and presence for 39 points; the head is the middle of the
    ears, neck and waist are the middles of shoulders and hips.
    """
    joints = ((7, 8), (11, 12), (12,), (14,), (16,), (11,), (13,), (15,), (24,), (26,), (28,), (23,), (25,), (27,))
    return PoseModel(
        file=str(file),
        output="Identity",
        row=5,
        confidence=3,
        logistic=True,
        presence="Identity_1",
        joints=(*joints, (23, 24)),
    )


def read_model(path: Path) -> PoseModel:
    """Model of a TOML file (`PoseModel`), whose `file` is relative to it.

    Raises:
        ConfigError: unreadable, or not as described.
    """
    model = build(PoseModel, read_toml(path), str(path))
    return msgspec.structs.replace(model, file=str(path.parent / model.file))


class PoseNetwork:
    """A loaded pose model.

    Args:
        model: what to load.

    Raises:
        ConfigError: the file is missing or OpenCV cannot read it.
    """

    def __init__(self, model: PoseModel):
        self.model = model
        path = Path(model.file)
        if not path.is_file():
            raise ConfigError(f"pose model: {path} does not exist; scripts/setup.sh fetches BlazePose")
        engine = cv2.dnn.ENGINE_CLASSIC if model.engine == "classic" else cv2.dnn.ENGINE_NEW
        read = cv2.dnn.readNetFromTFLite if path.suffix == ".tflite" else cv2.dnn.readNetFromONNX
        try:
            self._net = read(str(path), engine)
        except cv2.error as error:
            raise ConfigError(f"pose model: OpenCV cannot read {path} ({str(error).strip()})") from None
        names = set(self._net.getUnconnectedOutLayersNames())
        for wanted in filter(None, (model.output, model.presence)):
            if wanted not in names:
                raise ConfigError(f"pose model: {path} has no output {wanted!r}, only {sorted(names)}")

    def __call__(self, crop: Picture) -> tuple[Array, Array, float]:
        """Joints (15, 2) in px of a crop (size, size, 3), BGR, their confidences (15,), and the presence."""
        model = self.model
        blob = cv2.dnn.blobFromImage(crop, 1.0, (model.size_px,) * 2, model.mean, model.colours == "rgb")
        self._net.setInput(blob * np.float32(model.scale))
        names = [model.output] + ([model.presence] if model.presence else [])
        outputs = [np.asarray(o, float) for o in self._net.forward(names)]
        presence = float(outputs[1].ravel()[0]) if model.presence else 1.0
        points, confidence = self._points(outputs[0])
        if max(max(p) for p in model.joints) >= len(points):
            raise ConfigError(f"pose model: joints name point {max(max(p) for p in model.joints)} of {len(points)}")
        joints = np.array([points[list(p)].mean(axis=0) for p in model.joints])
        return joints, np.array([confidence[list(p)].min() for p in model.joints]), presence

    def _points(self, output: Array) -> tuple[Array, Array]:
        model = self.model
        if model.kind == "heatmaps":
            maps = output.reshape(-1, *output.shape[-2:]).astype(float)
            best = maps.reshape(len(maps), -1).argmax(axis=1)
            rows, columns = np.unravel_index(best, maps.shape[1:])
            shares = np.column_stack(((columns + 0.5) / maps.shape[2], (rows + 0.5) / maps.shape[1]))
            return shares * model.size_px - 0.5, maps.max(axis=(1, 2)).clip(0.0, 1.0)
        rows = output.reshape(-1, model.row).astype(float)
        points = rows[:, :2] * (model.size_px if model.unit == "fractions" else 1.0)
        if model.confidence < 0:
            return points, np.ones(len(points))
        confidence = rows[:, model.confidence]
        return points, 1.0 / (1.0 + np.exp(-confidence)) if model.logistic else confidence.clip(0.0, 1.0)


def upright_crop(
    picture: Picture, centre_px: ArrayLike, up: ArrayLike, side_px: float, size: int
) -> tuple[Picture, Array]:
    """Square (size, size, 3) of a picture, turned so that a direction points up, and the map (2, 3) back to it.

    Args:
        picture: (H, W, 3).
        centre_px: middle of the square in the picture, px.
        up: (2,) direction in the picture that becomes up.
        side_px: side of the square in the picture, px.
        size: side of the result, px.
    """
    up = np.asarray(up, float) / np.linalg.norm(up)
    right = np.array([-up[1], up[0]])
    step = side_px / size
    # Columns: where one crop pixel to the right and one down lead in the picture.
    turn = np.column_stack((right, -up)) * step
    back = np.column_stack((turn, np.asarray(centre_px, float) - turn @ np.full(2, 0.5 * (size - 1))))
    flags = cv2.WARP_INVERSE_MAP | (cv2.INTER_LINEAR if step < 2 else cv2.INTER_AREA)
    crop = cv2.warpAffine(picture, back, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(crop, np.uint8), back


class PoseFinder:
    """Finds the pose in a region whatever way the body lies.

    Args:
        network: what finds joints in an upright crop.
    """

    def __init__(self, network: PoseNetwork):
        self.network = network

    def find(
        self,
        picture: Picture,
        region: Region,
        expected: Pose | None = None,
        enough: Callable[[Pose], bool] = lambda _: False,
    ) -> Pose:
        """The pose in a region: upright along its principal axis, the likelier end up, then, unless that is a body
        beyond doubt, the other way round; the better one once more along the line from its feet to its head, unless the
        first look was upright already.

        Args:
            picture: (H, W, 3) BGR.
            region: where to look.
            expected: the pose as it ought to be, where it is known from before: one look there is enough where it finds
                a body.
            enough: whether a look needs no other.
        """
        middle, axis, length = _likely_end_up(region)
        if expected is not None:
            pose = self._expected(picture, region, expected, middle, length)
            if enough(pose) or (pose.presence >= _SURE and float(pose.up @ expected.up) > _SAME_WAY):
                return pose
        ways = (axis, -axis)
        likely = self._at(picture, middle, axis, _FIRST_MARGIN * length)
        upright = likely.presence >= _SURE and float(likely.up @ axis) > _UPRIGHT
        if enough(likely) or (upright and _rating(likely, axis, length) > _CLEAR):
            return likely
        first = [likely, self._at(picture, middle, -axis, _FIRST_MARGIN * length)]
        rated = sorted(((_rating(pose, way, length), k) for k, (pose, way) in enumerate(zip(first, ways, strict=True))))
        best, index = rated[-1]
        if max(pose.presence for pose in first) < _NOBODY:
            return first[index]
        # A second look along the line that was found; at both ends where the first look does not decide.
        undecided = [k for rating, k in rated if rating > _DECIDED * best]
        sure = len(undecided) == 1 and first[index].presence >= _SURE
        if sure and float(first[index].up @ ways[index]) > _UPRIGHT:
            return first[index]
        looks = [(best, first[index])]
        for k in undecided:
            pose = self.again(picture, first[k])
            looks.append((_rating(pose, first[k].up, length), pose))
        return max(looks, key=lambda look: look[0])[1]

    def _expected(self, picture: Picture, region: Region, expected: Pose, middle: Array, length: float) -> Pose:
        if (region.height_m or 0.0) > STANDING_M:
            # From above, head and feet are too near each other to lay a crop around them.
            return self._at(picture, middle, expected.up, _FIRST_MARGIN * length)
        return self.again(picture, expected)

    def again(self, picture: Picture, pose: Pose) -> Pose:
        """The pose in a crop upright along the line from the feet to the head of another, around its joints."""
        axes = np.column_stack((pose.up, (-pose.up[1], pose.up[0])))
        places = pose.joints_px @ axes
        low, high = places.min(axis=0), places.max(axis=0)
        return self._at(picture, axes @ (0.5 * (low + high)), pose.up, _MARGIN * float(max(high - low)))

    def _at(self, picture: Picture, centre: Array, up: Array, side: float) -> Pose:
        crop, back = upright_crop(picture, centre, up, max(side, 8.0), self.network.model.size_px)
        joints, confidence, presence = self.network(crop)
        return Pose(joints @ back[:, :2].T + back[:, 2], confidence, presence)


def _likely_end_up(region: Region) -> tuple[Array, Array, float]:
    """Middle (2,) of a region, px, direction (2,) to the end where the head is likely to be, and its length, px: of
    somebody upright the top, of somebody who lies the end that more of the region, trunk and arms, lies near."""
    start, end = region.axis()
    middle, length = 0.5 * (start + end), float(np.linalg.norm(end - start))
    if length < 1.0:
        return middle, np.array([0.0, 1.0]), 1.0
    axis = (end - start) / length
    stands = region.crown is not None and (region.height_m or 0.0) > STANDING_M
    towards = region.crown.middle_px if stands and region.crown is not None else region.middle_px
    return middle, axis if float((towards - middle) @ axis) > 0 else -axis, length


def _rating(pose: Pose, up: Array, length_px: float) -> float:
    """How well a pose fits the crop that it was found in, whose up is (2,), and a region of a length: present, visible,
    trunk and legs upright, the neck as long as necks are, and the body as long as the region.

    Presence alone does not tell the ends apart: it may stay at 1 for a body that stands on its head. A network that is
    shown one squeezes an upright body into its legs.
    """
    trunk = pose.joints_px[NECK] - pose.joints_px[WAIST]
    legs = pose.joints_px[WAIST] - pose.feet_px
    neck = float(np.linalg.norm(pose.joints_px[HEAD] - pose.joints_px[NECK]))
    cosines = sum(float(v @ up / max(np.linalg.norm(v), 1e-9)) for v in (trunk, legs))
    covered = float(np.ptp(pose.joints_px @ up)) / length_px
    return (
        pose.presence
        * float(pose.confidence.mean())
        * (2.0 + cosines)
        * min(1.0, neck / max(_NECK * float(np.linalg.norm(trunk)), 1e-9))
        * min(1.0, covered / _COVERED)
    )
