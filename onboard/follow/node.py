"""The follow node: pictures in, the fused target and a request for motion out, all on the vehicle."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from common.config import Config
from common.geometry.camera import Camera
from common.geometry.config import CamerasConfig
from common.geometry.rotation import euler_from_quat
from common.header import Received
from common.messages import (
    CameraInfo,
    FollowMembers,
    HelmStatus,
    Image,
    MemberBox,
    Reply,
    Setpoint,
    Track,
    VehicleState,
)
from common.node import CommandCall, Inputs, Node, On, Output
from common.tracking.base import Box, center_of, size_of, upright_around
from onboard.follow.choice import Choice, Picture, Pictures
from onboard.follow.config import FollowConfig
from onboard.helm.config import HelmConfig
from onboard.proximity.pose import PoseTrack

if TYPE_CHECKING:
    from onboard.follow.follower import Follower

log = logging.getLogger(__name__)
_MADE_S = 15.0
"""How long the end waits for trackers that are just coming up, s."""
_TOLD_NS = 200_000_000
"""How often it is told that nothing is followed, ns."""
_MEMBERS_NS = 90_000_000
"""How often the trackers' own boxes are told, ns: ten times a second at 20 Hz, for a page."""
_SAME_MOMENT_NS = 60_000_000
"""How far apart a picture and its depth picture may be, ns: a picture's period at 15 Hz."""
_SENT_NS = 300_000_000
"""How old a setpoint of helm's may be to be what the vehicle flies, ns."""


