"""Options of the world beside an autopilot that Outrider did not start: where the vehicle's pose comes from."""

from __future__ import annotations

import argparse

from common.config import ConfigError

POSE_PORTS = {"truth": 19410, "local": 19420}
"""Where the world listens by default: PX4's SIH sends its truth to 19410; 19420 is that of `deploy/px4`."""
POSE_ASKED = {"truth": 19450, "local": 19460}
"""Where it asks for message rates until it hears a pose."""


def add_pose(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the world learns the pose of a vehicle that another autopilot flies."""
    parser.add_argument(
        "--pose",
        choices=tuple(POSE_PORTS),
        help="external autopilot: the pose comes as truth (HIL_STATE_QUATERNION, as PX4's SIH sends it; default), or "
        "as the autopilot's own estimate on a link of the world's own (local: LOCAL_POSITION_NED, ATTITUDE_QUATERNION)",
    )
    ports = ", ".join(f"{source} {port}" for source, port in POSE_PORTS.items())
    parser.add_argument("--pose-port", type=int, metavar="PORT", help=f"UDP port that it comes to (default: {ports})")


def pose_overrides(external: bool, pose: str | None, port: int | None) -> list[str]:
    """Settings of the world for an external autopilot; none for Outrider's own.

    Raises:
        ConfigError: a pose option without an external autopilot.
    """
    if external:
        source = pose or "truth"
        # The autopilot's home is not the vehicle file's: the ground is where the vehicle first stands.
        return [
            "world.home=first",
            f"world.source={source}",
            f"world.port={port or POSE_PORTS[source]}",
            f"world.autopilot_port={POSE_ASKED[source]}",
        ]
    if pose is not None or port is not None:
        raise ConfigError(
            f"{'--pose' if pose else '--pose-port'}: got {pose or port} with Outrider's own autopilot, which needs "
            "none; expected it beside --autopilot external (demo: --autopilot URL)"
        )
    return []
