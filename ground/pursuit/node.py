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
from common.geometry.rotation import euler_from_quat
from common.messages import CameraInfo, Image, Reply, Request, Setpoint, Track, VehicleState
from common.node import CommandCall, Inputs, Node, On, Output
from common.tracking.model_picture import read_model
from common.tracking.registry import make_tracker, tracker_class
from ground.pursuit.config import PursuitConfig
from ground.pursuit.control import Wish
from ground.pursuit.history import StateHistory
from ground.pursuit.horizon import Horizon
from ground.pursuit.latency import RequestDelay
from ground.pursuit.pursuer import Pursued, Pursuer
from ground.pursuit.view import Pose

log = logging.getLogger(__name__)
_PICTURES = "camera/down/jpeg"
_KEPT_PICTURES = 40


class PursuitNode(Node):
    """Tracks the selected target in each picture and asks helm for the motion that keeps it below the vehicle.

    Raises:
        ConfigError: unknown tracker, or a picture of the target that cannot serve.
    """

    inputs = (_PICTURES, "camera/down/info", "helm/state", "helm/setpoint")
    outputs = ("pursuit/track", "helm/request/pursuit")
    commands = ("pursuit/do/select", "pursuit/do/find", "pursuit/do/reinitialise", "pursuit/do/stop")
    trigger = On((_PICTURES,))

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        cv2.setNumThreads(1)
        section = config.section(PursuitConfig)
        tracker_class(section.tracker)  # an unknown name is refused now, not at the first target
        self._pursuer = Pursuer(
            section, lambda: make_tracker(section.tracker, config, np.random.default_rng(section.seed))
        )
        self._model = read_model(section.model, "pursuit.model") if section.model else None
        self._camera: Camera | None = None
        self._camera_info: CameraInfo | None = None
        self._states = StateHistory(section.history_s, Horizon(section.attitude_doubt_rad, section.attitude_doubt_s))
        self._delay = RequestDelay(section.request_delay_s)
        self._pictures: deque[tuple[int, bytes]] = deque(maxlen=_KEPT_PICTURES)
        self._corrupt = self._late = 0

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """One picture: track, look, ask."""
        self._states.extend(inputs.drain("helm/state", VehicleState))
        self._delay.extend(inputs.drain("helm/setpoint", Setpoint))
        self._pursuer.delayed(self._delay.seconds)
        info = inputs.peek("camera/down/info", CameraInfo)
        if info is not None and info.message != self._camera_info:
            self._camera, self._camera_info = Camera.from_info(info.message), info.message
        received = inputs.latest(_PICTURES, Image)
        if received is None:
            return ()
        capture_ns = received.header.capture_ns
        self._pictures.append((capture_ns, received.message.data))
        if not self._pursuer.active:
            return [Output("pursuit/track", Track(state="idle", reason="no target"), capture_ns)]
        frame = self._decoded(received.message.data)
        if frame is None:
            return ()
        if self._pursuer.seeking:
            return [Output("pursuit/track", Track(state="idle", reason=self._sought(frame, capture_ns)), capture_ns)]
        pose, why_not = self._states.pose(capture_ns)
        if self._camera is None:
            why_not = "no calibration of the camera"
        try:
            pursued = self._pursuer.step(frame, capture_ns, self._camera, pose)
        except ValueError as error:
            self._pursuer.drop()
            log.warning("the target is dropped: %s", error)
            return [Output("pursuit/track", Track(state="idle", reason=str(error)), capture_ns)]
        if pursued is None:
            self._late += 1
            return ()
        return _outputs(pursued, capture_ns, pose, why_not)

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """`select` a target by its box, `find` it by its picture, `reinitialise` on it, or `stop`."""
        answers = {"select": self._select, "find": self._find, "reinitialise": self._reinitialise, "stop": self._stop}
        call.reply(answers[call.name.split("/")[-1]](call))
        return ()

    def metrics(self) -> dict[str, float]:
        """Pictures not decoded, or out of order; how often a search found the target; how long a request takes."""
        return {
            "corrupt_pictures": float(self._corrupt),
            "late_pictures": float(self._late),
            "reinitialisations": float(self._pursuer.reinitialisations),
            "request_delay_ms": 1e3 * self._delay.seconds,
        }

    def _stop(self, call: CommandCall) -> Reply:
        self._pursuer.drop()
        return Reply(outcome="done")

    def _find(self, call: CommandCall) -> Reply:
        if self._model is None:
            return Reply(
                outcome="refused",
                reason="find: got no picture of the target; set pursuit.model to an image file, or choose it by a box",
            )
        try:
            self._pursuer.seek(self._model)
        except ValueError as error:
            return Reply(outcome="refused", reason=f"find: {error}")
        return Reply(outcome="done", reason="searching; the track says when it is found")

    def _sought(self, frame: np.ndarray, capture_ns: int) -> str:
        """Look for the target of the model's picture in this one; what came of it, for the operator."""
        if not self._pursuer.find(frame, capture_ns):
            return "searching: nothing in this picture looks enough like the target"
        log.info("the target is found")
        return "found the target; it is tracked from the next picture on"

    def _reinitialise(self, call: CommandCall) -> Reply:
        if not self._pursuer.active:
            return Reply(outcome="refused", reason="reinitialise: got no target; choose one by a box, or find it")
        frame = self._decoded(self._pictures[-1][1]) if self._pictures else None
        if frame is None:
            return Reply(outcome="failed", reason="reinitialise: no picture that can be decoded; is the link up?")
        try:
            found = self._pursuer.find(frame, self._pictures[-1][0])
        except ValueError as error:
            return Reply(outcome="refused", reason=f"reinitialise: {error}")
        if not found:
            return Reply(
                outcome="failed",
                reason="reinitialise: nothing in the picture looks enough like the target; turn or climb until it is "
                "in view, or draw a new box",
            )
        return Reply(outcome="done")

    def _select(self, call: CommandCall) -> Reply:
        box, wanted_ns = call.command.box_px, call.command.capture_ns
        if box is None:
            return Reply(outcome="refused", reason="select: got no box, expected x, y, width, height in px")
        if not self._pictures:
            return Reply(outcome="refused", reason="select: no picture has come yet; is the camera node running?")
        capture_ns, data = min(self._pictures, key=lambda p: abs(p[0] - wanted_ns) if wanted_ns else -p[0])
        # Exposure delay and clocks leave a little; a picture that is no longer kept shows the target elsewhere.
        if wanted_ns and abs(capture_ns - wanted_ns) > 100_000_000:
            away_s = abs(self._pictures[-1][0] - wanted_ns) / 1e9
            return Reply(
                outcome="refused",
                reason=f"select: got a box on a picture {away_s:.1f} s from the newest one, which is not kept; "
                "draw it on the live picture",
            )
        frame = self._decoded(data)
        if frame is None:
            return Reply(outcome="failed", reason="select: the picture cannot be decoded; draw the box again")
        try:
            self._pursuer.select(frame, box, call.command.angle_rad, capture_ns)
            self._catch_up(capture_ns, frame.shape)
        except ValueError as error:
            return Reply(outcome="refused", reason=f"select: {error}")
        return Reply(outcome="done")

    def _catch_up(self, capture_ns: int, shape: tuple[int, ...]) -> None:
        """Track through the pictures that came since the one that the box was drawn on."""
        for later_ns, data in [p for p in self._pictures if p[0] > capture_ns]:
            frame = self._decoded(data)
            if frame is not None and frame.shape == shape:
                self._pursuer.step(frame, later_ns, self._camera, self._states.pose(later_ns)[0])

    def _decoded(self, data: bytes) -> np.ndarray | None:
        frame = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        if frame is None:
            self._corrupt += 1
        return frame


