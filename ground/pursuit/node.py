"""The pursuit node: pictures in, the target's track and a request for motion out."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Iterable

import cv2
import numpy as np

from common.config import Config
from common.geometry.camera import Camera
from common.geometry.rotation import slerp
from common.messages import CameraInfo, Image, Reply, Request, Track, VehicleState
from common.node import CommandCall, Inputs, Node, On, Output, Received
from common.tracking.base import TrackResult
from common.tracking.config import ParticleFilterConfig
from common.tracking.particle_filter import ParticleFilterTracker
from ground.pursuit.config import PursuitConfig
from ground.pursuit.control import ChaseLaw, Pose, look

log = logging.getLogger(__name__)
_PICTURES = "camera/down/jpeg"
_FURTHEST_AHEAD_NS = 300_000_000
_KEPT_PICTURES = 20


class PursuitNode(Node):
    """Tracks the selected target in each picture and asks helm for the motion that keeps it below the vehicle."""

    inputs = (_PICTURES, "camera/down/info", "helm/state")
    outputs = ("pursuit/track", "helm/request/pursuit")
    commands = ("pursuit/do/select", "pursuit/do/stop")
    trigger = On((_PICTURES,))

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        cv2.setNumThreads(1)
        self._config = config.section(PursuitConfig)
        self._tracker_config = config.section(ParticleFilterConfig)
        self._law = ChaseLaw(self._config)
        self._tracker: ParticleFilterTracker | None = None
        self._camera: Camera | None = None
        self._states: deque[Received[VehicleState]] = deque()
        self._pictures: deque[tuple[int, bytes]] = deque(maxlen=_KEPT_PICTURES)
        self._corrupt = 0

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """One picture: track, look, ask."""
        self._take_states(inputs)
        info = inputs.peek("camera/down/info", CameraInfo)
        if info is not None and info.message != self._camera_info:
            self._camera, self._camera_info = Camera.from_info(info.message), info.message
        received = inputs.latest(_PICTURES, Image)
        if received is None:
            return ()
        capture_ns = received.header.capture_ns
        self._pictures.append((capture_ns, received.message.data))
        if self._tracker is None:
            return [Output("pursuit/track", Track(state="idle", reason="no target"), capture_ns)]
        frame = self._decoded(received.message.data)
        if frame is None:
            return ()
        pose, why_not = self._pose(capture_ns)
        if pose is not None and self._camera is not None:
            expected = self._law.expected(self._camera, pose, capture_ns)
            if expected is not None:
                self._tracker.expect(*expected)
        try:
            result = self._tracker.update(frame, capture_ns)
        except ValueError as error:
            self._stop()
            log.warning("the target is dropped: %s", error)
            return [Output("pursuit/track", Track(state="idle", reason=str(error)), capture_ns)]
        return self._outputs(result, capture_ns, pose, why_not)

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """`select` a target by its box, or `stop`."""
        if call.name == "pursuit/do/stop":
            self._stop()
            call.reply(Reply(outcome="done"))
        else:
            call.reply(self._select(call))
        return ()

    def metrics(self) -> dict[str, float]:
        """Pictures that could not be decoded."""
        return {"corrupt_pictures": self._corrupt}

    _camera_info: CameraInfo | None = None

    def _stop(self) -> None:
        self._tracker = None
        self._law.reset()

    def _select(self, call: CommandCall) -> Reply:
        box = call.command.box_px
        if box is None:
            return Reply(outcome="refused", reason="select: got no box, expected x, y, width, height in px")
        if not self._pictures:
            return Reply(outcome="refused", reason="select: no picture has come yet; is the camera node running?")
        wanted_ns = call.command.capture_ns or self._pictures[-1][0]
        capture_ns, data = min(self._pictures, key=lambda p: abs(p[0] - wanted_ns))
        frame = self._decoded(data)
        if frame is None:
            return Reply(outcome="failed", reason="select: the picture cannot be decoded; draw the box again")
        tracker = ParticleFilterTracker(self._tracker_config, np.random.default_rng(self._config.seed))
        try:
            tracker.init(frame, box, call.command.angle_rad, capture_ns)
        except ValueError as error:
            return Reply(outcome="refused", reason=f"select: {error}")
        self._law.reset()
        self._tracker = tracker
        # Pictures that came since the one with the box: the tracker catches up before the next step.
        for later_ns, later in [p for p in self._pictures if p[0] > capture_ns]:
            later_frame = self._decoded(later)
            if later_frame is not None and later_frame.shape == frame.shape:
                tracker.update(later_frame, later_ns)
        return Reply(outcome="done")

    def _decoded(self, data: bytes) -> np.ndarray | None:
        frame = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        if frame is None:
            self._corrupt += 1
        return frame

    def _outputs(self, result: TrackResult, capture_ns: int, pose: Pose | None, why_not: str) -> list[Output]:
        seen = result.state == "tracking"
        error, error_m, request = (0.0, 0.0), 0.0, None
        if pose is not None and self._camera is not None:
            view = look(self._camera, pose, result.center_px, result.angle_rad, self._config.target_height_m)
            if view is not None:
                error, error_m = _in_heading_frame(view.tangents, pose), float(np.linalg.norm(view.relative_m))
            if seen and view is not None and not result.repeated:
                wish = self._law.follow(view, pose, capture_ns, result.angle_std_rad)
            else:
                why_not = "" if seen else "target not seen: coasting, then standing"
                wish = self._law.coast(pose, capture_ns)
            request = Request(
                frame="ned",
                vector=(float(wish.ned_v_m_s[0]), float(wish.ned_v_m_s[1]), 0.0),
                yaw_rate_rad_s=wish.yaw_rate_rad_s,
            )
        track = Track(
            state="tracking" if seen else "lost",
            x_px=float(result.center_px[0]),
            y_px=float(result.center_px[1]),
            width_px=float(result.size_px[0]),
            height_px=float(result.size_px[1]),
            angle_rad=float(result.angle_rad),
            distance=1.0 - float(result.score),
            distance_limit=1.0 - float(result.score_limit),
            error=error,
            error_m=error_m,
            reason=why_not,
        )
        outputs = [Output("pursuit/track", track, capture_ns)]
        if request is not None:
            outputs.insert(0, Output("helm/request/pursuit", request, capture_ns))
        return outputs

    def _take_states(self, inputs: Inputs) -> None:
        self._states.extend(inputs.drain("helm/state", VehicleState))
        while self._states and (
            self._states[-1].header.capture_ns - self._states[0].header.capture_ns > self._config.history_s * 1e9
        ):
            self._states.popleft()

    def _pose(self, capture_ns: int) -> tuple[Pose | None, str]:
        """Vehicle at a capture time, between the two states around it, or why there is none."""
        if self._camera is None:
            return None, "no calibration of the camera"
        if not self._states or capture_ns - self._states[-1].header.capture_ns > _FURTHEST_AHEAD_NS:
            return None, "no vehicle state"
        after = next((i for i, s in enumerate(self._states) if s.header.capture_ns >= capture_ns), None)
        if after is None or after == 0:
            nearest = self._states[-1 if after is None else 0]
            return _extrapolated(nearest, capture_ns), ""
        a, b = self._states[after - 1], self._states[after]
        span_ns = b.header.capture_ns - a.header.capture_ns
        share = (capture_ns - a.header.capture_ns) / span_ns if span_ns else 0.0
        mix = lambda x, y: np.array(x) + share * (np.array(y) - np.array(x))  # noqa: E731
        return Pose(
            mix(a.message.ned_p_m, b.message.ned_p_m),
            mix(a.message.ned_v_m_s, b.message.ned_v_m_s),
            slerp(a.message.ned_q_body, b.message.ned_q_body, share),
        ), ""


def _extrapolated(state: Received[VehicleState], capture_ns: int) -> Pose:
    from common.geometry.rotation import quat_exp, quat_multiply

    ahead_s = (capture_ns - state.header.capture_ns) / 1e9
    velocity = np.array(state.message.ned_v_m_s)
    turned = quat_multiply(state.message.ned_q_body, quat_exp(np.array(state.message.body_rates_rad_s) * ahead_s))
    return Pose(np.array(state.message.ned_p_m) + ahead_s * velocity, velocity, turned)


def _in_heading_frame(tangents: np.ndarray, pose: Pose) -> tuple[float, float]:
    """North and east tangents as forward and right."""
    w, x, y, z = pose.ned_q_body
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    north, east = tangents
    return (float(north * math.cos(yaw) + east * math.sin(yaw)), float(east * math.cos(yaw) - north * math.sin(yaw)))
