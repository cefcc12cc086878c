"""The camera node on a real RTSP server (GStreamer's) that dies and comes back, over Zenoh."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.machine import free_ports
from tests.system.flight import Seen
from tests.system.stack import Stack

SERVER = Path(__file__).parent / "rtsp_server.py"


def _serve(port: int, width: int, height: int) -> subprocess.Popen:
    """The server, once it listens; with the system's Python, which has GStreamer's bindings."""
    server = subprocess.Popen(
        ["/usr/bin/python3", str(SERVER), str(port), str(width), str(height), "20"], stdout=subprocess.PIPE, text=True
    )
    assert server.stdout is not None
    assert server.stdout.readline() == "serving\n", "GStreamer's RTSP server is missing; run scripts/setup.sh test"
    return server


def _wait(condition: Callable[[], bool], what: str, stack: Stack, limit_s: float = 30.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s, f"no {what}; {stack.logs()}"
        time.sleep(0.02)


def test_stream_is_read_lost_and_read_again(make_stack: Callable[..., Stack]) -> None:
    port = free_ports(1)[0]
    server = _serve(port, 320, 240)
    stack = make_stack(f"video.source=rtsp://127.0.0.1:{port}/down", "video.latency_ms=60")
    try:
        stack.start("onboard", "--without", "helm")
        bus = stack.bus("onboard")
        pictures, infos, health = (
            Seen(bus, "camera/down/jpeg"),
            Seen(bus, "camera/down/info"),
            Seen(bus, "health/camera"),
        )
        _wait(lambda: len(pictures.all) > 40, "pictures", stack)
        newest = pictures.all[-1]
        assert (newest.message.width, newest.message.height) == (320, 240)
        ages_ms = [(p.received_ns - p.header.capture_ns) / 1e6 for p in pictures.all[20:40]]
        assert 60 <= np.median(ages_ms) < 200, "the configured latency, and what the node itself takes"
        gaps_ms = np.diff([p.header.capture_ns for p in pictures.all[20:40]]) / 1e6
        assert 40 < np.median(gaps_ms) < 60, "20 Hz"
        assert infos.last.fx_px == 440.0 * 320 / 640

        server.kill()
        server.wait()
        silent_since = len(pictures.all)
        _wait(lambda: "was lost; trying again" in stack.log("onboard"), "word of the loss", stack)
        assert len(pictures.all) - silent_since < 5
        server = _serve(port, 640, 480)
        _wait(lambda: bool(pictures.last) and pictures.last.width == 640, "pictures after the return", stack)
        _wait(lambda: infos.last.fx_px == 440.0, "calibration of the new size", stack)
        _wait(lambda: bool(health.last) and health.last.metrics["reconnects"] == 1, "count of the return", stack)
        assert health.last.errors == 0
    finally:
        server.kill()
        server.wait()
