"""Gathers what comes from the bus for the console's snapshots."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, TypeVar

from common.clock import ClockMap
from common.geometry.camera import Camera
from common.header import Received
from common.messages import (
    ApproachTarget,
    CameraInfo,
    FollowMembers,
    Health,
    HelmStatus,
    Image,
    LimiterStatus,
    Message,
    Obstacles,
    People,
    PeopleDetections,
    PersonPicture,
    SearchStatus,
    Session,
    Setpoint,
    Track,
    VehicleState,
)
from common.node import Inputs
from common.topics import health_topic, topic
from ground.console.snapshot import (
    APPROACH,
    DETECTIONS,
    FACES,
    FOLLOWED,
    LIMITER,
    MEMBERS,
    OBSTACLES,
    PEOPLE,
    PURSUIT_CAMERA,
    SEARCH,
    SESSION,
    SETPOINT,
    STATE,
    STATUS,
    TOPICS,
    TRACK,
    Picture,
    Snapshot,
    calibration_topic,
    picture_topic,
)

T = TypeVar("T", bound=Message)

_PICTURES_KEPT = 6  # 0.3 s at 20 Hz: the tracker answers within that, or its box is shown on a newer picture
_STATES_KEPT_NS = 2_000_000_000
_CLOCK_ALONE_NS = 3_000_000_000


class Collector:
    """Keeps what later views need beyond the newest message: recent pictures, recent states, when the target was seen.

    Args:
        nodes: nodes whose health is read.
        cameras: names of the vehicle's cameras.
        shown: camera whose pictures are kept.
    """

    def __init__(
        self, nodes: tuple[str, ...], cameras: tuple[str, ...] = (PURSUIT_CAMERA,), shown: str = PURSUIT_CAMERA
    ):
        self._nodes = nodes
        self._cameras = cameras
        self._shown_since_ns = 0
        self.shown = shown
        """Camera whose pictures are kept."""
        self.pictures: deque[Picture] = deque(maxlen=_PICTURES_KEPT)
        """Recent pictures, oldest first."""
        self._states: deque[tuple[int, VehicleState]] = deque()
        self._clock = ClockMap()
        self._clock_fed_ns = 0
        self._calibrations: dict[str, tuple[CameraInfo, Camera]] = {}
        self._tracked_ns: dict[str, int] = {}
        """When the target was last seen by pursuit and follower, by topic."""
        self._faces: dict[int, bytes] = {}
        self._vehicle_at: tuple[int, int] | None = None

    @property
    def inputs(self) -> tuple[str, ...]:
        """Topics that `collect` and `snapshot` read."""
        pictures = tuple(name(camera) for camera in self._cameras for name in (picture_topic, calibration_topic))
        return pictures + TOPICS + tuple(health_topic(name).name for name in self._nodes)

    def look_through(self, camera: str, t_ns: int) -> None:
        """Keep the pictures of another camera from now on, ns; those that came before are old."""
        if camera != self.shown:
            self.shown, self._shown_since_ns = camera, t_ns
            self.pictures.clear()

    def collect(self, inputs: Inputs) -> None:
        """Take over what has come since the last step."""
        received = inputs.peek(picture_topic(self.shown), Image)
        if received is not None and received.received_ns < self._shown_since_ns:
            received = None
        self._feed_clock(inputs, received)
        # A picture that is sent again is no new picture: a frozen camera must not look alive.
        if received is not None and (not self.pictures or received.header.capture_ns != self.pictures[-1].capture_ns):
            image = received.message
            if image.encoding == "jpeg":
                self.pictures.append(
                    Picture(
                        image.data,
                        image.width,
                        image.height,
                        received.header.capture_ns,
                        received.received_ns,
                        self._local_ns(received),
                    )
                )
        while self._states and self._states[0][0] < self._states[-1][0] - _STATES_KEPT_NS:
            self._states.popleft()
        inputs.drain(SETPOINT, Setpoint)  # the newest is what counts here
        for received_face in inputs.drain(FACES, PersonPicture):
            face = received_face.message
            self._faces = {**self._faces, face.number: face.jpeg}  # a snapshot may still show the old ones
        for name in (TRACK, FOLLOWED):
            track = inputs.peek(name, Track)
            if track is not None and track.message.state == "tracking":
                self._tracked_ns[name] = track.received_ns

    def _feed_clock(self, inputs: Inputs, picture: Received[Image] | None) -> None:
        """Learn the vehicle's clock from its states: they are small and go first, so they know what the link costs.

        Pictures may wait behind one another on a slow link; by their own arrivals a picture that is seconds old would
        look new. They count only where there is no helm.
        """
        for received in inputs.drain(STATE, VehicleState):
            self._clock.update(received.header.capture_ns, received.received_ns)
            self._clock_fed_ns = received.received_ns
            self._vehicle_at = received.header.capture_ns, received.received_ns
            self._states.append((received.header.capture_ns, received.message))
        if picture is not None and picture.received_ns - self._clock_fed_ns > _CLOCK_ALONE_NS:
            self._clock.update(picture.header.capture_ns, picture.received_ns)

    def _local_ns(self, received: Received[Any]) -> int:
        """Capture of a message in the console's clock, ns; its arrival while the vehicle's clock is unknown."""
        local_ns = self._clock.to_local(received.header.capture_ns)
        return received.received_ns if local_ns is None else min(local_ns, received.received_ns)

    def state_at(self, capture_ns: int) -> VehicleState | None:
        """State whose stamp is nearest to an instant (vehicle clock); None without any within 0.2 s."""
        states = list(self._states)  # the server's threads ask as well
        if not states:
            return None
        stamp, state = min(states, key=lambda item: abs(item[0] - capture_ns))
        return state if abs(stamp - capture_ns) <= 200_000_000 else None

    def snapshot(self, inputs: Inputs, t_ns: int, alive: Mapping[str, int] | None) -> Snapshot:
        """All that is known now.

        Args:
            inputs: of the step.
            t_ns: now.
            alive: processes of each live node.
        """
        ages: dict[str, float] = {}

        def newest(name: str, kind: type[T]) -> Received[T] | None:
            received = inputs.peek(name, kind)
            ages[name] = -1.0 if received is None else (t_ns - received.received_ns) / 1e6
            return received

        picture = self.pictures[-1] if self.pictures else None
        newest(picture_topic(self.shown), Image)
        if picture is not None:
            ages[picture_topic(self.shown)] = (
                t_ns - picture.received_ns
            ) / 1e6  # a repeated picture has not arrived anew
        track, followed = newest(TRACK, Track), newest(FOLLOWED, Track)
        detections = newest(DETECTIONS, PeopleDetections)
        newest(FACES, PersonPicture)
        obstacles = tuple(
            obstacle
            for name in OBSTACLES
            if (received := newest(name, Obstacles)) is not None and ages[name] < topic(name).max_age_ms
            for obstacle in received.message.obstacles
        )
        health = {name: r.message for name in self._nodes if (r := newest(health_topic(name).name, Health)) is not None}
        return Snapshot(
            t_ns=t_ns,
            ages_ms=ages,
            picture=picture,
            picture_age_ms=-1.0 if picture is None else (t_ns - picture.taken_ns) / 1e6,
            track_age_ms=self._age_ms(track, t_ns),
            state=_message(newest(STATE, VehicleState)),
            status=_message(newest(STATUS, HelmStatus)),
            setpoint=_message(newest(SETPOINT, Setpoint)),
            track=_message(track),
            track_capture_ns=track.header.capture_ns if track else 0,
            tracked_ago_ms=self._tracked_ago_ms(TRACK, t_ns),
            followed=_message(followed),
            followed_capture_ns=followed.header.capture_ns if followed else 0,
            followed_age_ms=self._age_ms(followed, t_ns),
            followed_ago_ms=self._tracked_ago_ms(FOLLOWED, t_ns),
            members=_message(newest(MEMBERS, FollowMembers)),
            limiter=_message(newest(LIMITER, LimiterStatus)),
            approach=_message(newest(APPROACH, ApproachTarget)),
            search=_message(newest(SEARCH, SearchStatus)),
            detections=_message(detections),
            detections_capture_ns=detections.header.capture_ns if detections else 0,
            people=_message(newest(PEOPLE, People)),
            faces=self._faces,
            vehicle_ns=None if self._vehicle_at is None else self._vehicle_at[0] + t_ns - self._vehicle_at[1],
            obstacles=obstacles,
            shown=self.shown,
            cameras=self._calibrated({n: newest(calibration_topic(n), CameraInfo) for n in self._cameras}),
            session=_message(newest(SESSION, Session)),
            health=health,
            alive=alive,
        )

    def _age_ms(self, track: Received[Track] | None, t_ns: int) -> float:
        """Time since the capture of the picture that a target was seen in, ms; -1 without any."""
        return -1.0 if track is None else (t_ns - self._local_ns(track)) / 1e6

    def _tracked_ago_ms(self, name: str, t_ns: int) -> float:
        """Time since a topic's target was last seen, ms; -1: never."""
        return (t_ns - self._tracked_ns[name]) / 1e6 if name in self._tracked_ns else -1.0

    def _calibrated(self, told: Mapping[str, Received[CameraInfo] | None]) -> dict[str, Camera]:
        for name, received in told.items():
            if received is not None and self._calibrations.get(name, (None,))[0] != received.message:
                self._calibrations[name] = (received.message, Camera.from_info(received.message))
        return {name: camera for name, (_, camera) in self._calibrations.items()}


def _message(received: Received[Any] | None) -> Any:
    return None if received is None else received.message
