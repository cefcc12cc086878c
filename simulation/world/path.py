"""Way of a car or a person: a polyline with rounded corners, under limits of speed,
acceleration and heading rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulation.world.path_config import PathConfig

Array = NDArray[np.float64]

_STEP_M = 0.02
_SPEED_LIMIT_M_S = 2.5


class Mover(Protocol):
    """Section of something that stands at a place or follows a way."""

    @property
    def north_m(self) -> float:
        """Place without a way, north, m."""
        ...

    @property
    def east_m(self) -> float:
        """Place without a way, east, m."""
        ...

    @property
    def heading_deg(self) -> float:
        """Heading without a way, degrees."""
        ...

    @property
    def path(self) -> PathConfig:
        """The way."""
        ...


@dataclass(frozen=True)
class Motion:
    """Where a car is and how it moves, at N instants."""

    ned_p_m: Array
    """Position on the ground, (N, 2): north, east, m."""
    ned_v_m_s: Array
    """Velocity, (N, 2), m/s."""
    heading_rad: Array
    """Heading, (N,), rad from north, clockwise."""
    along_m: Array
    """Distance along the curve, (N,), m; in a later lap or on the way back it jumps or falls."""


@dataclass(frozen=True)
class _Line:
    """Curve sampled by arc length: pieces are straight or arcs, so position and heading are exact between samples."""

    s_m: Array
    """Arc length at the start of each piece, (P + 1,), the last one being the whole length."""
    start_m: Array
    """Start of each piece, (P, 2)."""
    heading_rad: Array
    """Heading at the start of each piece, (P,)."""
    curvature_per_m: Array
    """Curvature of each piece, (P,), 1/m, positive to the right."""

    def at(self, s_m: Array) -> tuple[Array, Array, Array]:
        """Position (N, 2), heading (N,) and curvature (N,) at arc lengths (N,)."""
        piece = np.clip(np.searchsorted(self.s_m, s_m, side="right") - 1, 0, len(self.curvature_per_m) - 1)
        along, curvature, heading = s_m - self.s_m[piece], self.curvature_per_m[piece], self.heading_rad[piece]
        turned = curvature * along
        # Chord of an arc: length l sinc(turned / 2) in the direction of the mean heading; exact for a straight too.
        chord = along * np.sinc(turned / (2 * np.pi))
        mean = heading + turned / 2
        position = self.start_m[piece] + chord[:, None] * np.column_stack((np.cos(mean), np.sin(mean)))
        return position, heading + turned, curvature


@dataclass(frozen=True)
class CarPath:
    """Motion of a car over time. Before its start delay has passed the car stands at its first waypoint."""

    line: _Line
    """The curve."""
    t_s: Array
    """Times of the profile's nodes, (M,), non-decreasing, s after the start."""
    node_m: Array
    """Arc length at each node, (M,); beyond the curve's length in the second lap, falling on a way back."""
    speed_m_s: Array
    """Speed along the curve at each node, (M,), signed."""
    lap_from: int
    """Node from which the profile repeats for ever."""
    closed: bool
    """Whether the curve is a loop."""
    delay_s: float
    """Start delay, s."""

    def at(self, t_s: ArrayLike) -> Motion:
        """Motion at times (N,) or one time, s since the car was told to go (negative: it stands)."""
        times = np.atleast_1d(np.asarray(t_s, dtype=float)) - self.delay_s
        times = np.maximum(times, 0.0)
        end, begin = self.t_s[-1], self.t_s[self.lap_from]
        if end > begin:
            times = np.where(times >= end, begin + np.mod(times - begin, end - begin), times)
        else:
            times = np.minimum(times, end)
        node = np.clip(np.searchsorted(self.t_s, times, side="right") - 1, 0, max(len(self.t_s) - 2, 0))
        s, speed = self._along(times, node)
        length = self.line.s_m[-1]
        position, heading, _ = self.line.at(np.mod(s, length) if self.closed else np.clip(s, 0.0, length))
        velocity = speed[:, None] * np.column_stack((np.cos(heading), np.sin(heading)))
        return Motion(position, velocity, np.mod(heading + np.pi, 2 * np.pi) - np.pi, s)

    def _along(self, times: Array, node: NDArray[np.intp]) -> tuple[Array, Array]:
        """Arc length and speed between nodes, where the acceleration is constant."""
        if len(self.t_s) < 2:
            return np.full(len(times), self.node_m[0]), np.zeros(len(times))
        span = self.t_s[node + 1] - self.t_s[node]
        elapsed = np.clip(times - self.t_s[node], 0.0, span)
        fraction = np.divide(elapsed, span, out=np.zeros_like(elapsed), where=span > 0)
        speed = self.speed_m_s[node] + fraction * (self.speed_m_s[node + 1] - self.speed_m_s[node])
        return self.node_m[node] + 0.5 * (self.speed_m_s[node] + speed) * elapsed, speed

    def polyline(self, step_m: float = 0.1) -> Array:
        """Points (N, 2) along the whole curve, for painting a road; a loop's last point is its first."""
        length = self.line.s_m[-1]
        return self.line.at(np.linspace(0.0, length, max(int(length / step_m), 2)))[0]