def _outputs(pursued: Pursued, capture_ns: int, pose: Pose | None, why_not: str) -> list[Output]:
    """The request first, where there is one: it is waited for."""
    result, view, wish = pursued.result, pursued.view, pursued.wish
    if wish is not None:
        why_not = _why_coasting(pursued)
    track = Track(
        state="tracking" if pursued.seen else "lost",
        x_px=float(result.center_px[0]),
        y_px=float(result.center_px[1]),
        width_px=float(result.size_px[0]),
        height_px=float(result.size_px[1]),
        angle_rad=float(result.angle_rad),
        distance=1.0 - float(result.score),
        distance_limit=1.0 - float(result.score_limit),
        error=_in_heading_frame(view.tangents, pose) if view is not None and pose is not None else (0.0, 0.0),
        error_m=float(np.linalg.norm(view.relative_m)) if view is not None else 0.0,
        reason=why_not,
    )
    outputs = [Output("pursuit/track", track, capture_ns)]
    if wish is not None:
        outputs.insert(0, Output("helm/request/pursuit", request_of(wish), capture_ns))
    return outputs


def _why_coasting(pursued: Pursued) -> str:
    if not pursued.seen:
        return "target not seen: coasting, then standing"
    if pursued.result.repeated:
        return "the picture repeats the one before: coasting"
    return "" if pursued.view is not None else "too low, or tilted too far, to look: coasting"


def request_of(wish: Wish) -> Request:
    """What goes to helm."""
    north, east = wish.ned_v_m_s if wish.ned_a_m_s2 is None else wish.ned_a_m_s2
    return Request(
        kind="velocity" if wish.ned_a_m_s2 is None else "acceleration",
        frame="ned",
        vector=(float(north), float(east), -wish.climb_m_s),
        yaw_rate_rad_s=wish.yaw_rate_rad_s,
    )


def _in_heading_frame(tangents: np.ndarray, pose: Pose) -> tuple[float, float]:
    """North and east tangents as forward and right."""
    yaw_rad = euler_from_quat(pose.ned_q_body)[2]
    north, east = tangents
    return (
        float(north * math.cos(yaw_rad) + east * math.sin(yaw_rad)),
        float(east * math.cos(yaw_rad) - north * math.sin(yaw_rad)),
    )
