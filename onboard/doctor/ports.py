"""Checks of the vehicle's ports, of the autopilot's serial device and of helm's lock."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from common.config import Config
from common.doctor.finding import Finding, fault, ok
from common.doctor.ports import PortUse, examine_ports, tcp_port
from common.helm_lock import runtime_dir
from common.session import BusConfig
from onboard.helm.config import HelmConfig


def ports(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Ports of the vehicle's router and of helm, or helm's serial device."""
    helm = config.section(HelmConfig)
    router = config.section(BusConfig).onboard_router
    uses = [PortUse("tcp", tcp_port(router), "router-onboard", "bus.onboard_router")]
    if helm.udp_port is not None:
        uses.append(PortUse("udp", helm.udp_port, "helm", "helm.autopilot_url"))
    yield from examine_ports(uses)
    if helm.autopilot_url.startswith("serial"):
        yield device(Path(helm.autopilot_url.split("://", 1)[1].rsplit(":", 1)[0]))


def device(path: Path) -> Finding:
    """Whether a serial device is there and may be used."""
    subject = f"device {path}"
    if not path.exists():
        return fault(subject, "is not there", "plug the autopilot in, or set helm.autopilot_url to its device")
    if not os.access(path, os.R_OK | os.W_OK):
        return fault(
            subject, f"may not be used by {_user()}", "sudo usermod -aG dialout $USER, then log out and in again"
        )
    return ok(subject, "is there and may be used")


def _user() -> str:
    return os.environ.get("USER") or f"user {os.getuid()}"


def locks(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Who holds a lock of helm's on this machine; looks into the kernel's table, so that it takes none itself."""
    try:
        folder = runtime_dir()
        writable = os.access(folder, os.W_OK)
    except OSError as error:
        yield fault("lock files", f"no folder for them ({error})", "set XDG_RUNTIME_DIR to a folder that you may write")
        return
    if not writable:
        yield fault("lock files", f"{folder} may not be written", "set XDG_RUNTIME_DIR to a folder that you may write")
        return
    rows = [line.split() for line in Path("/proc/locks").read_text(encoding="ascii").splitlines()]
    held = {row[5].rsplit(":", 1)[1]: row[4] for row in rows if row[1] == "FLOCK"}
    files = sorted(folder.glob("helm-*.lock"))
    for path in files:
        if (pid := held.get(str(path.stat().st_ino))) is not None:
            yield ok("lock files", f"{path.name} is held by process {pid}")
            return
    yield ok("lock files", f"no helm holds one in {folder}")
