"""The simulated autopilot as a process: the vehicle in real time, two MAVLink links and the truth port."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import ExitStack

from common import heartbeat
from common.config import Config
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.link import PortInUse, UdpLink
from simulation.autopilot.mavlink import Protocol
from simulation.autopilot.rates import FIRST_S, GROUND_RATES, ONBOARD_RATES, TRUTH_RATES
from simulation.autopilot.telemetry import Telemetry
from simulation.autopilot.vehicle import SimulatedVehicle

log = logging.getLogger(__name__)

_EXIT_CONFIG = 2
_CATCH_UP_S = 0.1


class Pacer:
    """Cycles in real time: sleeps between them, catches up after a short delay, gives up on a long one.

    Args:
        period_s: duration of a cycle, s.
        now_s: monotonic time of the first cycle, s.
    """

    def __init__(self, period_s: float, now_s: float):
        self._period_s = period_s
        self._next_s = now_s
        self.skipped = 0
        """Cycles that never ran because the machine was too slow: autopilot time stood still for them."""

    def wait_s(self, now_s: float) -> float:
        """How long to sleep before the next cycle, s; not positive when it is due."""
        behind_s = now_s - self._next_s
        if behind_s > _CATCH_UP_S:
            lost = int(behind_s / self._period_s)
            self.skipped += lost
            self._next_s += lost * self._period_s
        return self._next_s - now_s

    def done(self) -> None:
        """One cycle has run."""
        self._next_s += self._period_s


class AutopilotProcess:
    """Vehicle, links and protocol, one cycle a call.

    Args:
        config: the section.

    Raises:
        PortInUse: a local port cannot be bound.
    """

    def __init__(self, config: AutopilotSimConfig):
        self.vehicle = SimulatedVehicle(config, config.clock_rate / config.rate_hz)
        self._telemetry = Telemetry(self.vehicle)
        self._reboot_s = config.reboot_s
        self._dark_s = 0.0
        system_id = int(self.vehicle.parameters["MAV_SYS_ID"])
        with ExitStack() as undo:
            self.links: list[UdpLink] = []
            for name, ports, rates in (
                ("onboard", config.onboard, ONBOARD_RATES),
                ("ground", config.ground, GROUND_RATES),
                ("truth", config.truth, TRUTH_RATES),
            ):
                link = UdpLink(name, config.host, ports, rates, FIRST_S, system_id, config.sign_frames)
                undo.callback(link.close)
                self.links.append(link)
            undo.pop_all()
        self.protocol = Protocol(self.vehicle, self._telemetry, self.links, self.links[:2])

    def cycle(self) -> None:
        """Receive, react, advance the vehicle, send; nothing but the fall of time while a reboot is under way."""
        if self._dark_s > 0.0:
            self._wait_in_the_dark()
            return
        for link in self.links:
            for message in link.receive(self.vehicle.t_s):
                self.protocol.handle(link, message)
        self.vehicle.step()
        self.protocol.update()
        for link in self.links:
            link.send_due(self.vehicle.t_s, self._telemetry)
        if self.protocol.reboot_at_s <= self.vehicle.t_s:
            log.info("simulated autopilot: rebooting, silent for %.1f s", self._reboot_s)
            self._dark_s = max(self._reboot_s, self.vehicle.dt_s)

    def _wait_in_the_dark(self) -> None:
        """One cycle without an autopilot: what is sent to it is lost, and its clock stands."""
        for link in self.links:
            link.receive(self.vehicle.t_s)
        self.vehicle.coast()
        self._dark_s -= self.vehicle.dt_s
        if self._dark_s <= 0.0:
            self.vehicle.reboot()
            self.protocol.restart()
            for link in self.links:
                link.restart()

    def close(self) -> None:
        """Free the ports."""
        for link in self.links:
            link.close()


def run(config: Config, stop: threading.Event) -> int:
    """Run the simulated autopilot until told to stop.

    Args:
        config: all sections; `AutopilotSimConfig` is read.
        stop: ends the loop within a cycle.

    Returns:
        Exit code: 0, or 2 when a port is in use (one line in the log says which).
    """
    section = config.section(AutopilotSimConfig)
    try:
        autopilot = AutopilotProcess(section)
    except PortInUse as error:
        log.error("%s", error)
        return _EXIT_CONFIG
    log.info(
        "simulated autopilot: onboard link %d -> %d, ground link %d -> %d, truth %d -> %d, %.0f cycles a second",
        section.onboard.local_port,
        section.onboard.remote_port,
        section.ground.local_port,
        section.ground.remote_port,
        section.truth.local_port,
        section.truth.remote_port,
        section.rate_hz,
    )
    pacer = Pacer(1.0 / section.rate_hz, time.monotonic())
    try:
        _loop(autopilot, pacer, stop)
    finally:
        autopilot.close()
        log.info(
            "simulated autopilot ended after %.1f s, %d cycles skipped; %s",
            autopilot.vehicle.t_s,
            pacer.skipped,
            dict(autopilot.protocol.counters),
        )
    return 0


def _loop(autopilot: AutopilotProcess, pacer: Pacer, stop: threading.Event) -> None:
    beat_at_s, reported = 0.0, 0
    while not stop.is_set():
        now_s = time.monotonic()
        wait_s = pacer.wait_s(now_s)
        if wait_s > 0.0:
            time.sleep(wait_s)
        autopilot.cycle()
        pacer.done()
        if now_s >= beat_at_s:
            beat_at_s = now_s + 1.0
            heartbeat.beat()
            if pacer.skipped > reported:
                log.warning("machine too slow: %d cycles skipped", pacer.skipped - reported)
                reported = pacer.skipped
