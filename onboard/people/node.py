"""The node `people`: pictures and depth in; who is there, where, and what they look like out."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator

import cv2
import numpy as np

from common.config import Config, ConfigError
from common.geometry.config import CamerasConfig
from common.geometry.depth import in_mm
from common.geometry.rotation import as_vec3
from common.header import Received
from common.messages import (
    Image,
    Obstacle,
    Obstacles,
    PeopleDetections,
    PersonDetection,
    VehicleState,
    person_label,
)
from common.node import CommandCall, Inputs, Node, On, Output
from common.topics import CAMERAS
from onboard.people.detector import PersonDetector
from onboard.people.findings import Findings, Found, Frame
from onboard.people.pairing import Pairing
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.portraits import Portraits
from onboard.people.pose_file import pose_network
from onboard.people.pose_network import PoseNetwork
from onboard.people.roll import ORDERS, Roll, triangle
from onboard.people.sights import VehiclePose
from onboard.proximity.pose import PoseTrack

log = logging.getLogger(__name__)
_STEP_S = 0.1
_ROLL_PERIOD_NS = 190_000_000
_PICTURE_PERIOD_NS = 950_000_000
_SEEN_NS = 1_000_000_000
_STATE = "helm/state"


class PeopleNode(Node):
    """Searches the pictures of the camera that `people.camera` names; without one it has nothing to do.

    Args:
        config: sections `people` and `camera`.
        name: node name.
        network: finds joints; by default the one that `people.pose_model` names.
        clock: seconds, for the poses' budget and the stages' times.

    Raises:
        ConfigError: the vehicle has no such camera, or a network's file is missing or wrong.
    """

    inputs = (*(f"camera/{name}/{kind}" for name in CAMERAS for kind in ("raw", "depth")), _STATE)
    outputs = ("people/detections", "people/tracks", "people/pictures", "obstacles/people")
    commands = ORDERS
    trigger = On(inputs[:-1], at_least_every_s=_STEP_S)

    def __init__(
        self,
        config: Config,
        name: str,
        network: PoseNetwork | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ):
        super().__init__(config, name)
        cv2.setNumThreads(1)
        self._config = config.section(PeopleConfig)
        camera = self._config.camera
        cameras = config.section(CamerasConfig).by_name()
        if not camera:
            self.inputs, self.trigger, self.commands = (), On(()), ()
            log.info("people.camera names no camera: nothing to do")
            return
        if camera not in cameras:
            raise ConfigError(
                f"people.camera: got {camera!r}, which this vehicle has not; expected one of: {', '.join(cameras)}"
            )
        self._colour, self._depth = cameras[camera].camera(), cameras[camera].depth_camera()
        with_depth = self._config.use_depth and self._depth is not None
        self._raw_topic, self._depth_topic = f"camera/{camera}/raw", f"camera/{camera}/depth"
        pictures = (self._raw_topic, self._depth_topic) if with_depth else (self._raw_topic,)
        self.inputs = (*pictures, _STATE)
        self.trigger = On(pictures, at_least_every_s=_STEP_S)
        detector = None if self._config.detector is None else PersonDetector(self._config.detector)
        depth = None if self._depth is None else self._depth.camera
        network = network or pose_network(self._config.pose_model)
        self._pipeline = PeoplePipeline(self._config, self._colour, depth, network, detector, clock)
        self._sizes = (
            (self._colour.width, self._colour.height),
            None if depth is None else (depth.width, depth.height),
        )
        self._roll = Roll(self._pipeline)
        self._portraits = Portraits(self._config.picture_px)
        self._pairing = Pairing(self._config.pair_ms, self._config.wait_ms, with_depth)
        self._poses = PoseTrack()
        self._heard: dict[str, Received[Image]] = {}
        self._findings = Findings((), False, "no picture yet")
        self._looked_ns = 0
        self._roll_ns = self._picture_ns = 0
        self._counts: Counter[str] = Counter()
        self._stage_ms: dict[str, float] = {}

    @property
    def findings(self) -> Findings:
        """What the newest picture showed."""
        return self._findings

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """What the newest pair of pictures shows; the roll and pictures of people now and then."""
        if not self._config.camera:
            return
        for received in inputs.drain(_STATE, VehicleState):
            self._poses.add(received.header.capture_ns, received.message)
        self._hear(inputs)
        pair = self._pairing.take(t_ns)
        if pair is not None:
            yield from self._look(*pair, t_ns)
        yield from self._tell(t_ns)

    def on_command(self, call: CommandCall, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Rename, merge or dismiss somebody; the roll goes out at once."""
        reply = self._roll.obey(call.name, call.command)
        log.info("%s by %s: %s: %s", call.name, call.client, reply.outcome, reply.reason)
        call.reply(reply)
        self._roll_ns = 0
        return self._tell(t_ns)

    def metrics(self) -> dict[str, float]:
        """Pictures so far, how many of them without depth or pose, looks for poses, and how long the stages take."""
        if not self._config.camera:
            return {}
        counts = {name: float(self._counts[name]) for name in ("pictures", "without_depth", "without_pose", "looks")}
        seen = float(len(self._findings.people))
        return {**counts, "people_seen": seen, **{f"{name}_ms": ms for name, ms in self._stage_ms.items()}}

    def _hear(self, inputs: Inputs) -> None:
        for topic, add in (
            (self._raw_topic, self._pairing.add_colour),
            (self._depth_topic, self._pairing.add_depth),
        ):
            if topic not in self.inputs:
                continue
            received = inputs.peek(topic, Image)
            if received is None or received is self._heard.get(topic):
                continue
            self._heard[topic] = received
            if inputs.latest(topic, Image) is not None:  # not too old
                add(received)

    def _look(self, colour: Received[Image], depth: Received[Image] | None, t_ns: int) -> Iterator[Output]:
        capture_ns = colour.header.capture_ns
        image = colour.message
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, -1)
        self._fit(image, None if depth is None else depth.message)
        pose = self._poses.at(capture_ns)
        vehicle = None if pose is None else VehiclePose(pose.ned_p_m, pose.ned_q_body)
        frame = Frame(
            pixels,
            capture_ns,
            None if depth is None else in_mm(depth.message),
            None if depth is None else depth.header.capture_ns,
            vehicle,
        )
        findings = self._pipeline.look(frame)
        self._note(findings, vehicle is not None)
        self._looked_ns = t_ns
        for found in findings.people:
            if found.fresh:
                self._portraits.see(found, pixels, capture_ns)
        yield Output("people/detections", self._detections(findings, image), capture_ns)
        if vehicle is not None:
            yield Output("obstacles/people", self._obstacles(findings, vehicle, capture_ns), capture_ns)

    def _fit(self, colour: Image, depth: Image | None) -> None:
        """Scale the calibration to pictures of another size than the vehicle's file says."""
        sizes = (
            (colour.width, colour.height),
            self._sizes[1] if depth is None or self._depth is None else (depth.width, depth.height),
        )
        if sizes == self._sizes:
            return
        log.warning("the pictures are %dx%d px, depth %s: the calibration is scaled to fit", *sizes[0], sizes[1])
        self._sizes = sizes
        fitted = None if self._depth is None or sizes[1] is None else self._depth.camera.resized(*sizes[1])
        self._pipeline.fit(self._colour.resized(*sizes[0]), fitted)

    def _note(self, findings: Findings, with_pose: bool) -> None:
        self._counts.update(
            pictures=1, without_depth=not findings.with_depth, without_pose=not with_pose, looks=findings.looks
        )
        for name, ms in findings.stage_ms.items():
            self._stage_ms[name] = self._stage_ms.get(name, ms) + 0.1 * (ms - self._stage_ms.get(name, ms))
        if bool(findings.reason) != bool(self._findings.reason):
            if findings.reason:
                log.warning("people: %s", findings.reason)
            else:
                log.info("people: searching with depth and pose")
        self._findings = findings

    def _tell(self, t_ns: int) -> Iterator[Output]:
        """The roll, and a picture of somebody, when they are due."""
        if t_ns - self._roll_ns >= _ROLL_PERIOD_NS:
            self._roll_ns = t_ns
            now = t_ns - self._looked_ns < _SEEN_NS
            shown = {found.number for found in self._findings.people} if now else set()
            yield Output("people/tracks", self._roll.people(shown, t_ns))
        if t_ns - self._picture_ns >= _PICTURE_PERIOD_NS:
            self._picture_ns = t_ns
            tracks = self._pipeline.tracks
            self._portraits.keep({track.number for track in tracks})
            picture = self._portraits.next({t.number for t in tracks if t.confirmed and not t.dismissed})
            if picture is not None:
                yield Output("people/pictures", picture, picture.taken_ns)

    def _detections(self, findings: Findings, image: Image) -> PeopleDetections:
        return PeopleDetections(
            camera=image.camera,
            width=image.width,
            height=image.height,
            people=tuple(detection(found, findings.with_depth) for found in findings.people),
            with_depth=findings.with_depth,
            reason=findings.reason,
        )

    def _obstacles(self, findings: Findings, vehicle: VehiclePose, t_ns: int) -> Obstacles:
        """Those who are believed, at their nearest points, with the velocity that they walk at."""
        believed = {track.number for track in self._pipeline.tracks if track.confirmed}
        obstacles = []
        for found in findings.people:
            if found.number not in believed or found.sight.ned_nearest_m is None:
                continue
            offset = found.sight.ned_nearest_m - vehicle.ned_p_m
            distance_m = float(np.linalg.norm(offset))
            obstacles.append(
                Obstacle(
                    distance_m=distance_m,
                    ned_direction=as_vec3(offset / max(distance_m, 1e-6)),
                    ned_v_m_s=as_vec3(self._pipeline.walks.ned_v_m_s(found.number, t_ns)),
                    label=person_label(found.number),
                )
            )
        return Obstacles(obstacles=tuple(obstacles))


def detection(found: Found, with_depth: bool) -> PersonDetection:
    """Message of a person in a picture."""
    sight, region = found.sight, found.sight.region
    joints = np.column_stack((found.pose.joints_px, found.pose.confidence)).tolist()
    size = (region.length_m, region.width_m, region.height_m)
    x, y, width, height = found.box_px
    return PersonDetection(
        number=found.number,
        box_px=(float(x), float(y), float(width), float(height)),
        joints_px=tuple((u, v, c) for u, v, c in joints),
        presence=found.pose.presence,
        fresh=found.fresh,
        with_depth=with_depth,
        ned_p_m=None if sight.ned_p_m is None else as_vec3(sight.ned_p_m),
        ned_p_cov_m2=None if sight.ned_p_cov_m2 is None else triangle(sight.ned_p_cov_m2),
        camera_p_m=region.camera_p_m,
        size_m=None if None in size else as_vec3([side or 0.0 for side in size]),
    )
