"""Check of the headless renderer, in a process of its own: a broken driver may take its process with it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator

from common.config import Config
from common.doctor.finding import Finding, fault, ok, warning
from common.geometry.config import CamerasConfig

_LIMIT_S = 9.0


def graphics(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether a picture can be rendered without a display, by which driver and how fast."""
    camera = config.section(CamerasConfig).down
    try:
        result = subprocess.run(
            [sys.executable, "-m", "simulation.doctor.render", str(camera.width), str(camera.height)],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=_LIMIT_S,
        )
    except subprocess.TimeoutExpired:
        yield fault("graphics", f"no picture in {_LIMIT_S:g} s", "free the cores and try again, or look at the driver")
        return
    if result.returncode != 0:
        said = (result.stderr.strip().splitlines() or [f"exit code {result.returncode}"])[-1]
        yield fault(
            "graphics",
            f"renders nothing: {said[:200]}",
            "unset MUJOCO_GL or set it to egl, and install libegl1, libegl-mesa0 and libgl1-mesa-dri",
        )
        return
    seen = json.loads(result.stdout.splitlines()[-1])
    share = seen["ms"] * camera.rate_hz / 1e3
    text = f"{seen['driver']}: {camera.width}x{camera.height} in {seen['ms']:.1f} ms, {share:.0%} of the time at hand"
    if share > 0.5:
        yield warning("graphics", text, "free the cores, or make camera.down.width, height or rate_hz smaller")
    else:
        yield ok("graphics", text)
