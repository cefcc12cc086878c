"""The person detector that set-up can fetch, and that it is that."""

from __future__ import annotations

from onboard.people.network_file import NetworkFile
from onboard.people.pipeline_config import DetectorConfig

OIDV4 = NetworkFile(
    what="detector",
    name="oidv4_ssd.tflite",
    sha256="d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
    how="`scripts/setup.sh detector`",
)
"""`object_detection_ssd_mobilenetv2_oidv4_fp16.tflite` of the npm package @mediapipe/objectron 0.4.1675468480."""
HOW = f"{OIDV4.how} fetches one"


def fetched_detector() -> DetectorConfig | None:
    """SSD on MobileNetV2, trained on Open Images v4, Google's MediaPipe, Apache-2.0; None where it was not fetched.

    Score, overlap and squares were chosen on six of vtest.avi's pictures (`benchmarks/people_video.py` names them).

    Raises:
        ConfigError: it is another file.
    """
    if not OIDV4.path.is_file():
        return None
    return DetectorConfig(
        file=str(OIDV4.checked()),
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
