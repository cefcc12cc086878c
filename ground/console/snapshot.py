"""What the console knows at one instant, gathered from the newest messages, with the age of each."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from common.clock import ClockMap
from common.geometry.camera import Camera
from common.header import Received
from common.messages import (
    ApproachTarget,
    CameraInfo,
    Health,
    HelmStatus,
    Image,
    LimiterStatus,
    Message,
    Obstacle,
    Obstacles,
    People,
    PeopleDetections,
    PersonPicture,
    Session,
    Setpoint,
    Track,
    VehicleState,
)
from common.node import Inputs
from common.topics import health_topic, topic

T = TypeVar("T", bound=Message)

PURSUIT_CAMERA = "down"
"""Camera in whose pictures the pursuit looks for its target."""
STATE = "helm/state"
STATUS = "helm/status"
SETPOINT = "helm/setpoint"
TRACK = "pursuit/track"
OBSTACLES = ("obstacles/depth", "obstacles/people", "obstacles/circles")
LIMITER = "helm/limiter"
APPROACH = "approach/target"
PEOPLE = "people/tracks"
DETECTIONS = "people/detections"
FACES = "people/pictures"
SESSION = "session"
TOPICS = (STATE, STATUS, SETPOINT, LIMITER, TRACK, APPROACH, *OBSTACLES, DETECTIONS, PEOPLE, FACES, SESSION)
"""Inputs that are there for every vehicle; with the pictures of its cameras they are all."""

_PICTURES_KEPT = 6  # 0.3 s at 20 Hz: the tracker answers within that, or its box is shown on a newer picture
_STATES_KEPT_NS = 2_000_000_000
_CLOCK_ALONE_NS = 3_000_000_000


def picture_topic(camera: str) -> str:
    """Name of the stream of a camera's pictures."""
    return f"camera/{camera}/jpeg"


def calibration_topic(camera: str) -> str:
    """Name of the stream of a camera's calibration."""
    return f"camera/{camera}/info"


@dataclass(frozen=True)
class Picture:
    """One received picture, still compressed."""

    jpeg: bytes
    """The file."""
    width: int
    """Columns, px."""
    height: int
    """Rows, px."""
    capture_ns: int
    """Capture stamp (vehicle clock)."""
    received_ns: int
    """Arrival (console's clock)."""
    taken_ns: int
    """Capture, in the console's clock as far as that is known; never after the arrival."""


@dataclass(frozen=True)
class Snapshot:
    """What the console knows at `t_ns`; a message stays here when it is old: look at its age."""

    t_ns: int
    """The instant (console's clock)."""
    ages_ms: Mapping[str, float]
    """Age of the newest message of each topic, ms since receipt; -1 when none has come."""
    picture_age_ms: float = -1.0
    """Age of the newest picture, ms since its capture; -1 when none has come."""
    track_age_ms: float = -1.0
    """Age of the target's estimate, ms since the capture of its picture; -1 when none has come."""
    picture: Picture | None = None
    """Newest picture."""
    state: VehicleState | None = None
    """Newest estimate of the autopilot."""
    status: HelmStatus | None = None
    """Newest status of helm."""
    setpoint: Setpoint | None = None
    """Newest setpoint."""
    track: Track | None = None
    """Newest estimate of the target."""
    track_capture_ns: int = 0
    """Picture that the estimate belongs to (vehicle clock)."""
    tracked_ago_ms: float = -1.0
    """How long ago the target was last tracked, ms; -1: never."""
    limiter: LimiterStatus | None = None
    """Newest status of the limiter."""
    approach: ApproachTarget | None = None
    """Newest word of the approach."""
    detections: PeopleDetections | None = None
    """Newest word of the people in a picture."""
    detections_capture_ns: int = 0
    """Picture that they belong to (vehicle clock)."""
    people: People | None = None
    """Everybody who was found."""
    faces: Mapping[int, bytes] = field(default_factory=dict)
    """Newest picture of each person, JPEG, by number."""
    vehicle_ns: int | None = None
    """The instant on the vehicle's clock, as far as that is known."""
    obstacles: tuple[Obstacle, ...] = ()
    """Obstacles of all sources that are fresh."""
    shown: str = PURSUIT_CAMERA
    """Camera whose pictures are shown."""
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    """Calibration of each camera that told it."""
    session: Session | None = None
    """Newest session message."""
    health: Mapping[str, Health] = field(default_factory=dict)
    """Newest health of each node that sent one."""
    alive: Mapping[str, int] | None = None
    """Processes of each live node; None before the first answer."""

    def ago_s(self, stamp_ns: int) -> float | None:
        """Time since a stamp of the vehicle's clock, s; None while that clock is unknown."""
        return None if self.vehicle_ns is None else (self.vehicle_ns - stamp_ns) / 1e9

    @property
    def in_picture(self) -> PeopleDetections | None:
        """The people in the picture that is shown; None without fresh word of them."""
        found = self.detections if self.fresh(DETECTIONS) else None
        return found if found is not None and found.camera == self.shown else None

    def age_ms(self, name: str) -> float:
        """Age of the newest message of a topic, ms; -1 when none has come."""
        return self.ages_ms.get(name, -1.0)

    @property
    def camera(self) -> Camera | None:
        """Calibration of the camera that is shown."""
        return self.cameras.get(self.shown)

    @property
    def picture_live(self) -> bool:
        """Whether the newest picture may be shown as what is going on now."""
        return 0.0 <= self.picture_age_ms <= topic(picture_topic(self.shown)).max_age_ms

    def fresh(self, name: str) -> bool:
        """Whether the newest message of a topic is within the topic's maximum age."""
        return 0.0 <= self.age_ms(name) <= topic(name).max_age_ms

    @property
    def height_m(self) -> float | None:
        """Height above home, m; None without a fresh state."""
        return -self.state.ned_p_m[2] if self.state is not None and self.fresh(STATE) else None

    @property
    def chasing(self) -> bool:
        """Whether helm says that it obeys the pursuit."""
        return self.status is not None and self.fresh(STATUS) and self.status.state == "pursuit"


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
        self._tracked_ns: int | None = None
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
        track = inputs.peek(TRACK, Track)
        if track is not None and track.message.state == "tracking":
            self._tracked_ns = track.received_ns

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
        track, detections = newest(TRACK, Track), newest(DETECTIONS, PeopleDetections)
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
            track_age_ms=-1.0 if track is None else (t_ns - self._local_ns(track)) / 1e6,
            state=_message(newest(STATE, VehicleState)),
            status=_message(newest(STATUS, HelmStatus)),
            setpoint=_message(newest(SETPOINT, Setpoint)),
            track=_message(track),
            track_capture_ns=track.header.capture_ns if track else 0,
            tracked_ago_ms=-1.0 if self._tracked_ns is None else (t_ns - self._tracked_ns) / 1e6,
            limiter=_message(newest(LIMITER, LimiterStatus)),
            approach=_message(newest(APPROACH, ApproachTarget)),
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

    def _calibrated(self, told: Mapping[str, Received[CameraInfo] | None]) -> dict[str, Camera]:
        for name, received in told.items():
            if received is not None and self._calibrations.get(name, (None,))[0] != received.message:
                self._calibrations[name] = (received.message, Camera.from_info(received.message))
        return {name: camera for name, (_, camera) in self._calibrations.items()}


def _message(received: Received[Any] | None) -> Any:
    return None if received is None else received.message
