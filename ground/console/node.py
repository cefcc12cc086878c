"""The operator console as a node: gathers what comes from the bus, serves a web page, gives the operator's commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
import viser

from common.config import Config, ConfigError
from common.geometry.config import CamerasConfig
from common.geometry.rotation import as_vec3
from common.messages import Command, VehicleState
from common.node import Inputs, Node, On, Output
from common.session import BusConfig
from ground.console.collector import Collector
from ground.console.commands import CHOOSE, SELECT, SELECT_FOLLOWED, Commander
from ground.console.config import ConsoleConfig
from ground.console.notes import Notes
from ground.console.page import Page
from ground.console.people_cards import listed
from ground.console.pictures import DrawnBox, PictureBoard
from ground.console.plot import ErrorHistory
from ground.console.scene import SceneView
from ground.console.server import open_server
from ground.console.snapshot import PURSUIT_CAMERA, STATE, STATUS, TRACK, Snapshot, picture_topic
from ground.console.stick import Stick
from ground.console.stick_link import StickLink
from ground.console.target import bearing_rad, point_on_ray
from ground.console.watch import LifeWatch

_RATE_WINDOW_NS = 3_000_000_000


class ConsoleNode(Node):
    """Web page for the operator; everything it can do, the command line can do too.

    Args:
        config: sections `console`, `camera` (which cameras there are) and `bus` (the vehicle's name).
        name: node name.

    Raises:
        ConfigError: the address cannot be used, the port is taken, or the vehicle lacks the camera to begin with.
    """

    outputs = ("helm/request/operator",)

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        settings = config.section(ConsoleConfig)
        cameras = tuple(config.section(CamerasConfig).by_name())
        if settings.camera not in cameras:
            raise ConfigError(
                f"console.camera: got {settings.camera!r}, which this vehicle lacks; expected one of "
                f"{', '.join(cameras)}, or a section [camera.{settings.camera}]"
            )
        self._collector = Collector(settings.nodes, cameras, settings.camera)
        self.inputs = self._collector.inputs
        pictures = tuple(picture_topic(camera) for camera in cameras)
        self.trigger = On((*pictures, TRACK), at_least_every_s=0.05)
        self.on_demand = dict.fromkeys(pictures, ())
        self._history = ErrorHistory(settings.history_s)
        self._arrivals_ns: deque[int] = deque()
        self._snapshot: Snapshot | None = None
        self._stick = Stick()
        self._stick_link = StickLink(self._stick)
        label = f"Outrider · {config.section(BusConfig).vehicle}"
        self._server = open_server(settings, label, (self._stick_link,))
        self._commander = Commander(lambda command, argument: self.query(command, argument))
        self._notes = Notes(self._commander)
        self._page = Page(self._server, settings, self._commander, self._notes, cameras)
        self._scene = SceneView(self._server, settings)
        self._board = PictureBoard(
            settings,
            on_box=self._choose_in_picture,
            on_refusal=lambda client, reason: self._notes.refuse(client, SELECT, reason),
            on_ray=self._choose_thing,
        )
        self._watch = LifeWatch(lambda: self.alive(), wanted=lambda: bool(self._board.viewers))
        self._server.on_client_connect(self._welcome)
        self._server.on_client_disconnect(self._board.remove)
        self._watch.start()

    def wants(self, topic: str) -> bool:
        """Pictures of one camera at a time: the others stay on the vehicle, as far as the console is concerned."""
        return topic == picture_topic(self._collector.shown)

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Take over what is new; ask for what the stick asks for; draw what is due, for those who look."""
        self._collector.look_through(self._page.camera, t_ns)
        self._collector.collect(inputs)
        self._count_pictures(t_ns)
        view = self._collector.snapshot(inputs, t_ns, self._watch.alive)
        self._snapshot = view
        request = self._stick_request(inputs, view)
        self._history.add(view)
        self._scene.note(view, self._collector)
        viewers = self._board.viewers
        if viewers:
            self._board.update(self._collector, view)
            self._page.update(view, self._history, len(self._arrivals_ns) / (_RATE_WINDOW_NS / 1e9))
            if not all(viewer.shows_picture for viewer in viewers):
                self._scene.update(view, self._collector)
        return () if request is None else (request,)

    def _choose_in_picture(self, client: viser.ClientHandle, drawn: DrawnBox) -> None:
        """A box is for the follower where the page says so; else one on the chase's camera selects its target, and one
        on another camera what to approach, by its direction."""
        if self._page.chooses_followed:
            self._choose_followed(client, drawn)
            return
        if drawn.camera == PURSUIT_CAMERA:
            self._notes.give(client, SELECT, Command(box_px=drawn.box_px, capture_ns=drawn.capture_ns))
            return
        view = self._snapshot
        camera = None if view is None else view.cameras.get(drawn.camera)
        state = self._collector.state_at(drawn.capture_ns)
        if camera is None or state is None:
            self._notes.refuse(client, CHOOSE, "The camera's calibration or the vehicle's attitude is not known yet.")
            return
        x, y, width, height = drawn.box_px
        bearing = bearing_rad(camera, state, x + width / 2, y + height / 2)
        self._notes.give(client, CHOOSE, Command(bearing_rad=bearing))

    def _choose_followed(self, client: viser.ClientHandle, drawn: DrawnBox) -> None:
        """A box on the camera that is followed."""
        members = None if self._snapshot is None else self._snapshot.members
        if members is None:
            self._notes.refuse(client, SELECT_FOLLOWED, "No word from the follower: is the node `follow` running?")
        elif members.camera != drawn.camera:
            reason = f"The box is on the camera {drawn.camera}; the vehicle follows by {members.camera}: draw it there."
            self._notes.refuse(client, SELECT_FOLLOWED, reason)
        else:
            argument = Command(box_px=drawn.box_px, capture_ns=drawn.capture_ns)
            self._notes.give(client, SELECT_FOLLOWED, argument)

    def _choose_thing(self, client: viser.ClientHandle, event: viser.SceneClickEvent) -> None:
        """A click into the 3-D view on a person chooses them in the list, one on an obstacle selects it for the
        approach; one elsewhere means nothing."""
        view = self._snapshot
        if view is None:
            return
        eye, ray = np.asarray(event.ray_origin), np.asarray(event.ray_direction)
        people = view.people.people if view.people is not None else ()
        placed = {as_vec3(p.ned_p_m): p for p in listed(people) if p.ned_p_m is not None}
        person = point_on_ray([np.asarray(place) for place in placed], eye, ray)
        if person is not None:
            self._page.people.choose(placed[as_vec3(person)].number)
            return
        if view.state is None or not view.fresh(STATE):
            return
        points = [np.asarray(view.state.ned_p_m) + o.distance_m * np.asarray(o.ned_direction) for o in view.obstacles]
        point = point_on_ray(points, eye, ray)
        if point is not None:
            self._notes.give(client, CHOOSE, Command(ned_p_m=as_vec3(point)))

    def _stick_request(self, inputs: Inputs, view: Snapshot) -> Output | None:
        """What the stick asks for, stamped with the vehicle's clock when the operator's page said so."""
        self._stick_link.helm = stick_words(view)
        asked = self._stick.ask(view.t_ns, self._page.stick_speeds)
        state = inputs.latest(STATE, VehicleState)
        if asked is None or state is None:
            return None
        # The newest state came a little after the page spoke, or before; what the operator saw is no newer than that.
        basis_ns = state.header.capture_ns - max(0, state.received_ns - asked.heard_ns)
        return Output("helm/request/operator", asked.request, basis_ns)

    def metrics(self) -> dict[str, float]:
        """Browsers, pictures sent to them, and pages that hold the stick."""
        return {
            "browsers": float(len(self._board.viewers)),
            "pictures_sent": float(self._board.sent),
            "sticks": float(self._stick.hands),
        }

    def close(self) -> None:
        """End the page."""
        self._watch.close()
        self._server.stop()

    def _count_pictures(self, t_ns: int) -> None:
        newest = self._collector.pictures[-1].received_ns if self._collector.pictures else None
        if newest is not None and (not self._arrivals_ns or newest > self._arrivals_ns[-1]):
            self._arrivals_ns.append(newest)
        while self._arrivals_ns and self._arrivals_ns[0] < t_ns - _RATE_WINDOW_NS:
            self._arrivals_ns.popleft()

    def _welcome(self, client: viser.ClientHandle) -> None:
        viewer = self._board.add(client)
        button = self._page.add_view_button(client)

        @button.on_click
        def _(_: viser.GuiEvent) -> None:
            if viewer.shows_picture:
                self._board.show_scene(viewer)
                self._scene.look_from_behind(client, self._snapshot)
                button.label, button.icon = "Show picture", viser.Icon.PHOTO
            else:
                self._board.show_picture(viewer)
                button.label, button.icon = "Show 3-D view", viser.Icon.CUBE


def stick_words(view: Snapshot) -> str:
    """What helm makes of the stick now, in words for who holds it."""
    status = view.status
    if status is None or not view.fresh(STATUS):
        return "no word from helm: the stick does nothing"
    if status.state == "operator":
        return "flying by your stick"
    if status.state in ("hold", "pursuit", "follow", "approach", "returning"):
        return f"ready (helm: {status.state}); move to fly"
    return f"helm is {status.state}: the stick does nothing"
