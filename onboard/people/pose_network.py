"""The network that finds the joints: whatever `PoseModel` describes.

Two ship: BlazePose (`blazepose`), and any ONNX file with a joint map of its own (`read_model`). OpenCV runs both. Its
engines differ in what they compute, so each model names its own, and a replay test holds the numbers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import cv2
import msgspec
import numpy as np

from common.config import ConfigError, Section, build, read_toml
from common.geometry.rotation import Array
from common.messages import JOINTS
from onboard.people.network_file import read_network
from onboard.people.pose import Picture


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
        """Refuse a map that leaves a joint out, and a place that no row has."""
        if self.kind == "points" and self.confidence >= self.row:
            raise ConfigError(
                f"confidence: got place {self.confidence}, expected one of a row of {self.row}, from 0; -1 for none"
            )
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
        ConfigError: the file is missing, OpenCV cannot read it, or what it says to an empty picture is not as
            described.
    """

    def __init__(self, model: PoseModel):
        self.model = model
        expected = "a pose network; scripts/setup.sh fetches BlazePose"
        self._net = read_network(model.file, model.engine, "pose model", expected)
        names = set(self._net.getUnconnectedOutLayersNames())
        for wanted in filter(None, (model.output, model.presence)):
            if wanted not in names:
                raise ConfigError(f"pose model: {model.file!r} has no output {wanted!r}, only {sorted(names)}")
        try:  # what is wrong shows now, not over somebody
            self._read(np.zeros((model.size_px, model.size_px, 3), np.uint8))
        except cv2.error as error:
            raise ConfigError(
                f"pose model: {model.file!r} does not run on {model.size_px}x{model.size_px} px; is size_px that of "
                f"the network? ({str(error).strip()})"
            ) from None

    def __call__(self, crop: Picture) -> tuple[Array, Array, float]:
        """Joints (15, 2) in px of a crop (size, size, 3), BGR, their confidences (15,), and the presence."""
        return self._read(crop)

    def _read(self, crop: Picture) -> tuple[Array, Array, float]:
        model = self.model
        blob = cv2.dnn.blobFromImage(crop, 1.0, (model.size_px,) * 2, model.mean, model.colours == "rgb")
        self._net.setInput(blob * np.float32(model.scale))
        names = [model.output] + ([model.presence] if model.presence else [])
        outputs = [np.asarray(o, float) for o in self._net.forward(names)]
        presence = float(outputs[1].ravel()[0]) if model.presence else 1.0
        points, confidence = self._points(outputs[0])
        if max(max(p) for p in model.joints) >= len(points):
            raise ConfigError(
                f"pose model: joints name point {max(max(p) for p in model.joints)}, but {model.file!r} gives only "
                f"{len(points)}, numbered from 0"
            )
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
        if output.size % model.row:
            raise ConfigError(
                f"pose model: output {model.output!r} of {model.file!r} has shape {output.shape}, which are no rows of "
                f"{model.row}; is it another `row`, or kind = 'heatmaps'?"
            )
        rows = output.reshape(-1, model.row).astype(float)
        points = rows[:, :2] * (model.size_px if model.unit == "fractions" else 1.0)
        if model.confidence < 0:
            return points, np.ones(len(points))
        confidence = rows[:, model.confidence]
        return points, 1.0 / (1.0 + np.exp(-confidence)) if model.logistic else confidence.clip(0.0, 1.0)
