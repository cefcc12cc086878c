"""The limiter's distance ring: 72 sectors around the vehicle, coloured by zone, in the 3-D view and on the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

from common.geometry.rotation import Array
from common.messages import SECTORS, LimiterStatus

Points = NDArray[np.float32]
Colours = NDArray[np.uint8]

ZONES: dict[str, tuple[int, int, int]] = {
    "safe": (61, 220, 132),
    "warning": (240, 206, 60),
    "transition": (255, 140, 28),
    "collision": (255, 70, 62),
    "blind": (110, 118, 129),
}
"""Colour of each zone, RGB."""
_GAMMA = 2.2  # the 3-D view takes colours as linear light and shows them paler
_STEP_RAD = 2.0 * math.pi / SECTORS
_ARC = 2  # chords per sector
_CIRCLE = 72
_STEEP = math.sin(math.radians(60.0))  # steeper than this, an obstacle stands in no sector
_BEYOND = 1.06  # what is free is drawn just outside the safe zone's limit
_LIMITS = (("h_min_m", ZONES["collision"]), ("h_desired_m", (230, 237, 243)), ("h_max_m", ZONES["safe"]))


def zone_of(distance_m: float, status: LimiterStatus) -> str:
    """Zone of a sector's distance; `blind` where nothing is known."""
    if distance_m < 0.0:
        return "blind"
    if distance_m > status.h_max_m:
        return "safe"
    if distance_m > status.h_mid_m:
        return "warning"
    return "transition" if distance_m > status.h_min_m else "collision"


@dataclass(frozen=True)
class Sector:
    """How one sector of the ring is drawn."""

    zone: str
    """Zone of what is nearest there; `blind` where nothing is known within the ring."""
    near_m: float
    """Distance of what is nearest, m; what is free or unknown lies just outside the safe zone's limit."""
    filled: str
    """Zone in whose colour the sector is filled from the vehicle outwards: `blind` where nobody looked of late."""
    fill_m: float
    """How far it is filled, m."""


def sectors(status: LimiterStatus) -> list[Sector]:
    """The 72 sectors: what was looked at is filled up to what is nearest; what is only remembered has its edge alone,
    for what lies before it is unknown."""
    beyond = status.h_max_m * _BEYOND
    found = []
    for distance_m, seen in zip(status.sectors_m, status.seen, strict=True):
        zone = zone_of(distance_m, status)
        if seen:
            near_m = beyond if distance_m < 0.0 else min(distance_m, beyond)
            found.append(Sector(zone, near_m, zone, near_m))
        elif zone in ("blind", "safe"):  # remembered beyond the ring
            found.append(Sector("blind", beyond, "blind", beyond))
        else:
            found.append(Sector(zone, distance_m, "blind", beyond))
    return found


def in_scene(colour: tuple[int, int, int]) -> tuple[int, int, int]:
    """The colour, RGB, that looks like this one in the 3-D view."""
    red, green, blue = (round(255 * (c / 255) ** _GAMMA) for c in colour)
    return red, green, blue


def _bow(radii_m: Array, points: int) -> Array:
    """Points (72, points, 3) on the arc of each sector, NED, from the vehicle, m."""
    start = np.arange(SECTORS)[:, None] * _STEP_RAD
    angles = start + np.linspace(0.0, _STEP_RAD, points)[None, :]
    return np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)), axis=2) * radii_m[:, None, None]


def arcs(status: LimiterStatus) -> tuple[Points, Colours]:
    """Line segments (144, 2, 3), m, and their colours (144, 2, 3), RGB: each sector at its distance."""
    drawn = sectors(status)
    bow = _bow(np.array([sector.near_m for sector in drawn]), _ARC + 1)
    segments = np.stack((bow[:, :-1], bow[:, 1:]), axis=2).reshape(-1, 2, 3)
    colours = np.array([in_scene(ZONES[sector.zone]) for sector in drawn], np.uint8)
    return segments.astype(np.float32), np.repeat(np.repeat(colours, _ARC, axis=0)[:, None], 2, axis=1)


def wedge(status: LimiterStatus, zone: str) -> Points:
    """Corners (1 + 72 * 3, 3), m, of the sectors of one zone, filled from the vehicle outwards; the others collapse."""
    radii = np.array([sector.fill_m if sector.filled == zone else 0.0 for sector in sectors(status)])
    return np.concatenate((np.zeros((1, 3)), _bow(radii, _ARC + 1).reshape(-1, 3))).astype(np.float32)


def wedge_faces() -> NDArray[np.uint32]:
    """Triangles (144, 3) of `wedge`."""
    first = 1 + np.arange(SECTORS)[:, None] * (_ARC + 1) + np.arange(_ARC)[None, :]
    flat = first.reshape(-1)
    return np.stack((np.zeros_like(flat), flat, flat + 1), axis=1).astype(np.uint32)


