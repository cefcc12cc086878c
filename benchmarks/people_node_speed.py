"""How many pictures a second the node that searches for people makes of one core, with five people in sight.

The node itself, `step` by `step`, without the bus: rendered pictures of a Kinect v2 (960x540 colour, 512x424 depth) in,
messages out. It is timed, and keeps its budget, by the processor time that it takes, so that what else runs on the
machine does not count.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.people_flights import Sway, Take
from benchmarks.people_sensor import COLOUR, DEPTH, Shot, shots
from common.config import Config
from common.geometry.rotation import as_quat, as_vec3
from common.messages import Image, PeopleDetections, VehicleState
from common.node import ScriptedRun
from common.processes import load_config
from onboard.people.node import PeopleNode
from simulation.world.depth_config import DepthNoiseConfig
from simulation.world.objects_config import BarrelConfig, PersonConfig, ThingConfig
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.scenario import CarConfig, GroundConfig, ScenarioConfig, SensorConfig

PEOPLE = 5
_RATE_HZ = 10.0
_WARM_UP, _PICTURES, _QUICK_PICTURES = 15, 90, 30
_HEIGHT_M = 6.2
_CELLS = ((1.4, -2.6), (1.5, 0.2), (1.3, 2.8), (-1.6, -2.4), (-1.5, 2.4))
"""Where people are, north and east, m: apart, and within both pictures."""
_BETWEEN = ((0.0, -3.0), (0.1, 3.1), (-1.9, -0.4), (2.4, -1.2))
"""Where other things lie."""
_SHIRTS = ("#d9480f", "#1d7a4c", "#1746a2", "#f5b301", "#7a3fa0")
_JITTER_M = 0.25
_OF_DEPTH = DEPTH.camera


def measure(seed: int, quick: bool) -> dict[str, float]:
    """Figures of a hover over five people, one of whom walks, and five things.

    Returns:
        Mean time of a picture and of its stages, ms of one core; the pictures a second that follow; people in sight and
        looks for a pose in a picture, on average.
    """
    os.environ["LP_NUM_THREADS"] = "1"  # Mesa takes every core otherwise
    node = PeopleNode(_config(), "people", clock=time.process_time)
    run = ScriptedRun(node)
    took_ms, seen, stages, looks = [], [], {}, []
    for index, shot in enumerate(_pictures(seed, quick)):
        _feed(run, shot)
        start = time.process_time()
        outputs = run.step(shot.t_ns + 1)
        spent_ms = 1e3 * (time.process_time() - start)
        told = [o.message for o in outputs if isinstance(o.message, PeopleDetections)]
        if not told or not told[0].with_depth:
            raise RuntimeError(f"people-speed: the node made nothing of a picture: {told and told[0].reason}")
        if index >= _WARM_UP:
            took_ms.append(spent_ms)
            seen.append(len(told[0].people))
            looks.append(node.findings.looks)
            for name, ms in node.findings.stage_ms.items():
                stages.setdefault(name, []).append(ms)
    return {
        **{f"node_{name}_ms": float(np.mean(ms)) for name, ms in stages.items()},
        "node_ms": float(np.mean(took_ms)),
        "node_ms_p99": float(np.quantile(took_ms, 0.99)),
        "node_hz": 1e3 / float(np.mean(took_ms)),
        "node_people": float(np.mean(seen)),
        "node_looks": float(np.mean(looks)),
    }


def _pictures(seed: int, quick: bool) -> Iterator[Shot]:
    rng = np.random.default_rng((seed, 41))
    count = _WARM_UP + (_QUICK_PICTURES if quick else _PICTURES)
    course = np.array([0.0, 0.0, -_HEIGHT_M]), float(rng.uniform(-0.2, 0.2))
    take = Take(_scenario(rng, seed), lambda _: course, Sway(rng))
    yield from shots(take, _RATE_HZ, count, seed)


def _scenario(rng: np.random.Generator, seed: int) -> ScenarioConfig:
    people = []
    order = rng.permutation(PEOPLE)
    for number, (posture, cell) in enumerate(
        zip(("supine", "prone", "side", "sitting", "standing"), order, strict=True)
    ):
        north, east = (c + float(rng.uniform(-_JITTER_M, _JITTER_M)) for c in _CELLS[cell])
        path = PathConfig()
        if posture == "standing":  # walks to and fro
            ends = [WaypointConfig(north_m=north, east_m=east + way, speed_m_s=0.8) for way in (-0.4, 0.4)]
            path = PathConfig(waypoints=tuple(ends), mode="ping_pong")
        people.append(
            PersonConfig(
                north_m=north,
                east_m=east,
                heading_deg=float(rng.uniform(0.0, 360.0)),
                posture=posture,
                limbs=int(rng.integers(10_000)),
                height_m=float(rng.uniform(1.6, 1.9)),
                shirt=_SHIRTS[number],
                path=path,
            )
        )
    kinds = ("rock", "rubble", "crate")
    return ScenarioConfig(
        seed=seed,
        ground=GroundConfig(kind="gravel", size_m=40.0, trees=0, houses=0, road=False),
        car=CarConfig(north_m=-19.0, east_m=-19.0),
        people=tuple(people),
        things=tuple(
            ThingConfig(
                kind=kind,
                north_m=n,
                east_m=e,
                size_m=0.8,
                heading_deg=float(rng.uniform(0.0, 360.0)),
            )
            for kind, (n, e) in zip(kinds, _BETWEEN[1:], strict=True)
        ),
        barrels=(BarrelConfig(north_m=_BETWEEN[0][0], east_m=_BETWEEN[0][1], radius_m=0.29, height_m=0.9),),
        sensor=SensorConfig(noise_sigma=3.0),
        depth=DepthNoiseConfig(noise_m=0.004, noise_per_m=0.0008, edge_m=0.15, flying=0.3, edge_holes=0.2, holes=0.03),
    )


def _config() -> Config:
    """A vehicle with that camera below it."""
    offset = _OF_DEPTH.body_p_camera_m[1] - COLOUR.body_p_camera_m[1]  # east is right in the picture
    colour = {name: getattr(COLOUR, name) for name in ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px")}
    depth = {name: getattr(_OF_DEPTH, name) for name in colour}
    words = [f"camera.down.{name}={value}" for name, value in colour.items()]
    words += [f"camera.down.depth.{name}={value}" for name, value in depth.items()]
    words += ["camera.down.depth.aligned=false", f"camera.down.depth.camera_p_depth_m=[{offset}, 0.0, 0.0]"]
    words += [f"camera.down.depth.range_max_m={DEPTH.range_max_m}", "people.camera=down"]
    return load_config(None, tuple(words))


def _feed(run: ScriptedRun, shot: Shot) -> None:
    height, width = shot.picture.shape[:2]
    picture = Image(camera="down", width=width, height=height, encoding="bgr8", data=shot.picture.tobytes())
    state = VehicleState(
        ned_p_m=as_vec3(shot.ned_p_m),
        ned_v_m_s=(0.0, 0.0, 0.0),
        ned_q_body=as_quat(shot.ned_q_body),
        body_rates_rad_s=(0.0, 0.0, 0.0),
        armed=True,
        in_air=True,
        mode="OFFBOARD",
        battery_fraction=0.9,
    )
    run.feed("helm/state", state, shot.t_ns)
    run.feed("camera/down/raw", picture, shot.t_ns)
    rows, columns = shot.depth_mm.shape
    ranges = Image(camera="down", width=columns, height=rows, encoding="depth_mm", data=shot.depth_mm.tobytes())
    run.feed("camera/down/depth", ranges, shot.t_ns)