def car_path(car: Mover) -> CarPath:
    """Path of a car or a person of a scenario; one who stands has a path that never moves."""
    if not car.path.waypoints:
        heading = np.deg2rad(car.heading_deg)
        line = _Line(np.array([0.0, 0.0]), np.array([[car.north_m, car.east_m]]), np.array([heading]), np.zeros(1))
        return CarPath(line, np.zeros(1), np.zeros(1), np.zeros(1), 0, False, 0.0)
    line, stations = _rounded(car.path)
    closed = car.path.mode == "loop"
    stops = {float(s): w.stop_s for s, w in zip(stations, car.path.waypoints, strict=True) if w.stop_s > 0}
    nodes = np.union1d(np.arange(0.0, line.s_m[-1], _STEP_M), np.concatenate((line.s_m, stations)))
    wanted = _wanted_speed(car.path, line, nodes, stations)
    if closed:
        return _loop_profile(car.path, line, nodes, wanted, stops)
    return _ping_pong_profile(car.path, line, nodes, wanted, stops)


def _rounded(path: PathConfig) -> tuple[_Line, Array]:
    """Curve of a path, and the arc length at which it passes each waypoint (a rounded one: mid-arc)."""
    points = np.array([(w.north_m, w.east_m) for w in path.waypoints])
    count, closed = len(points), path.mode == "loop"
    ahead = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(ahead[:, 0], ahead[:, 1])
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    turns = np.mod(headings - np.roll(headings, 1) + np.pi, 2 * np.pi) - np.pi
    # Tangent length r tan(|turn| / 2); at most 0.45 of a neighbouring segment, so that two arcs never overlap.
    room = 0.45 * np.minimum(lengths, np.roll(lengths, 1))
    half = np.tan(np.abs(turns) / 2)
    cut = np.minimum(path.turn_radius_m * half, room)
    if not closed:
        cut[0] = cut[-1] = 0.0
        turns[0] = turns[-1] = 0.0
    return _pieces(points, headings, turns, lengths, cut, half, closed, count)


def _pieces(
    points: Array, headings: Array, turns: Array, lengths: Array, cut: Array, half: Array, closed: bool, count: int
) -> tuple[_Line, Array]:
    """Straights and arcs in driving order. A loop begins in the middle of the arc at its first waypoint."""
    starts: list[Array] = []
    piece_headings: list[float] = []
    curvatures: list[float] = []
    s = [0.0]
    stations = np.zeros(count)
    cursor = points[0].copy()

    def add(length: float, heading: float, curvature: float) -> None:
        nonlocal cursor
        if length <= 1e-9:
            return
        starts.append(cursor)
        piece_headings.append(heading)
        curvatures.append(curvature)
        s.append(s[-1] + length)
        mean = heading + curvature * length / 2
        chord = length * np.sinc(curvature * length / (2 * np.pi))
        cursor = cursor + chord * np.array([np.cos(mean), np.sin(mean)])

    radii = np.where(cut > 1e-9, cut / np.maximum(half, 1e-9), np.inf)
    if closed:
        cursor = _mid_arc(points[0], headings[-1], headings[0], cut[0], radii[0], turns[0])
    for i in range(count if closed else count - 1):
        into = headings[i] - turns[i] / 2
        arc = radii[i] * abs(turns[i]) / 2 if np.isfinite(radii[i]) else 0.0
        if i > 0:
            add(arc, headings[i] - turns[i], np.sign(turns[i]) / radii[i])
        stations[i] = s[-1]
        add(arc, into, np.sign(turns[i]) / radii[i])
        following = (i + 1) % count
        add(lengths[i] - cut[i] - cut[following], headings[i], 0.0)
    if closed:
        arc = radii[0] * abs(turns[0]) / 2 if np.isfinite(radii[0]) else 0.0
        add(arc, headings[-1], np.sign(turns[0]) / radii[0])
    else:
        stations[-1] = s[-1]
    return _Line(np.array(s), np.array(starts), np.array(piece_headings), np.array(curvatures)), stations


def _mid_arc(corner: Array, heading_in: float, heading_out: float, cut: float, radius: float, turn: float) -> Array:
    """Middle of the arc that rounds a corner."""
    if not np.isfinite(radius):
        return corner.copy()
    entry = corner - cut * np.array([np.cos(heading_in), np.sin(heading_in)])
    mean = heading_in + turn / 4
    chord = 2 * radius * np.sin(abs(turn) / 4)
    return entry + chord * np.array([np.cos(mean), np.sin(mean)])


