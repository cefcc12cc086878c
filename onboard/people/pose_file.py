"""The pose network that the configuration names; by default BlazePose, where set-up keeps it, and that it is that."""

from __future__ import annotations

from pathlib import Path

from onboard.people.network_file import NetworkFile
from onboard.people.pose_network import PoseNetwork, blazepose, read_model

BLAZEPOSE = NetworkFile(
    what="pose model",
    name="pose_landmark_full.tflite",
    sha256="e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
    how="`scripts/setup.sh run`",
)
"""Of the wheel of mediapipe 0.10.21 (Google's MediaPipe, Apache-2.0)."""


def blazepose_file() -> Path:
    """Path of `pose_landmark_full.tflite`.

    Raises:
        ConfigError: it is not there, or it is another file.
    """
    return BLAZEPOSE.checked()


def pose_network(model: str = "") -> PoseNetwork:
    """The network of a TOML file (`onboard.people.pose_network.PoseModel`), or BlazePose when none is named.

    Raises:
        ConfigError: a file is missing, is another one, or cannot be read.
    """
    return PoseNetwork(read_model(Path(model)) if model else blazepose(blazepose_file()))
