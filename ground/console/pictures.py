"""What each browser sees behind the panels: the camera's picture, on which a box is drawn, or the 3-D view."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import viser

from common.messages import person_label
from ground.console.captions import hint, target_caption
from ground.console.collector import Collector
from ground.console.config import ConsoleConfig
from ground.console.overlay import (
    GREEN,
    ORANGE,
    Caption,
    Letterbox,
    Painter,
    Pixels,
    blank,
    decode,
    on_canvas,
)
from ground.console.people_boxes import carried, scaled
from ground.console.people_cards import COLOURS
from ground.console.snapshot import APPROACH, PURSUIT_CAMERA, TRACK, Picture, Snapshot
from ground.console.target import pixels_of

_BOX_MIN_PX = 8.0
_STALE_REDRAW_NS = 250_000_000
_WAIT_FOR_BOX_NS = 150_000_000
_EMPTY = (640, 480)


class BoxRefused(ValueError):
    """A drawn box that names no target; the text says why."""


@dataclass(frozen=True)
class Shown:
    """A live picture as a browser shows it."""

    letterbox: Letterbox
    """Where it lies on its canvas."""
    capture_ns: int
    """Its capture stamp."""
    camera: str = PURSUIT_CAMERA
    """Which camera took it."""


@dataclass(frozen=True)
class DrawnBox:
    """A box that an operator drew on a picture."""

    box_px: tuple[float, float, float, float]
    """x, y, width, height, px."""
    capture_ns: int
    """Capture stamp of the picture."""
    camera: str
    """Which camera took it."""


@dataclass
class Viewer:
    """One browser."""

    client: viser.ClientHandle
    """Its handle."""
    shows_picture: bool = True
    """Whether it shows the picture; else the 3-D view."""
    shown: Shown | None = None
    """What lies on its canvas; None without a live picture."""
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Held while it turns from picture to 3-D view or back, and while a picture is sent: one that came late would stay
    behind the 3-D view."""


def choose_picture(pictures: Iterable[Picture], view: Snapshot) -> Picture | None:
    """Picture to show: the one that the newest box belongs to, unless a newer one is much newer.

    The box comes some 10 ms after its picture; drawn on the next picture it would trail a moving target.
    """
    recent = list(pictures)
    if not recent:
        return None
    newest = recent[-1]
    wanted_ns = _drawn_on_ns(view)
    if wanted_ns is not None:
        for picture in reversed(recent):
            if picture.capture_ns == wanted_ns and newest.received_ns - picture.received_ns <= _WAIT_FOR_BOX_NS:
                return picture
    return newest


def _drawn_on_ns(view: Snapshot) -> int | None:
    """Capture stamp of the picture that is drawn on: the chased target's, the followed one's, people's, or None."""
    boxed = view.track is not None and view.fresh(TRACK) and view.track.state != "idle"
    if boxed and view.shown == PURSUIT_CAMERA:
        return view.track_capture_ns
    if view.followed_in_picture is not None:
        return view.followed_capture_ns
    return view.detections_capture_ns if view.in_picture is not None and view.in_picture.people else None


