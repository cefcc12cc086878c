"""What the console knows at one instant, gathered from the newest messages, with the age of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from common.geometry.camera import Camera
from common.messages import (
    ApproachTarget,
    FollowMembers,
    Health,
    HelmStatus,
    LimiterStatus,
    Obstacle,
    People,
    PeopleDetections,
    SearchStatus,
    Session,
    Setpoint,
    Track,
    VehicleState,
)
from common.topics import topic

PURSUIT_CAMERA = "down"
"""Camera in whose pictures the pursuit looks for its target."""
STATE = "helm/state"
STATUS = "helm/status"
SETPOINT = "helm/setpoint"
TRACK = "pursuit/track"
FOLLOWED = "follow/track"
MEMBERS = "follow/members"
OBSTACLES = ("obstacles/depth", "obstacles/people", "obstacles/circles")
LIMITER = "helm/limiter"
APPROACH = "approach/target"
SEARCH = "search/status"
PEOPLE = "people/tracks"
DETECTIONS = "people/detections"
FACES = "people/pictures"
SESSION = "session"
TOPICS = (
    STATE,
    STATUS,
    SETPOINT,
    LIMITER,
    TRACK,
    FOLLOWED,
    MEMBERS,
    APPROACH,
    SEARCH,
    *OBSTACLES,
    DETECTIONS,
    PEOPLE,
    FACES,
    SESSION,
)
"""Inputs that are there for every vehicle; with the pictures of its cameras they are all."""


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
    followed: Track | None = None
    """Newest estimate of the follower's target."""
    followed_capture_ns: int = 0
    """Picture that it belongs to (vehicle clock)."""
    followed_age_ms: float = -1.0
    """Its age, ms since the capture of its picture; -1 when none has come."""
    followed_ago_ms: float = -1.0
    """How long ago the follower's target was last seen, ms; -1: never."""
    members: FollowMembers | None = None
    """Newest word of the follower's trackers."""
    limiter: LimiterStatus | None = None
    """Newest status of the limiter."""
    approach: ApproachTarget | None = None
    """Newest word of the approach."""
    search: SearchStatus | None = None
    """Newest word of the search over an area."""
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
    def followed_in_picture(self) -> Track | None:
        """The follower's target, where it has one in the camera that is shown; None without fresh word of it."""
        mine = self.members is not None and self.fresh(MEMBERS) and self.members.camera == self.shown
        track = self.followed if mine and self.fresh(FOLLOWED) else None
        return track if track is not None and track.state != "idle" else None

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

    @property
    def following(self) -> bool:
        """Whether helm says that it obeys the follower."""
        return self.status is not None and self.fresh(STATUS) and self.status.state == "follow"
