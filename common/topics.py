"""The one list of streams and commands: type, rate, age, delivery, recording. No key string stands anywhere else.

Nodes name topics (`camera/down/jpeg`); the bus turns them into keys (`outrider/<vehicle>/camera/down/jpeg`).
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal

from common import messages as m
from common.truth import Truth

Delivery = Literal["latest", "queue"]
Priority = Literal["real_time", "interactive_high", "data", "data_low", "background"]


@dataclass(frozen=True)
class Topic:
    """One stream of the bus."""

    name: str
    """Name after the vehicle segment."""
    type: type[m.Message]
    """Message type."""
    rate_hz: float
    """Nominal rate, Hz; 0 for events."""
    max_age_ms: float
    """A reader ignores the newest message when it is older than this, ms after receipt."""
    delivery: Delivery = "latest"
    """`latest`: a ring of one, a slow reader skips. `queue`: up to 256 in order, the oldest dropped and counted."""
    priority: Priority = "data"
    """Zenoh priority."""
    reliable: bool = True
    """Reliable transport; congestion drops rather than blocks: a stalled reader must not stall the vehicle."""
    recorded: bool = True
    """Whether the recorder keeps it."""
    crosses_link: bool = True
    """Whether it may leave the vehicle's side."""
    written_by: tuple[str, ...] = ()
    """Who may write it, where that is not the node that the name begins with (`writers`)."""
    simulated: bool = False
    """Whether it is the simulator's own knowledge: no secured link carries it."""
    doc: str = ""
    """One line for `outrider topics`."""

    @property
    def writers(self) -> tuple[str, ...]:
        """Names of the nodes that may write it."""
        return self.written_by or (self.name.split("/")[0],)


CAMERAS = ("down", "front")
"""Names of the cameras that a vehicle may have; each has the same streams."""


def _picture(name: str, doc: str, **differences: Any) -> Topic:
    """Stream of pictures: lossy, late-free, out of the way of everything else, and kept on its side of the link."""
    settings: dict[str, Any] = {"recorded": False, "crosses_link": False} | differences
    return Topic(name, m.Image, 20, 500, priority="data_low", reliable=False, doc=doc, **settings)


def _camera_topics(name: str) -> tuple[Topic, ...]:
    simulated: dict[str, Any] = {"written_by": ("world",), "simulated": True}
    return (
        _picture(f"sim/camera/{name}", "the simulated camera's picture, before the camera node", **simulated),
        _picture(f"sim/camera/{name}/depth", "the simulated depth picture, before the camera node", **simulated),
        _picture(f"camera/{name}/raw", "picture for readers on board"),
        _picture(f"camera/{name}/jpeg", "picture for the ground, compressed", recorded=True, crosses_link=True),
        Topic(f"camera/{name}/info", m.CameraInfo, 1, 5000, doc="calibration of the camera"),
        _picture(f"camera/{name}/depth", "depth for readers on board, 16-bit millimetres"),
    )


_TOPICS = (
    *(topic for name in CAMERAS for topic in _camera_topics(name)),
    Topic(
        "helm/state",
        m.VehicleState,
        50,
        500,
        delivery="queue",
        priority="interactive_high",
        reliable=False,
        doc="the autopilot's estimate, mapped to the vehicle clock",
    ),
    Topic("helm/status", m.HelmStatus, 5, 1500, priority="interactive_high", doc="who commands the vehicle, and why"),
    Topic("helm/setpoint", m.Setpoint, 20, 500, delivery="queue", doc="each setpoint that went to the autopilot"),
    Topic(
        "helm/request/operator",
        m.Request,
        20,
        300,
        priority="real_time",
        written_by=("console", "stick", "cli"),
        doc="motion asked by the operator",
    ),
    Topic(
        "helm/request/pursuit",
        m.Request,
        20,
        300,
        priority="real_time",
        written_by=("pursuit",),
        doc="motion asked by the chase",
    ),
    Topic(
        "helm/request/follow",
        m.Request,
        20,
        300,
        priority="real_time",
        written_by=("follow",),
        crosses_link=False,
        doc="motion asked by the vehicle's own follower of a target",
    ),
    Topic(
        "helm/request/approach",
        m.Request,
        20,
        300,
        priority="real_time",
        written_by=("approach",),
        crosses_link=False,
        doc="motion asked by the approach to a person or an obstacle",
    ),
    Topic(
        "helm/request/search",
        m.Request,
        20,
        300,
        priority="real_time",
        written_by=("search",),
        crosses_link=False,
        doc="motion asked by the search over an area",
    ),
    Topic("search/status", m.SearchStatus, 5, 1500, doc="way of the search, and how far it is"),
    Topic("follow/track", m.Track, 20, 500, priority="interactive_high", doc="the followed target, as fused on board"),
    Topic("follow/members", m.FollowMembers, 10, 500, doc="where each of the follower's trackers sees its target"),
    Topic("approach/target", m.ApproachTarget, 10, 500, doc="what the approach has selected, and where it is"),
    Topic("helm/limiter", m.LimiterStatus, 10, 500, priority="interactive_high", doc="what the limiter does, and why"),
    Topic(
        "obstacles/depth",
        m.Obstacles,
        10,
        500,
        priority="interactive_high",
        written_by=("proximity", "sensor"),
        doc="nearest points of a depth picture, and what it sees, for the limiter",
    ),
    Topic(
        "obstacles/people",
        m.Obstacles,
        10,
        500,
        priority="interactive_high",
        written_by=("people", "sensor"),
        doc="people, for the limiter",
    ),
    Topic(
        "obstacles/circles",
        m.Obstacles,
        10,
        500,
        priority="interactive_high",
        written_by=("sensor",),
        doc="posts and trunks that a LIDAR sees, for the limiter",
    ),
    Topic("people/detections", m.PeopleDetections, 10, 500, doc="people in the newest picture: boxes, joints, places"),
    Topic("people/tracks", m.People, 5, 1500, doc="everybody who was seen: identity, name, state, place"),
    Topic(
        "people/pictures",
        m.PersonPicture,
        1,
        5000,
        delivery="queue",
        priority="background",
        doc="a picture of each person, in turn and when they changed",
    ),
    Topic("pursuit/track", m.Track, 20, 500, priority="interactive_high", doc="the chased target in the picture"),
    Topic("session", m.Session, 1, 5000, written_by=("router-onboard",), doc="vehicle clock against UTC"),
    Topic(
        "truth",
        Truth,
        20,
        500,
        delivery="queue",
        written_by=("world",),
        simulated=True,
        doc="the simulator's ground truth; no algorithm reads it",
    ),
)