class PictureBoard:
    """Sends pictures to the browsers and takes the boxes that are drawn on them.

    Args:
        config: rate, quality, age limits.
        on_box: called in a thread of the server with the browser and what was drawn.
        on_refusal: called with the browser and the reason why a drawn box names no target.
        on_ray: called with the browser and a click into the 3-D view.
    """

    def __init__(
        self,
        config: ConsoleConfig,
        on_box: Callable[[viser.ClientHandle, DrawnBox], None],
        on_refusal: Callable[[viser.ClientHandle, str], None],
        on_ray: Callable[[viser.ClientHandle, viser.SceneClickEvent], None],
    ):
        self._config = config
        self._on_box = on_box
        self._on_refusal = on_refusal
        self._on_ray = on_ray
        self._painter = Painter()
        self._lock = threading.Lock()
        self._viewers: dict[int, Viewer] = {}
        self._due_ns = 0
        self._drawn: tuple[object, int] | None = None
        self._decoded: tuple[int, Pixels | None] | None = None
        self.sent = 0
        """Pictures sent, all browsers together."""

    @property
    def viewers(self) -> list[Viewer]:
        """The browsers that are connected."""
        with self._lock:
            return list(self._viewers.values())

    def add(self, client: viser.ClientHandle) -> Viewer:
        """Take in a browser; it begins with the picture."""
        viewer = Viewer(client)
        with self._lock:
            self._viewers[client.client_id] = viewer
        self.show_picture(viewer)
        return viewer

    def remove(self, client: viser.ClientHandle) -> None:
        """Forget a browser that left."""
        with self._lock:
            self._viewers.pop(client.client_id, None)

    def show_picture(self, viewer: Viewer) -> None:
        """Show the picture; a drag on it draws a box."""
        with viewer.lock:
            viewer.shows_picture = True
        viewer.client.scene.set_global_visibility(False)
        viewer.client.scene.remove_rect_select_callback("all")
        viewer.client.scene.remove_click_callback("all")
        # No modifier key: a tablet has none.
        viewer.client.scene.on_rect_select()(lambda event: self._take_box(viewer, event))
        self._drawn = None

    def show_scene(self, viewer: Viewer) -> None:
        """Show the 3-D view; a drag turns it."""
        with viewer.lock:
            viewer.shows_picture = False
            viewer.shown = None
            viewer.client.scene.set_background_image(None)
        viewer.client.scene.remove_rect_select_callback("all")
        viewer.client.scene.remove_click_callback("all")
        viewer.client.scene.on_click()(lambda event: self._on_ray(viewer.client, event))
        viewer.client.scene.set_global_visibility(True)

    def update(self, collector: Collector, view: Snapshot) -> None:
        """Send what is due to the browsers that show the picture."""
        viewers = [v for v in self.viewers if v.shows_picture]
        if not viewers or view.t_ns < self._due_ns:
            return
        picture = choose_picture(collector.pictures, view)
        live = picture is not None and view.picture_live
        shapes = tuple(_aspect(v.client) for v in viewers)
        # A picture is drawn again for a new box or window shape; an old one also because its age is written on it.
        stamp = (
            (picture.capture_ns, view.track_capture_ns, view.followed_capture_ns, view.detections_capture_ns, shapes)
            if picture is not None and live
            else (view.t_ns // _STALE_REDRAW_NS, shapes)
        )
        if self._drawn is not None and self._drawn[0] == stamp:
            return
        self._drawn = (stamp, view.t_ns)
        period_ns = round(1e9 / self._config.picture_rate_hz)
        self._due_ns = max(self._due_ns + period_ns, view.t_ns)
        drawn = self._draw(picture, view, live, collector)
        canvases: dict[float, tuple[Pixels, Letterbox]] = {}
        for viewer, aspect in zip(viewers, shapes, strict=True):
            if aspect not in canvases:
                box = Letterbox.fit(drawn.shape[1], drawn.shape[0], aspect)
                canvases[aspect] = (on_canvas(drawn, box), box)
            canvas, box = canvases[aspect]
            with viewer.lock:
                if not viewer.shows_picture:
                    continue
                viewer.client.scene.set_background_image(canvas, "jpeg", jpeg_quality=self._config.jpeg_quality)
                viewer.shown = Shown(box, picture.capture_ns, view.shown) if picture is not None and live else None
            self.sent += 1

    def _draw(self, picture: Picture | None, view: Snapshot, live: bool, collector: Collector) -> Pixels:
        pixels = self._pixels(picture)
        if picture is None or pixels is None:
            empty = blank(*_EMPTY)
            self._painter.stale(
                empty, "NO PICTURE YET" if picture is None else "UNREADABLE PICTURE", "waiting for the camera"
            )
            return empty
        drawn = pixels.copy()
        if not live:
            self._painter.stale(drawn, f"NO PICTURE {view.picture_age_ms / 1000:.1f} s", "what is shown here is old")
            return drawn
        self._draw_people(drawn, picture, view, collector)
        if view.track is not None and view.fresh(TRACK) and view.shown == PURSUIT_CAMERA:
            self._painter.target(drawn, view.track)
        if (followed := view.followed_in_picture) is not None and view.members is not None:
            self._painter.followed(drawn, followed, view.members.members, view.following)
        self._draw_approach(drawn, picture, view, collector)
        self._painter.aim(drawn)
        shown_age_ms = (view.t_ns - picture.taken_ns) / 1e6
        left = Caption(f"LIVE  {shown_age_ms:.0f} ms", GREEN if shown_age_ms < 200 else ORANGE)
        self._painter.captions(drawn, left, target_caption(view), hint(view))
        return drawn

    def _draw_people(self, drawn: Pixels, picture: Picture, view: Snapshot, collector: Collector) -> None:
        found = view.in_picture
        if found is None:
            return
        known = {person.number: person for person in view.people.people} if view.people is not None else {}
        scale_x, scale_y = picture.width / found.width, picture.height / found.height
        then, now = (collector.state_at(stamp_ns) for stamp_ns in (view.detections_capture_ns, picture.capture_ns))
        for someone in carried(found, view.camera, then, now):
            person = known.get(someone.number)
            word = person_label(someone.number) if person is None else person.name
            state = "provisional" if person is None else person.state
            if state != "dismissed":
                self._painter.person(drawn, scaled(someone, scale_x, scale_y), word, COLOURS[state])

    def _draw_approach(self, drawn: Pixels, picture: Picture, view: Snapshot, collector: Collector) -> None:
        target, state = view.approach, collector.state_at(picture.capture_ns)
        if target is None or not view.fresh(APPROACH) or target.state == "idle" or state is None:
            return
        if view.camera is not None:
            x, y = pixels_of([target.ned_p_m], view.camera, state)[0]
            word = f"{target.label or 'approach'}  {target.distance_m:.1f} m"
            self._painter.mark(drawn, float(x), float(y), word, GREEN if target.state == "tracking" else ORANGE)

    def _pixels(self, picture: Picture | None) -> Pixels | None:
        if picture is None:
            return None
        if self._decoded is None or self._decoded[0] != picture.capture_ns:
            self._decoded = (picture.capture_ns, decode(picture.jpeg))
        return self._decoded[1]

    def _take_box(self, viewer: Viewer, event: viser.SceneRectSelectEvent) -> None:
        try:
            drawn = drawn_box(viewer.shown, event.screen_min, event.screen_max)
        except BoxRefused as refusal:
            self._on_refusal(viewer.client, str(refusal))
            return
        self._on_box(viewer.client, drawn)


def drawn_box(shown: Shown | None, corner_min: tuple[float, float], corner_max: tuple[float, float]) -> DrawnBox:
    """What a drag over the canvas means.

    Args:
        shown: what lies on the canvas; None without a live picture.
        corner_min: upper left corner, canvas 0..1.
        corner_max: lower right corner.

    Raises:
        BoxRefused: no live picture, a box beside the picture, or one too small to be meant.
    """
    if shown is None:
        raise BoxRefused("There is no live picture to choose a target from; wait for the picture.")
    box = shown.letterbox.box(corner_min, corner_max)
    if box is None:
        raise BoxRefused("The box lies beside the picture; draw it on the target.")
    if min(box[2:]) < _BOX_MIN_PX:
        raise BoxRefused(
            f"The box is {box[2]:.0f} x {box[3]:.0f} px; draw at least {_BOX_MIN_PX:.0f} x "
            f"{_BOX_MIN_PX:.0f} px, all around the target."
        )
    return DrawnBox(box, shown.capture_ns, shown.camera)


def _aspect(client: viser.ClientHandle) -> float:
    height = client.camera.image_height
    return round(client.camera.image_width / height, 3) if height > 0 else 4 / 3
