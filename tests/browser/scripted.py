"""A scripted vehicle on a real bus: pictures, states and answers that a test decides, as input of the console."""

from __future__ import annotations

import contextlib
import math
import threading
import time

import cv2
import numpy as np

from common.bus import Bus, Query
from common.geometry.camera import Camera
from common.geometry.config import CameraConfig
from common.geometry.rotation import as_quat, quat_from_euler
from common.header import Received
from common.messages import (
    Command,
    FollowMembers,
    Health,
    HelmStatus,
    Image,
    Obstacles,
    People,
    PeopleDetections,
    PersonPicture,
    Reply,
    Request,
    Session,
    Setpoint,
    Track,
)
from common.session import BusConfig
from common.topics import COMMANDS, health_topic
from tests.browser.script import Script
from tests.flying import flying

_LONGEST_S = 60.0
"""How long a held command waits for its test, s."""
NODES = ("camera", "follow", "helm", "people", "pursuit", "recorder", "world")


def ground_picture(camera: Camera) -> np.ndarray:
    """A meadow with a path, (H, W, 3), BGR."""
    rng = np.random.default_rng(7)
    coarse = cv2.resize(
        rng.normal(0, 1, (24, 32)).astype(np.float32), (camera.width, camera.height), interpolation=cv2.INTER_CUBIC
    )
    fine = rng.normal(0, 1, (camera.height, camera.width)).astype(np.float32)
    tone = 12 * coarse + 4 * fine
    picture = np.stack((52 + tone * 0.6, 96 + tone, 84 + tone * 0.9), axis=2)
    picture = np.clip(picture, 0, 255).astype(np.uint8)
    cv2.line(picture, (-20, 420), (700, 120), (118, 130, 138), 46, cv2.LINE_AA)
    for x, y, r in ((90, 90, 34), (520, 400, 42), (590, 60, 26), (200, 430, 22)):
        cv2.circle(picture, (x, y), r, (38, 74, 44), -1, cv2.LINE_AA)
        cv2.circle(picture, (x - r // 4, y - r // 4), r // 2, (48, 92, 58), -1, cv2.LINE_AA)
    return picture


class ScriptedVehicle:
    """Publishes what the script says at the rates of the real nodes, and answers every command.

    Args:
        bus_config: routers.
    """

    def __init__(self, bus_config: BusConfig):
        self.script = Script()
        self.commands: list[tuple[str, Command]] = []
        self.captures: list[int] = []
        """Capture stamps of the pictures sent."""
        self._buses = {name: Bus(bus_config, "onboard", name) for name in NODES}
        for bus in self._buses.values():
            bus.announce()
        self.requests: list[Received[Request]] = []
        """What came as requests of the operator."""
        self._buses["helm"].subscribe("helm/request/operator", self.requests.append)
        for name in COMMANDS:
            self._buses["helm"].serve(name, self._answer)
        self.camera = CameraConfig().camera()
        self._ground = ground_picture(self.camera)
        self._stop = threading.Event()
        self._begin = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        self._thread.join(timeout=5)
        for bus in self._buses.values():
            bus.close()

    def lose(self, node: str) -> None:
        """End a node: its token and its streams go."""
        self._buses.pop(node).close()

    def car(self, t_s: float) -> tuple[float, float, float]:
        """Place and heading of the car in the picture: x, y, px, and rad."""
        if not self.script.moving:
            return 320.0, 240.0, 0.4
        return 320 + 90 * math.cos(0.4 * t_s), 240 + 60 * math.sin(0.4 * t_s), 0.4 + 0.3 * math.sin(0.3 * t_s)

    def _answer(self, query: Query) -> None:
        self.commands.append((query.name, query.command))
        reply = self.script.replies.get(query.name, Reply(outcome="done"))
        held = self.script.held.get(query.name)
        if held is None:
            query.reply(reply)
        else:  # the callback runs in the bus's thread: to wait there would hold up every other command
            threading.Thread(target=lambda: held.wait(_LONGEST_S) and query.reply(reply), daemon=True).start()

    def _run(self) -> None:
        tick = 0
        while not self._stop.wait(0.05):
            tick += 1
            t_s = time.monotonic() - self._begin
            with contextlib.suppress(KeyError):  # a node that the test has ended
                if self.script.pictures:
                    self._picture(t_s)
                self._state(t_s)
                if tick % 4 == 0 and self.script.status:
                    self._status()
                if tick % 2 == 0:
                    self._surroundings()
            if tick % 20 == 1:
                self._housekeeping()

    def _picture(self, t_s: float) -> None:
        picture = self._ground.copy()
        x, y, angle = self.car(t_s)
        box = cv2.boxPoints(((x, y), (70.0, 34.0), math.degrees(angle))).astype(np.int32)
        cv2.fillPoly(picture, [np.add(box, (5, 6))], (30, 52, 46))
        cv2.fillPoly(picture, [box], (40, 40, 200), cv2.LINE_AA)
        cv2.circle(picture, (round(x + 12 * math.cos(angle)), round(y + 12 * math.sin(angle))), 9, (70, 60, 60), -1)
        capture_ns = time.monotonic_ns()
        _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])
        image = Image(
            camera="down", width=self.camera.width, height=self.camera.height, encoding="jpeg", data=jpeg.tobytes()
        )
        self._buses["camera"].publish("camera/down/jpeg", image, capture_ns)
        if self.script.people:
            found = PeopleDetections(
                camera="down",
                width=self.camera.width,
                height=self.camera.height,
                people=self.script.detections,
                with_depth=True,
            )
            self._buses["people"].publish("people/detections", found, capture_ns)
        self.captures.append(capture_ns)
        self._follow(capture_ns)
        if not self.script.track_state:
            return
        track = Track(
            state=self.script.track_state,
            x_px=x,
            y_px=y,
            width_px=74,
            height_px=38,
            angle_rad=angle,  # type: ignore[arg-type]
            distance=0.12 if self.script.track_state == "tracking" else 0.61,
            distance_limit=0.45,
            error=((240 - y) / 440, (x - 320) / 440),
            error_m=1.0,
        )
        self._buses["pursuit"].publish("pursuit/track", track, capture_ns)

    def _follow(self, capture_ns: int) -> None:
        members = self.script.members
        track = Track(state="idle", reason="no target")
        if members and members[0].box_px is not None:
            x, y, width, height = members[0].box_px
            track = Track(state="tracking", x_px=x + width / 2, y_px=y + height / 2, width_px=width, height_px=height)
        self._buses["follow"].publish("follow/track", track, capture_ns)
        self._buses["follow"].publish("follow/members", FollowMembers(camera="down", members=members), capture_ns)

    def _state(self, t_s: float) -> None:
        s = self.script
        attitude = as_quat(quat_from_euler(0.05 * math.sin(t_s), -0.12, 0.5 + 0.1 * math.sin(0.3 * t_s)))
        north, east, down = s.position_m
        position = (north + 2 * math.cos(0.2 * t_s), east + 2 * math.sin(0.2 * t_s), down)
        velocity = (-0.4 * math.sin(0.2 * t_s), 0.4 * math.cos(0.2 * t_s), 0.0)
        self._buses["helm"].publish(
            "helm/state",
            flying(
                ned_p_m=position,
                ned_v_m_s=velocity,
                ned_q_body=attitude,
                armed=s.armed,
                in_air=s.in_air,
                mode=s.mode,
                battery_fraction=s.battery,
            ),
        )
        if s.in_air:
            self._buses["helm"].publish(
                "helm/setpoint",
                Setpoint(
                    source=s.source,
                    asked_ned_v_m_s=(1.1, 0.9, 0.0),
                    ned_v_m_s=(0.8, 0.5, 0.0),
                    height_m=5.0,
                    yaw_rad=0.5,
                ),
            )

    def _status(self) -> None:
        s = self.script
        self._buses["helm"].publish(
            "helm/status",
            HelmStatus(
                state=s.state,
                source=s.source,
                reason=s.reason,
                streaming=s.in_air,
                mode=s.mode,
                armed=s.armed,
                in_air=s.in_air,
                limiter_zone=s.zone,
                limiter_distance_m=s.distance_m,
                request_age_ms=42.0,
                preflight=s.preflight,
            ),
        )

    def _surroundings(self) -> None:
        s = self.script
        if s.limiter is not None:
            self._buses["helm"].publish("helm/limiter", s.limiter)
        if s.approach is not None:
            self._buses["helm"].publish("approach/target", s.approach)
        if s.search is not None:
            self._buses["helm"].publish("search/status", s.search)
        if s.people:
            self._buses["people"].publish("people/tracks", People(people=s.people))
        if s.obstacles:
            self._buses["world"].publish("obstacles/depth", Obstacles(obstacles=s.obstacles))

    def _housekeeping(self) -> None:
        now_ns = time.monotonic_ns()
        for number, jpeg in self.script.faces.items():
            picture = PersonPicture(number=number, taken_ns=now_ns, jpeg=jpeg)
            self._buses["people"].publish("people/pictures", picture)
        for name, bus in list(self._buses.items()):
            bus.publish(
                health_topic(name).name,
                Health(
                    node=name,
                    pid=1000,
                    steps=200,
                    step_ms_median=3.1,
                    step_ms_max=9.0,
                    input_age_ms={},
                    dropped={},
                    rejected={},
                    errors=0,
                ),
            )
        with contextlib.suppress(KeyError):
            self._buses["camera"].publish("camera/down/info", self.camera.info("down"))
            self._buses["helm"].publish("session", Session(vehicle="kite", monotonic_ns=now_ns, utc_ns=time.time_ns()))
