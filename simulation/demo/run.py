"""`outrider demo`: starts the three sides as their users would, flies the mission, judges it, ends everything."""

from __future__ import annotations

import argparse
import ctypes
import json
import logging
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from common.bus import Bus
from common.config import ConfigError
from common.launch import stop_on_signals
from common.processes import load_config
from common.session import BusConfig, RouterAbsent
from simulation.demo.approach import ApproachMission
from simulation.demo.mission import ChaseMission
from simulation.demo.operator import MissionFailed
from simulation.demo.report import Criteria
from simulation.demo.rescue import RescueMission
from simulation.world.scenario import load_scenario

log = logging.getLogger(__name__)

Mission = ChaseMission | ApproachMission | RescueMission
_SIDES = ("sim", "onboard", "ground")
_GRACE_S = 4.0
_PR_SET_PDEATHSIG = 1

EXIT_FAILED = 1
EXIT_TOO_SLOW = 4
"""The machine could not render in time: the flight cannot be judged."""


class Sides:
    """The three sides as processes of their own, each under its supervisor.

    Args:
        arguments: for all (`--config …`, `--set …`).
        headless: leave out the console.
        extra: further arguments by side.
    """

    def __init__(self, arguments: list[str], headless: bool, extra: Mapping[str, list[str]] | None = None):
        self._processes: dict[str, subprocess.Popen] = {}
        for side in _SIDES:
            own = ["--without", "console"] if headless and side == "ground" else []
            own += (extra or {}).get(side, [])
            self._processes[side] = subprocess.Popen(
                [sys.executable, "-m", "common.cli", side, *arguments, *own],
                stdin=subprocess.DEVNULL,
                process_group=0,
                preexec_fn=_end_with_parent,
            )

    def ended(self) -> str | None:
        """Name and exit code of a side that has ended by itself, or None."""
        for side, process in self._processes.items():
            if process.poll() is not None:
                return f"the {side} side ended with exit code {process.returncode}"
        return None

    def end(self) -> None:
        """End all sides, and wait for them; the simulation last, so that helm does not end against a dead autopilot."""
        self._end("ground", "onboard")
        self._end("sim")

    def _end(self, *sides: str) -> None:
        for side in sides:
            if self._processes[side].poll() is None:
                self._processes[side].send_signal(signal.SIGTERM)
        deadline = time.monotonic() + _GRACE_S
        for side in sides:
            try:
                self._processes[side].wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                log.warning("the %s side did not end in %.0f s: killing it", side, _GRACE_S)
                self._processes[side].kill()
                self._processes[side].wait()


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@dataclass(frozen=True)
class Show:
    """What a scenario is flown with."""

    vehicle: str
    """Vehicle file."""
    mission: Callable[[Bus, threading.Event, argparse.Namespace], Mission]
    """Makes the mission from a session, the order to stop and the command line."""


def _approach(bus: Bus, stop: threading.Event, args: argparse.Namespace) -> ApproachMission:
    return ApproachMission(bus, stop, args.duration or 0.0 if args.headless else args.duration)


_CHASE = Show("kite", lambda bus, stop, args: ChaseMission(bus, stop, args.duration))
_SHOWS: Mapping[str, Show] = MappingProxyType(
    {
        "approach": Show("heron", _approach),
        "rescue": Show("osprey", lambda bus, stop, args: RescueMission(bus, stop, args.headless)),
    }
)
"""Scenarios that are no chase, by the name of their file."""


def _show(args: argparse.Namespace) -> Show:
    return _SHOWS.get(Path(args.scenario).stem, _CHASE)


def _arguments(args: argparse.Namespace) -> list[str]:
    load_scenario(args.scenario)  # one clear line here, before a side says it and the others are told to end
    overrides = [*args.overrides, f"world.scenario={args.scenario}"]
    if args.seed is not None:
        overrides += [f"world.seed={args.seed}", f"autopilot.seed={args.seed}", f"pursuit.seed={args.seed}"]
    checked = [f"helm.autopilot_url={args.autopilot}"] if args.autopilot else []
    load_config(args.config, [*overrides, *checked])  # one clear line here, before three sides say it thrice
    return ["--config", args.config, *(part for text in overrides for part in ("--set", text))]


def _external(args: argparse.Namespace) -> dict[str, list[str]]:
    """Arguments of the sides that fly another autopilot than the simulated one; none where that flies."""
    if args.autopilot is None:
        return {}
    pose = ["--pose", args.pose] if args.pose else []
    port = ["--pose-port", str(args.pose_port)] if args.pose_port else []
    return {"sim": ["--autopilot", "external", *pose, *port], "onboard": ["--autopilot", args.autopilot]}


def main(args: argparse.Namespace) -> int:
    """Run the demonstration; returns 0 when the mission went well, 1 when not, 4 when the machine was too slow to tell.

    Raises:
        ConfigError: the configuration is refused.
    """
    if args.duration is not None and args.duration <= 0:
        raise ConfigError(f"--duration: got {args.duration:g}, expected seconds above 0")
    show = _show(args)
    args.config = args.config or show.vehicle
    arguments = _arguments(args)
    config = load_config(args.config, args.overrides)
    stop, _ = stop_on_signals()
    sides = Sides(arguments, args.headless, _external(args))
    watcher = threading.Thread(target=_watch, args=(sides, stop), daemon=True)
    watcher.start()
    try:
        with Bus(config.section(BusConfig), "ground", "demo", wait_s=30.0, stop=stop) as bus:
            mission = show.mission(bus, stop, args)
            try:
                mission.fly()
            except MissionFailed as failure:
                log.error("%s", failure)
                return EXIT_FAILED
            return _judge(mission, args, sides.ended())
    except RouterAbsent:
        return 0 if sides.ended() is None and stop.is_set() else EXIT_FAILED
    finally:
        stop.set()  # the watcher must not take an ordered end for a failure
        watcher.join()
        sides.end()


def _watch(sides: Sides, stop: threading.Event) -> None:
    while not stop.wait(0.2):
        ended = sides.ended()
        if ended is not None:
            log.error("%s: ending the demonstration", ended)
            stop.set()


def _judge(mission: Mission, args: argparse.Namespace, broken: str | None) -> int:
    criteria = Criteria()
    figures, faults = mission.judge(criteria)
    figures = figures | {"world_late_fraction": mission.late_fraction}
    too_slow = mission.late_fraction > criteria.late_fraction
    to_its_end = args.duration is not None or (args.headless and not isinstance(mission, ChaseMission))
    if to_its_end and not mission.completed:
        faults.append("ended before the mission was over")
    if broken is not None:
        faults.append(broken)
    held, not_held = mission.goal
    verdict = "machine too slow to judge" if too_slow else held if not faults else not_held
    if args.report:
        Path(args.report).write_text(
            json.dumps(
                {
                    "name": "demo",
                    "scenario": args.scenario,
                    "seed": args.seed,
                    "verdict": verdict,
                    "faults": faults,
                    "results": figures,
                },
                indent=2,
            )
            + "\n",
            encoding="utf-8",
        )
    for name, value in figures.items():
        print(f"{name:24} {value:.3f}")
    print(verdict + (": " + "; ".join(faults) if faults else ""))
    if not to_its_end and broken is None:
        return 0  # ended by the operator: the figures are for information
    if too_slow:
        return EXIT_TOO_SLOW
    return EXIT_FAILED if faults else 0
