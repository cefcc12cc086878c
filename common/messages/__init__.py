"""Every message type of the bus: typed, versioned by a schema hash, validated on receipt.

Field docs give units and frame. `check` enforces what types cannot say (finite numbers, shapes, unit quaternions);
`common.codec` calls it for each message that arrives, so an algorithm never sees a malformed one.
Vectors are tuples of floats; quaternions are (w, x, y, z), Hamilton, rotating from the frame named second to the one
named first (`ned_q_body` turns a body vector into NED).
"""

from __future__ import annotations

from typing import Literal

from common.messages.base import Message, MessageError, Quat, Vec2, Vec3, check_quaternion, check_range
from common.messages.follow import FollowMembers as FollowMembers
from common.messages.follow import MemberBox as MemberBox
from common.messages.obstacles import SECTORS as SECTORS
from common.messages.obstacles import LimiterStatus as LimiterStatus
from common.messages.obstacles import Obstacle as Obstacle
from common.messages.obstacles import Obstacles as Obstacles
from common.messages.obstacles import View as View
from common.messages.people import BONES as BONES
from common.messages.people import JOINTS as JOINTS
from common.messages.people import Covariance as Covariance
from common.messages.people import People as People
from common.messages.people import PeopleDetections as PeopleDetections
from common.messages.people import Person as Person
from common.messages.people import PersonDetection as PersonDetection
from common.messages.people import PersonPicture as PersonPicture
from common.messages.people import person_label as person_label
from common.messages.vehicle import HelmStatus as HelmStatus
from common.messages.vehicle import PreflightItem as PreflightItem
from common.messages.vehicle import Request as Request
from common.messages.vehicle import Setpoint as Setpoint
from common.messages.vehicle import VehicleState as VehicleState

# ---------------------------------------------------------------- pictures

_BYTES_PER_PIXEL = {"bgr8": 3, "gray8": 1, "depth_mm": 2}


class Image(Message, frozen=True, kw_only=True):
    """One camera picture. On the bus the payload is `data` alone; the other fields travel in the attachment."""

    camera: str
    """Camera name, as in the vehicle file (`down`)."""
    width: int
    """Columns, px."""
    height: int
    """Rows, px."""
    encoding: Literal["bgr8", "gray8", "depth_mm", "jpeg"]
    """Pixel layout of `data`: interleaved rows without padding (`depth_mm`: little-endian 16-bit millimetres along the
    optical axis, 0 where nothing returned; `common.geometry.depth`), or a JPEG file."""
    data: bytes = b""
    """The pixels."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        check_range("width", self.width, 1, 16384)
        check_range("height", self.height, 1, 16384)
        if self.encoding == "jpeg":
            if not (self.data[:2] == b"\xff\xd8" and self.data[-2:] == b"\xff\xd9"):
                raise MessageError(f"data: got {len(self.data)} bytes that are no whole JPEG, expected SOI and EOI")
            return
        expected = self.width * self.height * _BYTES_PER_PIXEL[self.encoding]
        if len(self.data) != expected:
            raise MessageError(
                f"data: got {len(self.data)} bytes, expected {expected} for {self.width}x{self.height} "
                f"{self.encoding} (a truncated frame?)"
            )


class CameraInfo(Message, frozen=True, kw_only=True):
    """Calibration of a camera, sent with its pictures so that the ground needs no copy of the vehicle file."""

    camera: str
    """Camera name."""
    width: int
    """Columns, px."""
    height: int
    """Rows, px."""
    fx_px: float
    """Focal length along columns, px."""
    fy_px: float
    """Focal length along rows, px."""
    cx_px: float
    """Principal point, column, px."""
    cy_px: float
    """Principal point, row, px."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Brown-Conrady k1, k2, p1, p2, k3 (OpenCV order)."""
    body_q_camera: Quat
    """Turns a camera optical vector (x right, y down, z forward) into the body frame (FRD)."""
    body_p_camera_m: Vec3
    """Position of the camera in the body frame (FRD), m."""
    exposure_delay_ms: float = 0.0
    """How long before its stamp the picture was exposed, ms."""
    rate_hz: float
    """Nominal picture rate, Hz."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        check_quaternion("body_q_camera", self.body_q_camera)
        for name in ("fx_px", "fy_px"):
            check_range(name, getattr(self, name), 1.0, 1e5)


# ---------------------------------------------------------------- the chase


class Track(Message, frozen=True, kw_only=True):
    """Estimate of the target in the picture named by the header's `capture_ns`."""

    state: Literal["idle", "tracking", "lost"]
    """`lost`: predicted only, by the motion model."""
    x_px: float = 0.0
    """Centre, column, px."""
    y_px: float = 0.0
    """Centre, row, px."""
    width_px: float = 0.0
    """Side of the rotated rectangle along its own x axis, px."""
    height_px: float = 0.0
    """Side along its own y axis, px."""
    angle_rad: float = 0.0
    """Rotation of the rectangle from the image's x axis towards its y axis, rad."""
    distance: float = 1.0
    """Smallest Bhattacharyya distance among the particles, 0 (equal) to 1 (Teulière 2011, eq. 4)."""
    distance_limit: float = 1.0
    """Distance above which the target counts as lost."""
    error: Vec2 = (0.0, 0.0)
    """Target in the horizontal frame below the vehicle, attitude compensated: (forward, right) as tangents."""
    error_m: float = 0.0
    """Horizontal distance to the target at the vehicle's present height, m."""
    reason: str = ""
    """Why no request goes out, empty when one does."""