def limits(status: LimiterStatus) -> tuple[Points, Colours]:
    """Line segments (3 * 72, 2, 3), m, and colours of the circles at h_min, h_desired and h_max: the outermost has the
    colour of the vehicle's zone."""
    segments, colours = [], []
    angles = np.linspace(0.0, 2.0 * math.pi, _CIRCLE + 1)
    circle = np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)), axis=1)
    for name, colour in _LIMITS:
        ring = circle * getattr(status, name)
        segments.append(np.stack((ring[:-1], ring[1:]), axis=1))
        colour = ZONES[status.zone] if name == "h_max_m" else colour
        colours.append(np.tile(np.array(in_scene(colour), np.uint8), (_CIRCLE, 2, 1)))
    return np.concatenate(segments).astype(np.float32), np.concatenate(colours)


def nearest_m(status: LimiterStatus) -> Array | None:
    """Nearest obstacle (3,) from the vehicle, NED, m; None when there is none."""
    if status.distance_m < 0.0 or status.ned_direction == (0.0, 0.0, 0.0):
        return None
    return status.distance_m * np.asarray(status.ned_direction)


class Ring:
    """The ring in the 3-D view, level at the vehicle's height.

    Args:
        scene: where it is drawn.
    """

    def __init__(self, scene: viser.SceneApi):
        self._frame = scene.add_frame("/ring", show_axes=False, visible=False)
        self._arcs = _lines(scene, "/ring/arcs", SECTORS * _ARC, 5.0)
        self._limits = _lines(scene, "/ring/limits", len(_LIMITS) * _CIRCLE, 1.2)
        self._nearest = _lines(scene, "/ring/nearest", 1, 3.0)
        self._point = scene.add_icosphere("/ring/point", 0.1, ZONES["safe"], visible=False, cast_shadow=False)
        self._words = scene.add_label("/ring/point/words", "", position=(0.0, 0.0, -0.25), visible=False)
        empty, faces = np.zeros((1 + SECTORS * (_ARC + 1), 3), np.float32), wedge_faces()
        self._wedges = {
            zone: scene.add_mesh_simple(
                f"/ring/{zone}",
                empty,
                faces,
                color=in_scene(colour),
                opacity=0.08 if zone == "blind" else 0.35,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            for zone, colour in ZONES.items()
        }
        self._shown: LimiterStatus | None = None

    def update(self, status: LimiterStatus | None, ned_p_vehicle_m: tuple[float, float, float] | None) -> None:
        """Draw a status around the vehicle; nothing without either.

        Args:
            status: newest of the limiter; None when it is old.
            ned_p_vehicle_m: where the vehicle is, NED, m; None when that is not known.
        """
        visible = status is not None and ned_p_vehicle_m is not None and knows_something(status)
        self._frame.visible = visible
        if status is None or ned_p_vehicle_m is None or not visible:
            return
        self._frame.position = ned_p_vehicle_m
        if status is self._shown:
            return
        self._shown = status
        self._arcs.points, self._arcs.colors = arcs(status)
        self._limits.points, self._limits.colors = limits(status)
        for zone, mesh in self._wedges.items():
            mesh.vertices = wedge(status, zone)
        near, colour = nearest_m(status), in_scene(ZONES[status.zone])
        self._nearest.visible = self._point.visible = self._words.visible = near is not None
        if near is not None:
            self._nearest.points = np.array([[np.zeros(3), near]], np.float32)
            self._nearest.colors = np.tile(np.array(colour, np.uint8), (1, 2, 1))
            self._point.position, self._point.color = near, colour
            self._words.text = f"{status.label + ' ' if status.label else ''}{status.distance_m:.1f} m"


def _lines(scene: viser.SceneApi, name: str, count: int, width_px: float) -> viser.LineSegmentsHandle:
    """Line segments with a colour for each end: the browser does not take that up from a single one later."""
    colours = np.full((count, 2, 3), 128, np.uint8)
    return scene.add_line_segments(
        name, np.zeros((count, 2, 3), np.float32), colours, thickness=width_px, thickness_units="screen"
    )


def knows_something(status: LimiterStatus) -> bool:
    """Whether there is anything to draw: a vehicle without sensors of obstacles has no ring."""
    return max(status.sectors_m) >= 0.0 or status.why not in ("clear", "floor", "ceiling", "fence")


_PX = 84.0  # radius of the safe zone's limit
_SIDE = 2.0 * (_PX * _BEYOND + 4.0)


def hud_html(status: LimiterStatus, yaw_rad: float) -> str:
    """The ring as a drawing over the picture, the vehicle's nose up, with speeds and reason below it.

    Args:
        status: newest of the limiter.
        yaw_rad: heading of the vehicle, rad.
    """
    scale, drawn = _PX / status.h_max_m, sectors(status)
    rim = _PX * _BEYOND
    paths = [f'<circle r="{rim:.1f}" fill="rgb{ZONES["blind"]}" fill-opacity="0.25"/>']
    for zone in [zone for zone in ZONES if zone != "blind"]:
        if pieces := "".join(_sector(k, s.fill_m * scale) for k, s in enumerate(drawn) if s.filled == zone):
            paths.append(f'<path d="{pieces}" fill="rgb{ZONES[zone]}" fill-opacity="0.75"/>')
        edges = [(k, s) for k, s in enumerate(drawn) if s.zone == zone != "safe"]
        if pieces := "".join(_edge(k, s.near_m * scale) for k, s in edges):
            paths.append(f'<path d="{pieces}" fill="none" stroke="rgb{ZONES[zone]}" stroke-width="4"/>')
    circles = "".join(
        f'<circle r="{getattr(status, name) * scale:.1f}" fill="none" stroke="rgb{colour}" stroke-width="1.2" '
        f'stroke-dasharray="3 3"/>'
        for name, colour in _LIMITS
    )
    circles += f'<circle r="{rim:.1f}" fill="none" stroke="rgb{ZONES[status.zone]}" stroke-width="3"/>'
    near, marker = nearest_m(status), ""
    if near is not None:
        r = min(math.hypot(near[0], near[1]), status.h_max_m) * scale
        angle = math.atan2(near[1], near[0])
        x, y = r * math.sin(angle), -r * math.cos(angle)
        marker = (
            f'<path d="M0 0L{x:.1f} {y:.1f}" stroke="#fff" stroke-width="2"/>'
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="rgb{ZONES[status.zone]}" stroke="#fff" stroke-width="1.5"/>'
        )
    half = _SIDE / 2
    drawing = (
        f'<svg width="{_SIDE:.0f}" height="{_SIDE:.0f}" viewBox="{-half:.0f} {-half:.0f} {_SIDE:.0f} {_SIDE:.0f}">'
        f'<g transform="rotate({-math.degrees(yaw_rad):.1f})">{"".join(paths)}{circles}{marker}</g>'
        f'<path d="M0 -9L6 7L0 3L-6 7Z" fill="#e6edf3" stroke="#0d1117"/></svg>'
    )
    return f'<div class="or free"><div class="hud">{drawing}{words_html(status)}</div></div>'


def words_html(status: LimiterStatus) -> str:
    """Zone, nearest obstacle, asked and allowed speed, and why, as HTML."""
    red, green, blue = ZONES[status.zone]
    near = f"{status.label or 'nearest'} {status.distance_m:.2f} m" if status.distance_m >= 0 else "nothing near"
    down = status.ned_direction[2]
    near += "" if abs(down) < _STEEP else " below" if down > 0 else " above"
    slowed = status.allowed_m_s < status.asked_m_s - 0.01
    speeds = f"asked {status.asked_m_s:.1f}, allowed {status.allowed_m_s:.1f} m/s"
    return (
        f'<b style="color:rgb({red},{green},{blue})">{escape(status.zone)}</b> · {escape(near)}<br>'
        f'<span class="{"o" if slowed else ""}">{speeds}</span><br>'
        f"<small>{escape(_WHY.get(status.why, status.why))}</small>"
    )


_WHY: dict[str, str] = {
    "clear": "nothing is taken away",
    "curve": "slows down: the curve",
    "bound": "slows down: what can be braked",
    "blind": "slows down: nothing is seen there",
    "floor": "slows down: lowest height",
    "ceiling": "slows down: greatest height",
    "fence": "slows down: the fence",
    "push-back": "backs away",
    "no data": "stands: no obstacle data",
}


def _edge(k: int, radius_px: float) -> str:
    """Path along the outer edge of one sector, north up."""
    a, b = k * _STEP_RAD, (k + 1) * _STEP_RAD
    r = f"{radius_px:.1f}"
    return (
        f"M{radius_px * math.sin(a):.1f} {-radius_px * math.cos(a):.1f}"
        f"A{r} {r} 0 0 1 {radius_px * math.sin(b):.1f} {-radius_px * math.cos(b):.1f}"
    )


def _sector(k: int, radius_px: float) -> str:
    """Path of one sector from the centre outwards, north up."""
    a, b = k * _STEP_RAD, (k + 1) * _STEP_RAD
    r = f"{radius_px:.1f}"
    return (
        f"M0 0L{radius_px * math.sin(a):.1f} {-radius_px * math.cos(a):.1f}"
        f"A{r} {r} 0 0 1 {radius_px * math.sin(b):.1f} {-radius_px * math.cos(b):.1f}Z"
    )