_HEALTH_DOC = "what each node says of itself"


@dataclass(frozen=True)
class CommandSpec:
    """One command: a query to the node that answers it."""

    name: str
    """Key after the vehicle segment."""
    timeout_s: float
    """How long a client waits for the reply, s."""
    doc: str
    """One line for help texts."""


COMMANDS: dict[str, CommandSpec] = {
    c.name: c
    for c in (
        CommandSpec("helm/do/arm", 10, "arm the motors (the preflight gate must be open)"),
        CommandSpec("helm/do/disarm", 5, "stop the motors, on the ground only"),
        CommandSpec("helm/do/takeoff", 45, "arm if needed, take off and verify the climb; ends in hold"),
        CommandSpec("helm/do/hold", 5, "hover here and end any task"),
        CommandSpec("helm/do/land", 5, "land here"),
        CommandSpec("helm/do/return", 5, "fly home under the limiter and land"),
        CommandSpec("helm/do/engage", 5, "take the stick again after helm yielded or restarted; hovers"),
        CommandSpec("helm/do/chase", 5, "obey the pursuit"),
        CommandSpec("helm/do/follow", 5, "obey the vehicle's own follower of a target"),
        CommandSpec("helm/do/approach", 5, "obey the approach: fly up to what was selected, and hold there"),
        CommandSpec("helm/do/push-back", 5, "let the limiter back away from what is too near, or not: on, off"),
        CommandSpec(
            "approach/do/select",
            5,
            "choose what to approach: by its name, by a direction from the nose, or the nearest ahead",
        ),
        CommandSpec("approach/do/stop", 5, "forget what was to be approached"),
        CommandSpec("helm/do/search", 5, "obey the search: fly the lines over its area"),
        CommandSpec("search/do/start", 5, "lay out the way over `search.area`, from the first line on"),
        CommandSpec("search/do/stop", 5, "end the search"),
        CommandSpec("people/do/rename", 5, "call a person (--label) by a name (--name)"),
        CommandSpec("people/do/merge", 5, "two people are one: --label is the same as --into"),
        CommandSpec("people/do/dismiss", 5, "a person (--label) is nobody, or no longer of interest"),
        CommandSpec("follow/do/select", 15, "choose the target of the vehicle's own follower by a box in the picture"),
        CommandSpec("follow/do/stop", 5, "forget the follower's target"),
        CommandSpec("pursuit/do/select", 5, "choose the target by a box in the picture"),
        CommandSpec(
            "pursuit/do/find", 5, "look for the target of the picture `pursuit.model` names, until it is found"
        ),
        CommandSpec("pursuit/do/reinitialise", 5, "search the whole picture for the target and start anew on it"),
        CommandSpec("pursuit/do/stop", 5, "forget the target"),
    )
}


_BY_LAST_WORD = ("helm/", "pursuit/", "people/")
"""Nodes whose commands are known by their last word alone."""


def commands_by_word() -> dict[str, str]:
    """Commands by their word on the command line: the last part of the name, or node and last part where that is taken
    or says little by itself.

    `select` is `pursuit/do/select`, `approach-select` is `approach/do/select`, `search-start` is `search/do/start`.
    """
    words: dict[str, str] = {}
    for name in sorted(COMMANDS, key=lambda n: not n.startswith(_BY_LAST_WORD)):
        node, _, last = name.partition("/do/")
        alone = name.startswith(_BY_LAST_WORD) and last not in words
        words[last if alone else f"{node}-{last}"] = name
    return words


TOPICS: dict[str, Topic] = {t.name: t for t in _TOPICS}


def health_topic(node: str) -> Topic:
    """Topic on which the node of this name publishes its health."""
    return Topic(f"health/{node}", m.Health, 1, 3000, priority="background", doc=_HEALTH_DOC)


def topic(name: str) -> Topic:
    """Topic of this name.

    Raises:
        KeyError: unknown name; the text suggests the nearest one.
    """
    if name.startswith("health/"):
        return health_topic(name.removeprefix("health/"))
    try:
        return TOPICS[name]
    except KeyError:
        near = get_close_matches(name, TOPICS, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; expected one of {', '.join(TOPICS)}"
        raise KeyError(f"unknown topic {name!r}{hint}") from None


def key(vehicle: str, name: str) -> str:
    """Zenoh key expression of a stream, command or liveliness token of a vehicle."""
    return f"outrider/{vehicle}/{name}"