class ApproachTarget(Message, frozen=True, kw_only=True):
    """What the approach has selected, and where it is."""

    state: Literal["idle", "tracking", "lost"]
    """`idle`: nothing is selected. `lost`: it was not seen of late; no request goes out."""
    label: str = ""
    """Its name, when the source gives one."""
    ned_p_m: Vec3 = (0.0, 0.0, 0.0)
    """Its nearest point, from home, NED, m; where it was last, when lost."""
    distance_m: float = -1.0
    """From the vehicle's centre to that point, m; -1 when idle."""
    goal_m: float = 0.0
    """Distance at which the vehicle is to stop, m."""
    reason: str = ""
    """Why no request goes out, empty when one does."""


class SearchStatus(Message, frozen=True, kw_only=True):
    """How far the search over an area is."""

    state: Literal["idle", "searching"]
    """`searching`: there is a way, and requests go out for it; whether helm obeys, helm says."""
    flown: float = 0.0
    """Share of the corners of the way that were passed, 0 to 1."""
    way_m: tuple[Vec2, ...] = ()
    """Corners of the way, north and east of home, m; empty when idle."""
    next_corner: int = 0
    """Number of the corner that it flies to, from 0."""
    skipped: int = 0
    """Corners that could not be reached and were left out."""
    reason: str = ""
    """Why there is no search: how the last one ended."""


# ---------------------------------------------------------------- commands, with replies


class Command(Message, frozen=True, kw_only=True):
    """Argument of a query; which fields count depends on the command (see `common.topics.COMMANDS`)."""

    box_px: tuple[float, float, float, float] | None = None
    """`pursuit/do/select`, `follow/do/select`: x, y, width, height of the target in the picture, px."""
    angle_rad: float = 0.0
    """The same: rotation of that box, rad."""
    capture_ns: int = 0
    """The same: picture that the box was drawn on (0: the newest)."""
    height_m: float | None = None
    """`helm/do/takeoff`: height above home, m."""
    label: str = ""
    """`approach/do/select`, `people/do/…`: name of the thing (`person 3`)."""
    name: str = ""
    """`people/do/rename`: what the person is called from now on."""
    into: str = ""
    """`people/do/merge`: the person that `label` is the same as (`person 1`)."""
    bearing_rad: float | None = None
    """`approach/do/select`: direction of the thing, rad from the vehicle's heading, clockwise."""
    ned_p_m: Vec3 | None = None
    """`approach/do/select`: a point of the thing, from home, NED, m."""
    on: bool | None = None
    """`helm/do/push-back`: whether the limiter may back away."""
    operator: str = ""
    """Who asks, for the log."""


class Reply(Message, frozen=True, kw_only=True):
    """What became of a command."""

    outcome: Literal["done", "refused", "failed"]
    """`refused`: nothing was tried, `reason` says why. `failed`: it was tried and did not work."""
    reason: str = ""
    """One sentence: what, got, expected, what to do."""


# ---------------------------------------------------------------- housekeeping


class Health(Message, frozen=True, kw_only=True):
    """What a node says of itself, once a second."""

    node: str
    """Node name."""
    pid: int
    """Process identifier on its machine."""
    steps: int
    """Steps since the start."""
    step_ms_median: float
    """Median duration of a step over the last period, ms."""
    step_ms_max: float
    """Longest step over the last period, ms."""
    input_age_ms: dict[str, float]
    """Age of the newest message of each input, ms; -1 when none has come."""
    dropped: dict[str, int]
    """Messages of each input that a newer one replaced before they were read."""
    rejected: dict[str, int]
    """Messages refused at the door, by `topic: reason`."""
    errors: int
    """Steps that ended in an exception."""
    last_error: str = ""
    """The newest exception, one line."""
    metrics: dict[str, float] = {}
    """Figures of the node's own: late frames of the world, bytes written by the recorder, …"""


class Session(Message, frozen=True, kw_only=True):
    """Maps the vehicle's monotonic time to UTC for logs."""

    vehicle: str
    """Vehicle name."""
    monotonic_ns: int
    """Vehicle clock, ns."""
    utc_ns: int
    """UTC at the same instant, ns since 1970."""
