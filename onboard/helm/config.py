"""Settings of helm (`[helm]` of the vehicle file)."""

from __future__ import annotations

import re
from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Positive, Section
from onboard.helm.dialect.ardupilot import ARDUPILOT
from onboard.helm.dialect.base import Dialect
from onboard.helm.dialect.px4 import PX4
from onboard.helm.dialect.registry import AUTO, DIALECTS

_URL = re.compile(
    r"^(?:(?:udpin|udpout|tcpin|tcpout)://[^:/\s]+:(?P<port>\d{1,5})|serial(?:_flowcontrol)?:///[^:\s]+:\d+)$"
)


class ContainmentConfig(Section, frozen=True, kw_only=True):
    """Where and how fast helm lets the vehicle fly, whoever asks."""

    speed_m_s: Positive = 3.0
    """Largest horizontal speed, m/s."""
    climb_m_s: Positive = 1.0
    """Largest climb or sink rate, m/s."""
    yaw_rate_rad_s: Positive = 0.8
    """Largest heading rate, rad/s."""
    acceleration_m_s2: Positive = 2.5
    """Largest change of the asked velocity, m/s²."""
    tilt_m_s2: Positive = 4.0
    """Largest acceleration that a request may ask for, m/s²: a tilt of 22 degrees, wind and drag included."""
    braking_m_s2: Positive = 5.0
    """Largest change towards hover, m/s²."""
    height_min_m: NonNegative = 1.5
    """Lowest held height above home, m."""
    height_max_m: Positive = 20.0
    """Greatest held height above home, m."""
    radius_m: Positive = 60.0
    """Fence: greatest horizontal distance from home, m."""
    fence_band_m: Positive = 8.0
    """Within this distance of the fence the outward speed is taken away gradually, m."""
    chase_without_target_s: Positive = 20.0
    """Longest chase or approach without a target, s; then helm holds."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""
        if self.height_min_m >= self.height_max_m:
            raise ConfigError(
                f"height_min_m: got {self.height_min_m}, expected less than height_max_m = {self.height_max_m}"
            )
        if self.fence_band_m >= self.radius_m:
            raise ConfigError(f"fence_band_m: got {self.fence_band_m}, expected less than radius_m = {self.radius_m}")


class HelmConfig(Section, frozen=True, kw_only=True):
    """The autopilot's link, what is obeyed, and what happens when nothing can be."""

    autopilot_url: str = "udpin://127.0.0.1:14540"
    """Where the autopilot is: udpin, udpout, tcpin, tcpout as `udpin://HOST:PORT`, or `serial:///dev/NAME:BAUD`."""
    freshness_s: Annotated[float, msgspec.Meta(gt=0, le=1.0)] = 0.3
    """A request older than this, by its basis, is not obeyed: hover, s."""
    link_loss_action: Literal["hover", "land", "return"] = "return"
    """What follows when a task's requests stay away."""
    link_loss_after_s: Positive = 10.0
    """How long they may stay away before that, s; helm hovers meanwhile."""
    follow_on_link_loss: bool = False
    """Whether the vehicle's own follower flies on after the chase's target when the chase falls silent. The follower
    then tracks beside every chase, at the cost of its trackers."""
    follow_without_link_s: Positive = 60.0
    """Longest such flight, s; then `link_loss_action`."""
    hand_back_after_s: NonNegative = 1.0
    """The chase has to be back with its target for so long before it is obeyed again, s."""
    resume_after_restart: bool = False
    """Whether helm, started with the vehicle in the air, takes the stick and hovers without being told."""
    takeoff_height_m: Positive = 4.0
    """Height of a takeoff that names none, m above home."""
    takeoff_height_max_m: Positive = 15.0
    """Greatest height that a takeoff may name, m."""
    return_height_m: Positive = 6.0
    """Height at which helm flies home, m above home; it never descends for it."""
    return_speed_m_s: Positive = 2.0
    """Speed on the way home, m/s."""
    hover_gain_1_s: Positive = 0.8
    """Hover: velocity towards the anchor per metre of error, 1/s."""
    hover_speed_m_s: Positive = 1.0
    """Hover: largest velocity towards the anchor, m/s."""
    yaw_gain_1_s: Positive = 1.0
    """Heading rate per radian of heading error, 1/s."""
    battery_min: Fraction = 0.25
    """Least charge to arm with."""
    battery_required: bool = True
    """Whether an unknown charge forbids arming."""
    camera_max_age_s: Positive = 3.0
    """The camera counts as live when its newest picture, as its calibration message says, is at most this old, s."""
    camera_required: bool = True
    """Whether a missing camera or calibration forbids arming."""
    obstacle_distance: bool = False
    """Whether the obstacle map goes to the autopilot as OBSTACLE_DISTANCE, ten times a second: for its own collision
    prevention (PX4: CP_DIST), and for QGroundControl."""
    dialect: str = AUTO
    """What the autopilot speaks: `auto` asks its heartbeat, a name (`px4`, `ardupilot`) is taken at its word."""
    parameters: dict[str, float | int] = msgspec.field(default_factory=lambda: dict(PX4.parameters))
    """Parameters that helm writes to PX4 on the ground and insists on before arming. Whole numbers are integer
    parameters, others float. COM_OBL_RC_ACT 5 is HOLD: PX4's own default returned home after a hang."""
    ardupilot_parameters: dict[str, float | int] = msgspec.field(default_factory=lambda: dict(ARDUPILOT.parameters))
    """The same for ArduPilot. FS_EKF_ACTION 1 lands without a position."""
    containment: ContainmentConfig = ContainmentConfig()
    """Speed, height band, fence."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""
        match = _URL.match(self.autopilot_url)
        if match is None or not 0 < int(match["port"] or 1) < 65536:
            raise ConfigError(
                f"autopilot_url: got {self.autopilot_url!r}, expected udpin://HOST:PORT (or udpout, "
                f"tcpin, tcpout) or serial:///dev/NAME:BAUD, for example udpin://127.0.0.1:14540"
            )
        low, high = self.containment.height_min_m, self.containment.height_max_m
        for name in ("takeoff_height_m", "takeoff_height_max_m", "return_height_m"):
            if not low <= getattr(self, name) <= high:
                raise ConfigError(
                    f"{name}: got {getattr(self, name)}, expected {low} to {high}, the height band of containment"
                )
        if self.dialect not in (AUTO, *DIALECTS):
            raise ConfigError(f"dialect: got {self.dialect!r}, expected {AUTO}, {' or '.join(DIALECTS)}")
        for dialect in DIALECTS.values():
            silence_s = self.silence_s(dialect)
            if not 0.3 <= silence_s <= 3.0:
                raise ConfigError(
                    f"{self._parameter_field(dialect)}.{dialect.silence_parameter}: got {silence_s}, expected 0.3 to "
                    f"3.0 s: it is how long the vehicle flies on after helm fell silent"
                )

    def parameters_of(self, dialect: Dialect) -> dict[str, float | int]:
        """What helm writes to an autopilot of this dialect, and insists on."""
        return getattr(self, self._parameter_field(dialect), {})

    def silence_s(self, dialect: Dialect) -> float:
        """Silence after which an autopilot of this dialect stops flying helm's last setpoint, s."""
        return float(self.parameters_of(dialect).get(dialect.silence_parameter, 1.0))

    @staticmethod
    def _parameter_field(dialect: Dialect) -> str:
        return "parameters" if dialect is PX4 else f"{dialect.name}_parameters"

    @property
    def udp_port(self) -> int | None:
        """Local port that helm will listen on, or None for other links."""
        match = _URL.match(self.autopilot_url)
        return int(match["port"]) if match and self.autopilot_url.startswith("udpin://") else None
