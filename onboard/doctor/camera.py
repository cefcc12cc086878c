"""Checks of camera and calibration."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from common.config import Config, ConfigError
from common.doctor.finding import Finding, fault, from_error, ok, warning
from common.doctor.routers import hear, visit
from common.geometry.config import CameraConfig, CamerasConfig
from common.video import FileSource
from onboard.camera.config import VideoConfig
from onboard.camera.source import check_live, is_live, without_password

_LISTEN_S = 2.0
_OLD_MS = 500.0


def camera(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether the calibration is plausible, the source opens at its size, and pictures arrive while the system runs."""
    calibration, video = config.section(CamerasConfig).down, config.section(VideoConfig)
    yield plausible(calibration)
    if video.source != "sim":
        yield from source(video.source, calibration)
    with visit(config, "onboard") as bus:
        if bus is None:
            return
        pictures = hear(bus, ("camera/down/jpeg",), _LISTEN_S)["camera/down/jpeg"]
        now_ns = time.monotonic_ns()
    if not pictures:
        yield fault(
            "pictures",
            f"none in {_LISTEN_S:g} s",
            "look at the log of the camera node; start `outrider sim`, or set video.source",
        )
        return
    newest = pictures[-1]
    size = (newest.message.width, newest.message.height)
    age_ms = (now_ns - newest.header.capture_ns) / 1e6
    text = f"{size[0]}x{size[1]}, newest {age_ms:.0f} ms old"
    if age_ms > _OLD_MS:
        yield warning("pictures", text, "free the cores; look at the source's rate")
    else:
        yield ok("pictures", text)
    if video.source == "sim":
        yield from fits(size, calibration)


def plausible(calibration: CameraConfig) -> Finding:
    """Whether focal lengths, principal point and distortion can be those of a camera."""
    c = calibration
    view_deg = math.degrees(2 * math.atan(c.width / 2 / c.fx_px))
    off = max(abs(c.cx_px - (c.width - 1) / 2) / c.width, abs(c.cy_px - (c.height - 1) / 2) / c.height)
    doubts = []
    if not 20.0 <= view_deg <= 150.0:
        doubts.append(f"a view of {view_deg:.0f}°, expected 20° to 150°")
    if abs(c.fx_px / c.fy_px - 1.0) > 0.1:
        doubts.append(f"fx_px / fy_px = {c.fx_px / c.fy_px:.2f}, expected about 1")
    if off > 0.15:
        doubts.append(f"a principal point {off:.0%} off the middle, expected less than 15 %")
    if max(map(abs, c.distortion)) > 2.0:
        doubts.append(f"a distortion of {max(map(abs, c.distortion)):.1f}, expected less than 2")
    if doubts:
        return warning("calibration", "; ".join(doubts), "calibrate again, or correct [camera.down]")
    return ok("calibration", f"{c.width}x{c.height}, view {view_deg:.0f}°, plausible")


def source(path: str, calibration: CameraConfig) -> Iterator[Finding]:
    """Whether a camera is there, or a video file or image folder opens and fits the calibration."""
    try:
        if is_live(path):
            check_live(path)
            yield ok("video source", f"{without_password(path)}: the camera node opens it, and waits for a stream")
            return
        file = FileSource(path, loop=False)
    except ConfigError as error:
        yield from_error("video source", error)
        return
    try:
        yield ok("video source", f"{path} opens, {file.width}x{file.height}")
        yield from fits((file.width, file.height), calibration)
    finally:
        file.close()


def fits(size: tuple[int, int], calibration: CameraConfig) -> Iterator[Finding]:
    """Findings for pictures of another size (columns, rows, px) than the calibration's."""
    width, height = size
    if size == (calibration.width, calibration.height):
        return
    text = f"pictures are {width}x{height}, the calibration is for {calibration.width}x{calibration.height}"
    cure = "calibrate at the size of the pictures and correct [camera.down]"
    if abs(width / height / (calibration.width / calibration.height) - 1.0) > 0.01:
        yield fault("picture size", f"{text}: another shape", cure)
    else:
        yield warning("picture size", f"{text}: scaled to fit", cure)
