"""The person detector that set-up can fetch, and that it is that."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from common.config import ConfigError
from onboard.people.pipeline_config import DetectorConfig

OIDV4_SHA256 = "d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6"
"""Of `object_detection_ssd_mobilenetv2_oidv4_fp16.tflite` in the npm package @mediapipe/objectron 0.4.1675468480."""
HOW = "`scripts/setup.sh detector` fetches one"


def fetched_detector() -> DetectorConfig | None:
    """SSD on MobileNetV2, trained on Open Images v4, Google's MediaPipe, Apache-2.0; None where it was not fetched.

    Score, overlap and squares were chosen on six of vtest.avi's pictures (`benchmarks/people_video.py` names them).

    Raises:
        ConfigError: it is another file.
    """
    path = Path(sys.prefix) / "share" / "outrider" / "oidv4_ssd.tflite"
    if not path.is_file():
        return None
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != OIDV4_SHA256:
        raise ConfigError(f"detector: {path} has SHA-256 {found}, expected {OIDV4_SHA256}; remove it, fetch it again")
    return DetectorConfig(
        file=str(path),
        decoder="ssd_raw",
        output="raw_outputs/box_encodings",
        scores="raw_outputs/class_predictions",
        size_px=300,
        mean=(127.5, 127.5, 127.5),
        scale=1.0 / 127.5,
        person=4,
        least_score=0.5,
        most_overlap=0.3,
        merged=True,
        tiles=3,
    )
