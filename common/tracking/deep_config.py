"""Settings of the deep trackers (`[nano]`, `[vit]`): model files, which the user brings."""

from __future__ import annotations

from common.config import Positive, Section


class NanoConfig(Section, frozen=True, kw_only=True):
    """OpenCV's `TrackerNano` (NanoTrack), which needs two files."""

    backbone: str = ""
    """ONNX file of the features, with an output `output`."""
    neckhead: str = ""
    """ONNX file of the comparison, from `input1` and `input2` to `output1` and `output2`."""
    threshold: Positive = 0.6
    """Its score below which the target counts as lost; at the last place 0.455 without any likeness, 1 with all."""


class VitConfig(Section, frozen=True, kw_only=True):
    """OpenCV's `TrackerVit`, which needs one file."""

    model: str = ""
    """ONNX file, from `template` and `search` to `output1`, `output2` and `output3`."""
    threshold: Positive = 0.2
    """Its score (0 to 1) below which the target counts as lost."""