def _wanted_speed(path: PathConfig, line: _Line, nodes: Array, stations: Array) -> Array:
    """Highest speed (N,) at each node: the waypoint's, and what the curvature allows on both sides of the node."""
    speeds = np.array([w.speed_m_s for w in path.waypoints]) * path.speed_scale
    owner = np.clip(np.searchsorted(stations, nodes, side="right") - 1, 0, len(speeds) - 1)
    wanted = np.minimum(speeds[owner], np.where(np.isin(nodes, stations), speeds[owner - 1], np.inf))
    middles = (nodes[:-1] + nodes[1:]) / 2
    curvature = np.abs(line.at(middles)[2])
    around = np.maximum(np.append(curvature, curvature[-1]), np.append(curvature[0], curvature))
    tight = np.maximum(around, 1e-9)
    lateral = np.sqrt(path.lateral_acceleration_m_s2 / tight)  # a = v² κ
    return np.minimum(np.minimum(wanted, _SPEED_LIMIT_M_S), np.minimum(lateral, path.turn_rate_rad_s / tight))


def _limit(nodes: Array, wanted: Array, acceleration_m_s2: float) -> Array:
    """Speed profile (N,) under `wanted` that gains and loses speed no faster than allowed: v² <= v0² + 2 a s."""
    squared = (wanted**2).tolist()
    gain = (2 * acceleration_m_s2 * np.diff(nodes)).tolist()
    for i in range(1, len(squared)):
        squared[i] = min(squared[i], squared[i - 1] + gain[i - 1])
    for i in range(len(squared) - 2, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + gain[i])
    return np.sqrt(squared)


def _timed(nodes: Array, speed: Array, dwell_s: Array) -> tuple[Array, Array, Array]:
    """Times, arc lengths and speeds of the nodes; a node with a dwell time appears twice."""
    pace = speed[:-1] + speed[1:]
    passing = 2 * np.diff(nodes) / np.maximum(pace, 1e-9)
    times = np.concatenate(([0.0], np.cumsum(passing + dwell_s[:-1])))
    stopping = np.flatnonzero(dwell_s > 0)
    after = times.copy()
    after[stopping] += dwell_s[stopping]
    order = np.sort(np.concatenate((np.arange(len(nodes)), stopping)))
    first = np.concatenate(([True], np.diff(order) > 0))
    return np.where(first, times[order], after[order]), nodes[order], speed[order]


def _dwell(nodes: Array, stops: dict[float, float]) -> Array:
    dwell = np.zeros(len(nodes))
    for station, seconds in stops.items():
        dwell[int(np.argmin(np.abs(nodes - station)))] = seconds
    return dwell


def _loop_profile(path: PathConfig, line: _Line, nodes: Array, wanted: Array, stops: dict[float, float]) -> CarPath:
    """Profile of laps: the first ones from rest, then one that repeats."""
    length = float(line.s_m[-1])
    lap = nodes[nodes < length - 1e-9]
    wanted, dwell = wanted[: len(lap)], _dwell(lap, stops)
    wanted[dwell > 0] = 0.0
    # From rest the speed has reached its limit somewhere after v² / 2a: from the lap after that on it is periodic.
    laps = 1 + int(np.ceil(float(wanted.max()) ** 2 / (2 * path.acceleration_m_s2 * length)))
    many = np.concatenate([lap + k * length for k in range(laps + 1)] + [np.array([(laps + 1) * length])])
    want_many = np.append(np.tile(wanted, laps + 1), wanted[0])
    want_many[0] = 0.0
    speed = _limit(many, want_many, path.acceleration_m_s2)
    # One lap more was computed, so that the brakes of the last one kept know what comes after it.
    keep = laps * len(lap) + 1
    waits = np.tile(dwell, laps + 1)[:keep]
    # The car stands at its first waypoint already: that stop counts from the second time it comes by.
    waits[0] = waits[-1] = 0.0
    t, s, v = _timed(many[:keep], speed[:keep], waits)
    begin = int(np.searchsorted(s, (laps - 1) * length - 1e-9))
    return CarPath(line, t, s, v, begin, True, path.start_delay_s)


def _ping_pong_profile(
    path: PathConfig, line: _Line, nodes: Array, wanted: Array, stops: dict[float, float]
) -> CarPath:
    """Profile of there and back, at rest at both ends."""
    dwell = _dwell(nodes, stops)
    wanted[dwell > 0] = 0.0
    wanted[0] = wanted[-1] = 0.0
    speed = _limit(nodes, wanted, path.acceleration_m_s2)
    there = _timed(nodes, speed, dwell)
    back_dwell = dwell[::-1].copy()
    back_dwell[0] = back_dwell[-1] = 0.0  # waited already, on arrival and at the next start
    back = _timed(nodes[-1] - nodes[::-1], speed[::-1], back_dwell)
    t = np.concatenate((there[0], there[0][-1] + back[0]))
    s = np.concatenate((there[1], nodes[-1] - back[1]))
    v = np.concatenate((there[2], -back[2]))
    return CarPath(line, t, s, v, 0, False, path.start_delay_s)
