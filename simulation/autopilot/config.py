"""Configuration of the simulated autopilot: links, vehicle, weather, noise and the parameters that it starts with."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Port, Positive, Section, unknown_key_text
from simulation.autopilot.parameters import DEFAULTS


class LinkConfig(Section, frozen=True, kw_only=True):
    """One UDP link of the autopilot."""

    local_port: Port
    """Port that the autopilot listens on."""
    remote_port: Port
    """Port that it sends to until somebody else speaks to it."""


class FailureConfig(Section, frozen=True, kw_only=True):
    """A sensor that fails at a time."""

    at_s: NonNegative
    """When, s of autopilot time since the start."""
    sensor: Literal["gps", "mag", "baro"]
    """Which sensor."""
    kind: Literal["off", "stuck", "wrong", "none"] = "off"
    """How: silent, repeating its last reading, or wrong; `none` heals it."""


class AutopilotSimConfig(Section, frozen=True, kw_only=True):
    """The simulated autopilot and the vehicle under it; the defaults behave as PX4 in the loop does."""

    host: str = "127.0.0.1"
    """Address of all three links, local and remote."""
    onboard: LinkConfig = LinkConfig(local_port=14580, remote_port=14540)
    """Link to the companion computer."""
    ground: LinkConfig = LinkConfig(local_port=18570, remote_port=14550)
    """Link to ground stations."""
    truth: LinkConfig = LinkConfig(local_port=19450, remote_port=19410)
    """Link that carries the true motion (HIL_STATE_QUATERNION) to the simulated world."""

    rate_hz: Annotated[float, msgspec.Meta(ge=250, le=1000)] = 250.0
    """Cycles of plant and attitude control in real time, Hz (Teulière 2011 flew its attitude loop at 166 Hz)."""
    clock_rate: Annotated[float, msgspec.Meta(ge=0.5, le=1.5)] = 0.984
    """Autopilot seconds per real second: PX4 in the loop ran at 98.4 %, so clients must map its stamps."""
    ready_after_s: NonNegative = 4.5
    """When it is ready to arm, s after the start."""
    slow_start_probability: Fraction = 0.0
    """How often a start takes 2.3 s longer, as PX4's did now and then (6.8 s)."""
    reboot_s: NonNegative = 2.0
    """Silence between the end of a rebooted autopilot and its new start, s."""
    sign_frames: bool = False
    """Sign every MAVLink frame, as PX4 does; clients need no key to read them."""
    setpoint_delay_s: NonNegative = 0.057
    """From the arrival of an OFFBOARD setpoint until it acts, s (part of the fit, see `control`)."""

    mass_kg: Positive = 1.0
    """Mass, kg."""
    drag_n_s_m: NonNegative = 0.1
    """Drag, N per m/s: 0.1 is near a real quadrotor, 1.0 is the default of PX4's built-in one."""
    home_lat_deg: Annotated[float, msgspec.Meta(ge=-85, le=85)] = 47.397742
    """Latitude of home and take-off point, degrees."""
    home_lon_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)] = 8.545594
    """Longitude of home, degrees."""
    home_alt_m: float = 488.0
    """Altitude of home above mean sea level, m; the ground is flat at this altitude."""
    start_yaw_rad: float = 0.0
    """Heading at the start, rad from north, clockwise."""

    wind_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Mean velocity of the air, NED, m/s."""
    gust_std_m_s: NonNegative = 0.0
    """Standard deviation of gusts along north and east, m/s; half of it vertically."""
    gust_time_s: Positive = 2.0
    """Correlation time of gusts, s."""

    position_noise_m: NonNegative = 0.03
    """Standard deviation of the position estimate, per axis, m."""
    velocity_noise_m_s: NonNegative = 0.03
    """Standard deviation of the horizontal velocity estimate, per axis, m/s."""
    attitude_noise_rad: NonNegative = 0.002
    """Standard deviation of the attitude estimate, per axis, rad."""
    noise_time_s: Positive = 1.0
    """Correlation time of those errors, s."""
    climb_noise_m_s: NonNegative = 0.07
    """Standard deviation of the vertical velocity estimate, m/s: why a zero vertical velocity setpoint lets the height
    drift, over twelve seeds 0.2 m in the median and at most 1 m in 8 s (PX4: 1 to 2 m; 0.2 m/s gives 0.7 and 2.5 m)."""
    climb_noise_time_s: Positive = 8.0
    """Correlation time of the vertical velocity's error, s."""
    gyro_noise_rad_s: NonNegative = 0.002
    """White noise of the reported gyroscope, per axis, rad/s."""
    accel_noise_m_s2: NonNegative = 0.05
    """White noise of the reported accelerometer, per axis, m/s²."""

    failures: tuple[FailureConfig, ...] = ()
    """Sensors that fail during the flight."""
    dead_reckoning_m_s2: NonNegative = 0.1
    """Growth of the velocity estimate's error while GNSS is lost, m/s²."""
    wrong_gps_m_s: NonNegative = 1.0
    """How fast a wrong GNSS receiver walks away from the truth, m/s."""
    heading_drift_rad_s: NonNegative = 0.01
    """Drift of the heading while the magnetometer is lost, rad/s."""
    wrong_mag_rad: NonNegative = 0.5
    """Error of the heading that a wrong magnetometer causes, rad."""
    wrong_baro_m_s: NonNegative = 0.3
    """How fast a wrong barometer takes the height away from the truth, m/s."""

    takeoff_failure_probability: Fraction = 0.0
    """How often a takeoff is acknowledged and does not climb; 0.03 is what PX4 in the loop did (1 in 34)."""
    battery_wh: Positive = 60.0
    """Capacity of the battery, Wh."""
    battery_start: Fraction = 1.0
    """Charge at the start, 0 to 1."""
    hover_power_w: NonNegative = 150.0
    """Power drawn in hover, W; it grows with thrust to the power of 1.5 (momentum theory)."""
    seed: int = 1
    """Seed of noise, gusts and takeoff failures."""
    parameters: dict[str, int | float] = msgspec.field(default_factory=dict)
    """Parameters that differ from the defaults in `parameters`, by PX4 name (`COM_OBL_RC_ACT = 4`)."""

    def check(self) -> None:
        """Raise ConfigError for an unknown parameter, a fraction where a whole number belongs, or ports used twice."""
        for name, value in self.parameters.items():
            if name not in DEFAULTS:
                raise ConfigError(f"parameters: {unknown_key_text(name, DEFAULTS)}")
            if isinstance(DEFAULTS[name], int) and not float(value).is_integer():
                raise ConfigError(f"parameters.{name}: got {value}, expected a whole number")
        ports = [link.local_port for link in (self.onboard, self.ground, self.truth)]
        if len(set(ports)) != 3:
            raise ConfigError(f"local ports: got {ports}, expected three different ones")
