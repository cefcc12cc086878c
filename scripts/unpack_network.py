"""Takes one network out of a package that was fetched but not installed, and keeps it: `scripts/setup.sh` calls this.

python scripts/unpack_network.py pose FOLDER        FOLDER holds the wheel of mediapipe
python scripts/unpack_network.py detector FOLDER    FOLDER holds the unpacked npm package @mediapipe/objectron
"""

from __future__ import annotations

import json
import re
import sys
import zipfile
from pathlib import Path

from common.config import ConfigError
from onboard.people.detector_file import OIDV4
from onboard.people.pose_file import BLAZEPOSE


def unpack_pose(folder: Path) -> None:
    """Store BlazePose full, one file of a large wheel.

    Raises:
        ConfigError: the file is another one.
    """
    (wheel,) = folder.glob("mediapipe-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        licence = archive.read("mediapipe-0.10.21.dist-info/LICENSE")
        BLAZEPOSE.store(archive.read(f"mediapipe/modules/pose_landmark/{BLAZEPOSE.name}"), licence)


def unpack_detector(folder: Path) -> None:
    """Store the person detector: the package has its files in one, and a list of where each begins.

    Raises:
        ConfigError: the file is another one.
    """
    loader = (folder / "objectron_solution_packed_assets_loader.js").read_text()
    listed = re.search(r'"files": (\[.*?\])', loader)
    if listed is None:
        raise ConfigError(f"{OIDV4.what}: the package's loader lists no files; expected the pinned package")
    name = "object_detection_ssd_mobilenetv2_oidv4_fp16.tflite"
    (entry,) = [file for file in json.loads(listed[1]) if file["filename"].endswith(name)]
    packed = (folder / "objectron_solution_packed_assets.data").read_bytes()
    licence = json.loads((folder / "package.json").read_text())["license"]
    content = packed[entry["start"] : entry["end"]]
    OIDV4.store(content, f"{licence}; MediaPipe, Google; npm package @mediapipe/objectron\n".encode())


if __name__ == "__main__":
    try:
        {"pose": unpack_pose, "detector": unpack_detector}[sys.argv[1]](Path(sys.argv[2]))
    except ConfigError as error:
        raise SystemExit(f"set-up: {error}") from error
