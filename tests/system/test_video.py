"""Real pictures, no flight: a video file through camera node, Zenoh and tracker, against boxes drawn by hand."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable

import numpy as np

from benchmarks.sample_video import sample_video
from common.header import Received
from common.messages import Command, Track
from tests.replay.test_vtest_person import BOXES
from tests.system.flight import Seen
from tests.system.stack import Stack

LENGTH = 795
"""Frames of the video; it begins again at its end."""


def _frame(picture: Received) -> int:
    """Number of a picture in the video: the camera sends each frame that it reads, so its sequence tells."""
    return picture.header.seq % LENGTH


def test_person_is_tracked_over_zenoh(make_stack: Callable[..., Stack]) -> None:
    rows = [line for line in BOXES.read_text().splitlines() if not line.startswith("#")]
    boxes = {int(r["frame"]): tuple(float(r[k]) for k in "xywh") for r in csv.DictReader(rows)}
    first, last = min(boxes), max(boxes)
    stack = make_stack(f"video.source={sample_video()}")
    stack.start("ground", "--without", "console")
    bus = stack.bus()
    pictures, tracks = Seen(bus, "camera/down/jpeg"), Seen(bus, "pursuit/track")
    stack.start("onboard", "--without", "helm")

    def wait_for_frame(number: int, limit_s: float) -> Received:
        deadline = time.monotonic() + limit_s
        while True:
            if pictures.all and number <= _frame(pictures.all[-1]) < number + 3:
                return next(p for p in reversed(pictures.all) if _frame(p) == number)
            assert time.monotonic() < deadline, f"frame {number} did not come; {stack.logs()}"
            time.sleep(0.005)

    drawn_on = wait_for_frame(first, 60)
    reply = bus.query("pursuit/do/select", Command(box_px=boxes[first], capture_ns=drawn_on.header.capture_ns))  # type: ignore[arg-type]
    assert reply.outcome == "done", reply
    wait_for_frame(last + 1, 60)

    frame_of = {p.header.capture_ns: _frame(p) for p in pictures.all}
    overlaps, offsets = [], []
    for received in tracks.since(drawn_on.received_ns):
        frame = frame_of.get(received.header.capture_ns, -1)
        track: Track = received.message
        if frame in boxes and frame > first and track.state != "idle":
            x, y, w, h = boxes[frame]
            assert track.reason.startswith("no vehicle state")
            offsets.append(float(np.hypot(track.x_px - x - w / 2, track.y_px - y - h / 2)))
            left, right = max(x, track.x_px - track.width_px / 2), min(x + w, track.x_px + track.width_px / 2)
            top, bottom = max(y, track.y_px - track.height_px / 2), min(y + h, track.y_px + track.height_px / 2)
            shared = max(0.0, right - left) * max(0.0, bottom - top)
            overlaps.append(shared / (w * h + track.width_px * track.height_px - shared))
    assert len(overlaps) == len(boxes) - 1
    assert np.mean(overlaps) > 0.45, np.round(overlaps, 2)
    assert np.median(offsets) < 8.0, np.round(offsets, 1)
