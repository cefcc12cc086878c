"""Checks of the ground station: its ports, and room for recordings."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from common.config import Config
from common.doctor.finding import Finding, fault, ok, warning
from common.doctor.ports import PortUse, examine_ports, tcp_port
from common.geometry.config import CamerasConfig
from common.session import BusConfig
from ground.console.config import ConsoleConfig
from ground.recorder.config import RecorderConfig

_BYTES_PER_PIXEL = 0.18  # of a JPEG with its share of everything else: 4,000 MB an hour at 640x480 and 20 Hz
_SHORT_H, _TOO_SHORT_H = 2.0, 0.1


def ports(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Ports of the ground's router and of the console."""
    router, console = config.section(BusConfig).ground_router, config.section(ConsoleConfig).port
    yield from examine_ports(
        (
            PortUse("tcp", tcp_port(router), "router-ground", "bus.ground_router"),
            PortUse("tcp", console, "console", "console.port"),
        )
    )


def disk(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether recordings can be written, and for how long."""
    recorder, camera = config.section(RecorderConfig), config.section(CamerasConfig).down
    if not recorder.enabled:
        yield ok("recordings", "switched off")
        return
    folder = Path(recorder.folder).absolute()
    existing = next(p for p in (folder, *folder.parents) if p.exists())
    try:
        with tempfile.TemporaryFile(dir=existing) as probe:
            probe.write(b"doctor")
            probe.flush()
    except OSError as error:
        yield fault(
            "recordings",
            f"{existing} cannot be written ({error.strerror})",
            "give the right to write there, or set recorder.folder to another folder",
        )
        return
    free = shutil.disk_usage(existing).free
    hours = free / (camera.width * camera.height * camera.rate_hz * _BYTES_PER_PIXEL * 3600)
    text = f"{free / 1e9:.0f} GB free, about {hours:.1f} h of recording in {folder}"
    cure = "delete old recordings, or set recorder.folder to a larger disk"
    if hours < _TOO_SHORT_H:
        yield fault("recordings", text, cure)
    elif hours < _SHORT_H:
        yield warning("recordings", text, cure)
    else:
        yield ok("recordings", text)
