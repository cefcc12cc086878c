"""The process table: every process of Outrider, on which side it runs, and where its code is.

Entries are strings, imported only in the process that runs them, so `common` depends on neither side. An entry is a
`Node` subclass, or a function `run(config, stop) -> exit code` for what is no node (a router, the autopilot).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.config import Config, ConfigError, apply_overrides, find_file, read_toml, unknown_key_text
from common.session import Side


@dataclass(frozen=True)
class ProcessSpec:
    """One process."""

    name: str
    """Name on the command line, in logs, health and liveliness."""
    side: Side
    """Which supervisor starts it."""
    entry: str
    """`module:Class` of a node, or `module:function`."""
    doc: str
    """One line for help texts."""
    extra: str
    """Extra of the distribution that brings its libraries."""
    needs: str = ""
    """`section.key` without which it has nothing to do: its side leaves it out while that is empty."""
    outlives_supervisor: bool = False
    """Whether it goes on when its supervisor is killed: helm does, the supervisor is no part of the safety chain."""


PROCESSES: dict[str, ProcessSpec] = {
    p.name: p
    for p in (
        ProcessSpec("router-onboard", "onboard", "common.router:run_onboard", "the vehicle's Zenoh router", "onboard"),
        ProcessSpec(
            "camera",
            "onboard",
            "onboard.camera.node:CameraNode",
            "pictures: the simulated camera, a V4L2 device, an RTSP stream, a video file or an image folder",
            "onboard",
        ),
        ProcessSpec(
            "proximity",
            "onboard",
            "onboard.proximity.node:ProximityNode",
            "nearest points of depth pictures by direction, for the limiter",
            "onboard",
        ),
        ProcessSpec(
            "people",
            "onboard",
            "onboard.people.node:PeopleNode",
            "finds people in the pictures of an RGB-D camera, and knows them again",
            "onboard",
            needs="people.camera",
        ),
        ProcessSpec(
            "helm",
            "onboard",
            "onboard.helm.node:HelmNode",
            "arbiter, limiter and the one link to the autopilot",
            "onboard",
            outlives_supervisor=True,
        ),
        ProcessSpec(
            "search",
            "onboard",
            "onboard.search.node:SearchNode",
            "flies over an area line by line, so that its camera sees all of it",
            "onboard",
            needs="search.area",
        ),
        ProcessSpec(
            "approach",
            "onboard",
            "onboard.approach.node:ApproachNode",
            "flies up to a person or an obstacle that the operator has chosen, and holds there",
            "onboard",
        ),
        ProcessSpec(
            "follow",
            "onboard",
            "onboard.follow.node:FollowNode",
            "several trackers fused, and the flight after a target by what the vehicle itself sees",
            "onboard",
        ),
        ProcessSpec(
            "router-ground", "ground", "common.router:run_ground", "the ground station's Zenoh router", "ground"
        ),
        ProcessSpec(
            "pursuit", "ground", "ground.pursuit.node:PursuitNode", "colour particle filter and chase law", "ground"
        ),
        ProcessSpec("console", "ground", "ground.console.node:ConsoleNode", "the operator's web page", "ground"),
        ProcessSpec(
            "recorder", "ground", "ground.recorder.process:run", "MCAP recording of every recorded topic", "ground"
        ),
        ProcessSpec(
            "autopilot",
            "sim",
            "simulation.autopilot.process:run",
            "the simulated autopilot, speaking MAVLink as PX4 does",
            "sim",
        ),
        ProcessSpec("world", "sim", "simulation.world.node:WorldNode", "the simulated world and its camera", "sim"),
    )
}

SECTIONS: dict[str, str] = {
    "bus": "common.session:BusConfig",
    "camera": "common.geometry.config:CamerasConfig",
    "video": "onboard.camera.config:VideoConfig",
    "helm": "onboard.helm.config:HelmConfig",
    "proximity": "onboard.proximity.config:ProximityConfig",
    "people": "onboard.people.pipeline_config:PeopleConfig",
    "limiter": "onboard.limiter.config:LimiterConfig",
    "search": "onboard.search.config:SearchConfig",
    "approach": "onboard.approach.config:ApproachConfig",
    "follow": "onboard.follow.config:FollowConfig",
    "depth": "onboard.fusion.config:DepthConfig",
    "tracker": "common.tracking.config:ParticleFilterConfig",
    "dsst": "common.tracking.dsst_config:DsstConfig",
    "cmt": "common.tracking.cmt_config:CmtConfig",
    "struck": "common.tracking.struck_config:StruckConfig",
    "tld": "common.tracking.tld_config:TldConfig",
    "mil": "common.tracking.mil_config:MilConfig",
    "nano": "common.tracking.deep_config:NanoConfig",
    "vit": "common.tracking.deep_config:VitConfig",
    "hab_df": "onboard.fusion.config:HabDfConfig",
    "fusion": "onboard.fusion.config:FusionConfig",
    "pursuit": "ground.pursuit.config:PursuitConfig",
    "console": "ground.console.config:ConsoleConfig",
    "recorder": "ground.recorder.config:RecorderConfig",
    "autopilot": "simulation.autopilot.config:AutopilotSimConfig",
    "world": "simulation.world.config:WorldConfig",
}


def process(name: str) -> ProcessSpec:
    """Entry of the table.

    Raises:
        ConfigError: no such process; the text suggests the nearest name.
    """
    try:
        return PROCESSES[name]
    except KeyError:
        raise ConfigError(f"node: {unknown_key_text(name, PROCESSES)}") from None


def side_processes(side: Side) -> list[ProcessSpec]:
    """Processes of a side, in starting order."""
    return [p for p in PROCESSES.values() if p.side == side]


def idle(side: Side, config: Config) -> list[str]:
    """Names of a side's processes that have nothing to do with this configuration."""
    tables = config.resolved()

    def given(path: str) -> bool:
        section, _, key = path.partition(".")
        return bool(tables[section][key])

    return [p.name for p in side_processes(side) if p.needs and not given(p.needs)]


def load_config(file: str | None, overrides: Iterable[str] = ()) -> Config:
    """All sections from a vehicle file and `section.key=value` overrides.

    Args:
        file: path, or name of a file in `deploy/vehicles`; None for defaults.
        overrides: texts of `--set`.

    Raises:
        ConfigError: the first thing that is wrong, with file, key, what was got and what was expected.
    """
    path = None if file is None else find_file(file, "vehicles")
    tables: dict[str, Any] = {} if path is None else read_toml(path)
    where = "defaults" if path is None else _display(path)
    overrides = list(overrides)
    return Config(apply_overrides(tables, overrides), SECTIONS, f"{where} and --set" if overrides else where)


def _display(path: Path) -> str:
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)
