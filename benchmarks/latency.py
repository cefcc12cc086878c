"""From the picture's capture to the setpoint sent, all processes flying, in real time: whole, and by hop.

Every figure comes from the headers: each message names the messages it was computed from, with the times at which
they were sent and received. All processes run on one machine here, so all times are of one clock.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np
import psutil

from benchmarks.base import Benchmark, Outcome, Settings
from common.bus import Bus
from common.codec import decode_header
from common.header import Header, InputRef
from common.messages import Image, Request
from common.processes import load_config
from common.session import BusConfig
from simulation.demo.mission import ChaseMission
from simulation.demo.run import Sides

log = logging.getLogger(__name__)

_HOPS = ("render", "world_to_camera", "camera", "camera_to_pursuit", "pursuit", "pursuit_to_helm", "helm")
_REQUEST, _JPEG, _SIMULATED = "helm/request/pursuit", "camera/down/jpeg", "sim/camera/down"


class HeaderTrail:
    """Keeps headers of the chain's messages, joined by source and sequence at the end."""

    def __init__(self, bus: Bus):
        self._headers: dict[str, dict[tuple[str, int], Header]] = {_REQUEST: {}, _JPEG: {}, "helm/setpoint": {}}
        for name in self._headers:
            bus.subscribe_raw(name, lambda sample, n=name: self._keep(n, sample))

    def _keep(self, name: str, sample: Any) -> None:
        header, _ = decode_header(sample.attachment.to_bytes())
        self._headers[name][(header.source, header.seq)] = header

    def chains(self) -> Iterable[tuple[float, tuple[float, ...]]]:
        """For each setpoint that a new picture caused: ms from capture to sent, and ms of each hop."""
        answered: set[int] = set()
        for setpoint in self._headers["helm/setpoint"].values():
            to_helm = _reference(setpoint, _REQUEST)
            if to_helm is None or to_helm.seq in answered:
                continue
            request = self._headers[_REQUEST].get((to_helm.source, to_helm.seq))
            to_pursuit = _reference(request, _JPEG)
            picture = self._headers[_JPEG].get((to_pursuit.source, to_pursuit.seq)) if to_pursuit else None
            to_camera = _reference(picture, _SIMULATED)
            if to_pursuit is None or to_camera is None:
                continue
            answered.add(to_helm.seq)
            marks = (
                to_camera.capture_ns,
                to_camera.sent_ns,
                to_camera.received_ns,
                to_pursuit.sent_ns,
                to_pursuit.received_ns,
                to_helm.sent_ns,
                to_helm.received_ns,
                setpoint.sent_ns,
            )
            hops = tuple(float(d) / 1e6 for d in np.diff(marks))
            yield (marks[-1] - marks[0]) / 1e6, hops


def _reference(header: Header | None, topic: str) -> InputRef | None:
    if header is None:
        return None
    return next((r for r in header.inputs if r.topic == topic), None)


class CpuMeter:
    """Share of one core that each process of Outrider takes, from its CPU time over a span."""

    def __init__(self) -> None:
        self._start: dict[str, tuple[psutil.Process, float, float]] = {}
        for process in psutil.Process().children(recursive=True):
            words = process.cmdline()
            if "node" in words:
                name = words[words.index("node") + 1]
                self._start[name] = (process, _cpu_s(process), time.monotonic())

    def percent(self) -> dict[str, float]:
        """Percent of one core since the start, by process name."""
        return {
            name: 100.0 * (_cpu_s(p) - cpu_s) / (time.monotonic() - start_s)
            for name, (p, cpu_s, start_s) in self._start.items()
            if p.is_running()
        }


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


def _answer(ground: Bus, request: Request) -> None:
    ground.publish("helm/request/operator", request, 0)


def _bare_transport_ms(config: BusConfig, rounds: int) -> np.ndarray:
    """Milliseconds for a picture-sized message to the ground and a request back, with nothing computed between."""
    done = threading.Event()
    trips = []
    with Bus(config, "onboard", "bench-onboard") as vehicle, Bus(config, "ground", "bench-ground") as ground:
        request = Request(frame="ned", vector=(0.0, 0.0, 0.0))
        ground.subscribe("camera/down/jpeg", lambda r: _answer(ground, request))
        vehicle.subscribe("helm/request/operator", lambda r: done.set())
        body = b"\xff\xd8" + bytes(60_000) + b"\xff\xd9"
        picture = Image(camera="down", width=640, height=480, encoding="jpeg", data=body)
        time.sleep(0.5)
        for _ in range(rounds):
            done.clear()
            start_ns = time.monotonic_ns()
            vehicle.publish("camera/down/jpeg", picture)
            if done.wait(1.0):
                trips.append((time.monotonic_ns() - start_ns) / 1e6)
            time.sleep(0.02)
    return np.array(trips)


def run(settings: Settings) -> Outcome:
    """Fly a chase of the calm scenario and measure it."""
    duration_s = 20.0 if settings.quick else 120.0
    overrides = ["world.scenario=calm", f"world.seed={settings.seed}", f"autopilot.seed={settings.seed}"]
    arguments = ["--config", "kite", *(part for text in overrides for part in ("--set", text))]
    bus_config = load_config("kite", overrides).section(BusConfig)
    sides = Sides(arguments, headless=True)
    try:
        with Bus(bus_config, "ground", "bench", wait_s=30.0) as bus:
            mission = ChaseMission(bus, threading.Event(), duration_s)
            bare = _bare_transport_ms(
                msgspec.structs.replace(bus_config, vehicle="bench"), 20 if settings.quick else 100
            )
            trail: list[HeaderTrail] = []
            meters: list[CpuMeter] = []

            def on_chase() -> None:
                trail.append(HeaderTrail(bus))
                meters.append(CpuMeter())

            mission.on_chase = on_chase
            mission.fly()
            cpu = meters[0].percent()
            chains = list(trail[0].chains())
    finally:
        sides.end()
    return _outcome(chains, cpu, bare, mission.late_fraction)


def _outcome(
    chains: list[tuple[float, tuple[float, ...]]], cpu: dict[str, float], bare: np.ndarray, late_fraction: float
) -> Outcome:
    totals = np.array([total for total, _ in chains])
    hops = np.array([h for _, h in chains])
    results = {
        "p50_ms": float(np.percentile(totals, 50)),
        "p99_ms": float(np.percentile(totals, 99)),
        "max_ms": float(totals.max()),
        "setpoints": float(len(totals)),
    }
    for index, name in enumerate(_HOPS):
        results[f"hop_{name}_p50_ms"] = float(np.percentile(hops[:, index], 50))
        results[f"hop_{name}_share"] = float(hops[:, index].mean() / totals.mean())
    results |= {f"cpu_{name.replace('-', '_')}_percent": value for name, value in sorted(cpu.items())}
    results["world_late_fraction"] = late_fraction
    baseline_ms = float(np.percentile(bare, 50))
    return Outcome(
        results,
        baseline={
            "name": "the same two routers, a 60 kB message and a request back, nothing computed",
            "p50_ms": baseline_ms,
            "p99_ms": float(np.percentile(bare, 99)),
            "ratio_p50": results["p50_ms"] / baseline_ms,
        },
    )


BENCHMARK = Benchmark("latency", "capture to setpoint sent, all processes flying, by hop", run)
