"""The pose network that the configuration names; by default BlazePose, where set-up keeps it, and that it is that."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from common.config import ConfigError
from onboard.people.pose import PoseNetwork, blazepose, read_model

BLAZEPOSE_SHA256 = "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f"
"""Of `pose_landmark_full.tflite` in mediapipe 0.10.21."""


def blazepose_file() -> Path:
    """Path of `pose_landmark_full.tflite`, which `scripts/setup.sh` takes out of the wheel of mediapipe 0.10.21.

    Raises:
        ConfigError: it is not there, or it is another file.
    """
    path = Path(sys.prefix) / "share" / "outrider" / "pose_landmark_full.tflite"
    if not path.is_file():
        raise ConfigError(f"pose model: {path} does not exist; scripts/setup.sh fetches it")
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != BLAZEPOSE_SHA256:
        raise ConfigError(
            f"pose model: {path} has SHA-256 {found}, expected {BLAZEPOSE_SHA256}; remove it, set up again"
        )
    return path


def pose_network(model: str = "") -> PoseNetwork:
    """The network of a TOML file (`onboard.people.pose.PoseModel`), or BlazePose when none is named.

    Raises:
        ConfigError: a file is missing, is another one, or cannot be read.
    """
    return PoseNetwork(read_model(Path(model)) if model else blazepose(blazepose_file()))