class FollowNode(Node):
    """Follows what the operator chose for it, or, beside a chase, what the chase follows, so that it can take over.

    Its trackers are processes of their own, begun with the first target, or at once where helm is to hand over to it.

    Args:
        config: all sections.
        name: node name.
    """

    outputs = ("helm/request/follow", "follow/track", "follow/members")
    commands = ("follow/do/select", "follow/do/stop")

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        self._settings = config.section(FollowConfig)
        self._beside_chase = config.section(HelmConfig).follow_on_link_loss
        camera = self._settings.camera
        section = config.section(CamerasConfig).by_name()[camera]
        self._camera: Camera = section.camera()
        self._camera_info: CameraInfo | None = None
        self._raw, self._info = f"camera/{camera}/raw", f"camera/{camera}/info"
        self._depth = f"camera/{camera}/depth" if section.depth is not None else None
        self.inputs = (
            self._raw,
            self._info,
            "helm/state",
            "helm/status",
            "helm/setpoint",
            "pursuit/track",
            *([self._depth] if self._depth else []),
        )
        self.trigger = On((self._raw,), at_least_every_s=0.1)
        self._follower: Follower | None = None
        self._coming: Future[Follower] | None = None
        self._pictures = Pictures()
        self._choice: Choice | None = None
        self._poses = PoseTrack()
        self._state: VehicleState | None = None
        self._sent: Received[Setpoint] | None = None
        self._taken: Received[Image] | None = None
        self._chosen = False
        """Whether the operator chose the target; else it is the chase's."""
        self._apart_ns: int | None = None
        self._told_ns = self._members_ns = 0

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """One picture: track, look, ask."""
        for received in inputs.drain("helm/state", VehicleState):
            self._poses.add(received.header.capture_ns, received.message)
            self._state = received.message
        for sent in inputs.drain("helm/setpoint", Setpoint):
            self._sent = sent
        if self._beside_chase:
            self._begin()
        self._meet()
        picture = self._new_picture(inputs)
        if self._choice is not None:
            self._advance(t_ns)
            return self._idle(t_ns)
        if picture is None or self._follower is None:
            return self._idle(t_ns)
        follower, (capture_ns, frame) = self._follower, picture
        info = inputs.peek(self._info, CameraInfo)
        if info is not None and info.message != self._camera_info:
            self._camera_info = info.message
            follower.calibrate(Camera.from_info(info.message))
        if self._beside_chase and not self._chosen:
            self._beside(follower, inputs)
        if not follower.active:
            return self._idle(t_ns)
        status = inputs.peek("helm/status", HelmStatus)
        if status is None or status.message.source != "follow":
            follower.unobeyed(*_velocity(self._sent, capture_ns))
        return self._follow(follower, inputs, frame, capture_ns)

    def _follow(self, follower: Follower, inputs: Inputs, frame: np.ndarray, capture_ns: int) -> Iterable[Output]:
        from onboard.follow.law import Vehicle

        pose, vehicle = self._poses.at(capture_ns), None
        if pose is not None and self._state is not None:
            yaw_rad = euler_from_quat(pose.ned_q_body)[2]
            rate = self._state.body_rates_rad_s[2]
            vehicle = Vehicle(pose.ned_p_m, np.array(self._state.ned_v_m_s), yaw_rad, rate)
        try:
            followed = follower.step(frame, capture_ns, pose, vehicle, self._depth_at(inputs, capture_ns))
        except ValueError as error:
            follower.drop()
            log.warning("the target is dropped: %s", error)
            return [Output("follow/track", Track(state="idle", reason=str(error)), capture_ns)]
        outputs = [Output("follow/track", followed.track, capture_ns)]
        if capture_ns - self._members_ns >= _MEMBERS_NS:
            self._members_ns = capture_ns
            boxes = follower.fusion.member_boxes(capture_ns).items()
            said = tuple(MemberBox(name=name, box_px=box) for name, box in boxes)
            outputs.append(
                Output("follow/members", FollowMembers(camera=self._settings.camera, members=said), capture_ns)
            )
        if followed.request is not None:
            outputs.insert(0, Output("helm/request/follow", followed.request, capture_ns))
        return outputs

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """`select` a target by its box, or `stop`."""
        if self._choice is not None:
            self._choice.supersede(self._follower, f"{call.name} from {call.client}")
            self._choice = None
        if call.name == "follow/do/stop":
            self._chosen = False
            if self._follower is not None:
                self._follower.drop()
            call.reply(Reply(outcome="done", reason="nothing is followed now"))
            return ()
        box = call.command.box_px
        if box is None:
            call.reply(Reply(outcome="refused", reason="select: got no box, expected x, y, width, height in px"))
            return ()
        self._new_picture(inputs)
        try:
            pictures = self._pictures.since(call.command.capture_ns)
        except ValueError as error:
            call.reply(Reply(outcome="refused", reason=f"select: {error}"))
            return ()
        self._begin()
        self._choice, self._chosen = Choice(call, box, pictures, t_ns), True
        self._advance(t_ns)
        return ()

    def _advance(self, t_ns: int) -> None:
        """Go on with the choice; forget it once it is answered."""
        if self._choice is not None and self._choice.advance(self._follower, t_ns):
            self._choice = None
            self._chosen = self._follower is not None and self._follower.active

    def _new_picture(self, inputs: Inputs) -> Picture | None:
        """The newest picture, kept; None when it was taken already."""
        received = inputs.latest(self._raw, Image)
        if received is None or received is self._taken:
            return None
        self._taken = received
        shape = (received.message.height, received.message.width, 3)
        picture = Picture(received.header.capture_ns, np.frombuffer(received.message.data, np.uint8).reshape(shape))
        self._pictures.keep(picture)
        if self._choice is not None:
            self._choice.add(picture)
        return picture

    def metrics(self) -> dict[str, float]:
        """Answers that came late, and of each tracker how often it was begun anew and its process."""
        if self._follower is None:
            return {}
        fusion = self._follower.fusion
        per_member = {f"restarts_{n}": float(m.restarts) for n, m in fusion.pool.members.items()}
        pids = {f"pid_{n}": float(m.pid) for n, m in fusion.pool.members.items()}
        return {"late_answers": float(fusion.late), **per_member, **pids}

    def close(self) -> None:
        """End the trackers."""
        if self._coming is not None:
            self._coming.result(_MADE_S).close()
        if self._follower is not None:
            self._follower.close()

    def _begin(self) -> None:
        """Have the trackers come up, beside the loop: on a busy machine it takes seconds."""
        if self._follower is None and self._coming is None:
            maker = ThreadPoolExecutor(1, "follow-begin")
            self._coming = maker.submit(_made, self.config, self._camera)
            maker.shutdown(wait=False)

    def _meet(self) -> None:
        """Take the follower that `_begin` had made, once it is.

        Raises:
            ConfigError: it could not be made.
        """
        if self._coming is not None and self._coming.done():
            coming, self._coming = self._coming, None
            self._follower = coming.result()

    def _idle(self, t_ns: int) -> Iterable[Output]:
        active = self._follower is not None and self._follower.active
        if active or t_ns - self._told_ns < _TOLD_NS:
            return ()
        self._told_ns = t_ns
        reason = "no target" if self._choice is None else "the trackers start"
        return [
            Output("follow/track", Track(state="idle", reason=reason)),
            Output("follow/members", FollowMembers(camera=self._settings.camera)),
        ]

    def _depth_at(self, inputs: Inputs, capture_ns: int) -> np.ndarray | None:
        """Depth picture of that moment, (h, w), m; None without one."""
        received = inputs.latest(self._depth, Image) if self._depth else None
        if received is None or abs(received.header.capture_ns - capture_ns) > _SAME_MOMENT_NS:
            return None
        message = received.message
        return np.frombuffer(message.data, "<u2").reshape(message.height, message.width) / 1e3

    def _beside(self, follower: Follower, inputs: Inputs) -> None:
        """Track what the chase tracks: begin on it, and anew when the two have been apart for long."""
        received = inputs.latest("pursuit/track", Track)
        if received is None or received.message.state != "tracking":
            self._apart_ns = None
            return
        track, capture_ns = received.message, received.header.capture_ns
        corner = track.x_px - track.width_px / 2, track.y_px - track.height_px / 2
        box = upright_around((*corner, track.width_px, track.height_px), track.angle_rad)
        if follower.active and not _apart(follower.fusion.box, box, self._settings.hand_over_gap):
            self._apart_ns = None
            return
        if follower.active:
            self._apart_ns = self._apart_ns or capture_ns
            if capture_ns - self._apart_ns < self._settings.hand_over_after_s * 1e9:
                return
        if not follower.fusion.pool.await_ready(0.0):
            return
        try:
            follower.select(self._pictures.since(capture_ns)[0], box, 0.0)
        except ValueError as error:
            log.info("beside the chase: %s", error)
        self._apart_ns = None


def _made(config: Config, camera: Camera) -> Follower:
    # Imported here: on a vehicle that follows nothing, filters and trackers would cost a second and 100 MB.
    from onboard.follow.follower import Follower

    return Follower(config, camera)


def _velocity(sent: Received[Setpoint] | None, t_ns: int) -> tuple[np.ndarray | None, int]:
    """Velocity that helm sent to the autopilot of late, (3,), NED, m/s, and when, ns; None where it sends none."""
    if sent is None or abs(t_ns - sent.header.capture_ns) > _SENT_NS:
        return None, t_ns
    return np.array(sent.message.ned_v_m_s), sent.header.capture_ns


def _apart(mine: Box | None, theirs: Box, gap: float) -> bool:
    """Whether two boxes' centres differ by more than so many target sizes."""
    if mine is None:
        return True
    return math.dist(center_of(mine), center_of(theirs)) > gap * size_of(theirs)
