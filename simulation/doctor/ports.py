"""Checks of the simulation's UDP ports."""

from __future__ import annotations

from collections.abc import Iterator

from common.config import Config
from common.doctor.finding import Finding
from common.doctor.ports import PortUse, examine_ports
from simulation.autopilot.config import AutopilotSimConfig
from simulation.world.config import WorldConfig


def ports(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Ports of the simulated autopilot's links and of the world."""
    autopilot, world = config.section(AutopilotSimConfig), config.section(WorldConfig)
    links = {"onboard": autopilot.onboard, "ground": autopilot.ground, "truth": autopilot.truth}
    yield from examine_ports(
        (
            *(
                PortUse("udp", link.local_port, "autopilot", f"autopilot.{name}.local_port")
                for name, link in links.items()
            ),
            PortUse("udp", world.port, "world", "world.port"),
        )
    )
