"""Check of the autopilot: as helm sees it while helm runs; else by listening on helm's link, commanding nothing."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

from common.config import Config, ConfigError
from common.doctor.finding import Finding, fault, from_error, ok, warning
from common.doctor.ports import holders
from common.doctor.routers import hear, visit
from common.helm_lock import HelmLock
from common.messages import HelmStatus
from common.session import BusConfig
from onboard.helm.actions import Action
from onboard.helm.autopilot_link import AutopilotLink
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.base import Kind
from onboard.helm.telemetry import Telemetry

_STATUS_S = 2.0
_FIND_S = 3.0
_READ_S = 2.5


def autopilot(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether the autopilot speaks, and has the parameters that the gate insists on."""
    helm = config.section(HelmConfig)
    with visit(config, "onboard") as bus:
        if bus is not None:
            heard = hear(bus, ("helm/status",), _STATUS_S)["helm/status"]
            if heard:
                yield from of_gate(heard[-1].message)
            else:
                # The link stays closed to us: a helm that its supervisor starts again must find it free.
                yield fault("helm", f"silent for {_STATUS_S:g} s while its router runs", "start `outrider node helm`")
            return
    if helm.udp_port is not None and holders("udp", helm.udp_port):
        yield warning(
            "autopilot",
            f"not heard: UDP port {helm.udp_port} is held",
            "see what is said of that port, then look again",
        )
        return
    yield from listen(helm, config.section(BusConfig).vehicle)


def of_gate(status: HelmStatus) -> Iterator[Finding]:
    """Findings from helm's gate."""
    yield ok("helm", f"{status.state}, {status.reason}" if status.reason else status.state)
    for item in status.preflight:
        found, cure = item.found_and_cure()
        if item.ok:
            yield ok(f"gate: {item.name}", found)
        else:
            yield fault(f"gate: {item.name}", found, cure or "look at helm's log")


def listen(helm: HelmConfig, vehicle: str) -> Iterator[Finding]:
    """Findings from the autopilot itself, heard on helm's own link under helm's lock."""
    try:
        lock = HelmLock(helm.autopilot_url, f"{vehicle} (the doctor, for a few seconds)")
    except ConfigError as error:
        yield from_error("autopilot", error)
        return
    try:
        link = AutopilotLink(helm.autopilot_url, helm.dialect, listen_only=True)
    except ConfigError as error:
        yield from_error("autopilot", error)
        lock.close()
        return
    try:
        yield from _heard(link, helm)
    finally:
        link.close(hold=False)
        lock.close()


def _heard(link: AutopilotLink, helm: HelmConfig) -> Iterator[Finding]:
    telemetry = Telemetry()
    deadline_s = time.monotonic() + _FIND_S
    while not telemetry.found and not telemetry.unfit and time.monotonic() < deadline_s:
        time.sleep(0.05)
        telemetry = link.poll(time.monotonic_ns())
    if telemetry.unfit:
        yield fault("autopilot", telemetry.unfit, "set helm.dialect, or connect the autopilot that is meant")
        return
    if not telemetry.found:
        here = urlsplit(helm.autopilot_url).hostname in ("127.0.0.1", "localhost")
        yield (warning if here else fault)(
            "autopilot",
            f"no word at {helm.autopilot_url} in {_FIND_S:g} s",
            "start it (`outrider sim` starts the simulated one), or set helm.autopilot_url",
        )
        return
    yield ok("autopilot", f"{telemetry.dialect.title} speaks at {helm.autopilot_url}")
    wanted = {
        name: value
        for name, value in helm.parameters_of(telemetry.dialect).items()
        if name != telemetry.dialect.takeoff_parameter
    }
    link.submit(Action(Kind.PARAMETERS, wanted))
    deadline_s = time.monotonic() + _READ_S
    values = {}
    while time.monotonic() < deadline_s and not values:
        time.sleep(0.05)
        for result in link.results():
            values = dict(result.values)
    for name, value in wanted.items():
        if name not in values:
            yield fault(
                f"parameter {name}", "could not be read", "check the link; is it a parameter of this autopilot?"
            )
        elif math.isclose(values[name], value, rel_tol=1e-4, abs_tol=1e-4):
            yield ok(f"parameter {name}", f"{value:g}")
        else:
            yield warning(
                f"parameter {name}",
                f"got {values[name]:g}, expected {value:g}",
                "nothing yet: helm writes it when it starts on the ground, and its gate says if that fails",
            )
