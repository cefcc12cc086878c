"""People in the 3-D view: where they are or were last seen, how sure that is, and who they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser

from common.messages import Person
from ground.console.people_cards import COLOURS, ellipse, listed, state_words
from ground.console.ring import in_scene
from ground.console.snapshot import Snapshot

_POINTS = 36
_RADIUS_M = 0.22


@dataclass
class _Marker:
    """One person's."""

    ball: viser.IcosphereHandle
    words: viser.LabelHandle
    rim: viser.LineSegmentsHandle
    shown: tuple[Person, str] | None = None


class PeopleMap:
    """A ball, a name and an ellipse of two sigma for each person.

    Args:
        scene: where they are drawn.
    """

    def __init__(self, scene: viser.SceneApi):
        self._scene = scene
        self._markers: dict[int, _Marker] = {}

    def update(self, view: Snapshot) -> None:
        """Draw everybody whose place is known, and nobody who was dismissed or merged."""
        people = listed(view.people.people) if view.people is not None else []
        placed = {p.number: p for p in people if p.ned_p_m is not None}
        for number in [n for n in self._markers if n not in placed]:
            marker = self._markers.pop(number)
            for handle in (marker.words, marker.rim, marker.ball):
                handle.remove()
        for number, person in placed.items():
            # Without its age: a label that changes every second is set anew by the browser, and seldom there.
            words = f"{person.name} ({state_words(person, None)})"
            marker = self._markers.get(number) or self._add(number)
            if marker.shown != (person, words):
                marker.shown = (person, words)
                _draw(marker, person, words)

    def _add(self, number: int) -> _Marker:
        root = f"/people/{number}"
        ball = self._scene.add_icosphere(root, _RADIUS_M, COLOURS["away"], cast_shadow=False)
        words = self._scene.add_label(f"{root}/words", "", position=(0.0, 0.0, -0.5))
        nothing = np.zeros((_POINTS, 2, 3), np.float32)
        rim = self._scene.add_line_segments(
            f"{root}/rim", nothing, np.zeros((_POINTS, 2, 3), np.uint8), thickness=2.5, thickness_units="screen"
        )
        self._markers[number] = _Marker(ball, words, rim)
        return self._markers[number]


def _draw(marker: _Marker, person: Person, words: str) -> None:
    colour = COLOURS[person.state]
    marker.ball.position = person.ned_p_m or (0.0, 0.0, 0.0)
    marker.ball.color = colour
    if marker.words.text != words:
        marker.words.text = words
    marker.rim.visible = person.ned_p_cov_m2 is not None
    if person.ned_p_cov_m2 is not None:
        around = ellipse(person.ned_p_cov_m2, _POINTS)
        marker.rim.points = np.stack((around[:-1], around[1:]), axis=1).astype(np.float32)
        marker.rim.colors = np.tile(np.array(in_scene(colour), np.uint8), (_POINTS, 2, 1))
