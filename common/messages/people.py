"""People that were found: what one picture shows, and who they are (Al-Kaff 2019, section 4)."""

from __future__ import annotations

from typing import Literal

from common.messages.base import Message, MessageError, Vec3, check_range

JOINTS = (
    "head", "neck", "shoulder_r", "elbow_r", "wrist_r", "shoulder_l", "elbow_l", "wrist_l",
    "hip_r", "knee_r", "ankle_r", "hip_l", "knee_l", "ankle_l", "waist",
)  # fmt: skip
"""Names of the joints in the paper's order."""
BONES = (
    (0, 1), (1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 14), (14, 8), (8, 9), (9, 10), (14, 11), (11, 12),
    (12, 13),
)  # fmt: skip
"""Pairs of joints between which a drawing of the skeleton has a line."""

Covariance = tuple[float, float, float, float, float, float]
"""Upper triangle of a symmetric (3, 3) matrix, row by row: nn, ne, nd, ee, ed, dd."""


class PersonDetection(Message, frozen=True, kw_only=True):
    """A person in one picture."""

    number: int
    """Who it is (`Person.number`)."""
    box_px: tuple[float, float, float, float]
    """x, y, width, height in the colour picture, px."""
    joints_px: tuple[tuple[float, float, float], ...]
    """(column, row, confidence 0 to 1) of each of the fifteen `JOINTS`, px in the colour picture."""
    presence: float
    """What the pose network says about a person being there, 0 to 1."""
    fresh: bool
    """Whether the pose comes from this very picture; otherwise it is an earlier one, moved along with the region."""
    with_depth: bool
    """Whether the region, its place and its size come from depth."""
    ned_p_m: Vec3 | None = None
    """Middle of what is seen, from home, NED, m; None without depth or vehicle pose."""
    ned_p_cov_m2: Covariance | None = None
    """Its covariance, m²."""
    camera_p_m: Vec3 | None = None
    """The same place in the colour camera's optical frame (x right, y down, z forward), m; None without depth."""
    size_m: Vec3 | None = None
    """Length and width in the floor's plane and height above it, m; None without depth."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        check_range("number", self.number, 1, 2**31)
        if len(self.joints_px) != len(JOINTS):
            raise MessageError(f"joints_px: got {len(self.joints_px)} joints, expected {len(JOINTS)}")


class PeopleDetections(Message, frozen=True, kw_only=True):
    """The people in the picture that the header's `capture_ns` names; an empty list says that nobody is seen."""

    camera: str
    """Camera name."""
    width: int
    """Columns of the picture, px."""
    height: int
    """Rows, px."""
    people: tuple[PersonDetection, ...]
    """Who is seen; people whom the operator dismissed are not among them."""
    with_depth: bool
    """Whether depth was used."""
    reason: str = ""
    """Why nothing can be found, or only with less than usual; empty when all is well."""


class Person(Message, frozen=True, kw_only=True):
    """A person who was seen, and who keeps the number for the whole mission."""

    number: int
    """Identity, from 1; never given twice."""
    name: str
    """What the operator calls them; `person N` until then. `Obstacle.label` is always `person N`."""
    state: Literal["provisional", "seen", "away", "dismissed"]
    """`provisional`: not believed yet. `seen`: in the newest picture. `away`: out of sight, the place is the last one.
    `dismissed`: the operator says that it is nobody, or no longer of interest."""
    ned_p_m: Vec3 | None = None
    """Where they are, or were last seen, from home, NED, m; None where that was never known."""
    ned_p_cov_m2: Covariance | None = None
    """Its covariance, m²; of the time `last_seen_ns`."""
    ned_v_m_s: Vec3 = (0.0, 0.0, 0.0)
    """Velocity over ground when last seen, NED, m/s; zero for who stands or lies."""
    first_seen_ns: int
    """Capture time of the first picture of them, vehicle clock, ns."""
    last_seen_ns: int
    """Capture time of the newest one, vehicle clock, ns."""
    pictures: int
    """In how many pictures their pose was found."""
    merged: tuple[int, ...] = ()
    """Numbers of others who turned out to be the same person."""

    @property
    def label(self) -> str:
        """Name of this person for commands and obstacles."""
        return person_label(self.number)


class People(Message, frozen=True, kw_only=True):
    """Everybody who was seen since the start, in the order of their numbers; also what became of orders."""

    people: tuple[Person, ...]
    """Each with identity, state and place."""


class PersonPicture(Message, frozen=True, kw_only=True):
    """A picture of a person, now and then."""

    number: int
    """Who it is."""
    taken_ns: int
    """Capture time, vehicle clock, ns."""
    jpeg: bytes
    """The part of the colour picture that shows them, as a JPEG file."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        if not (self.jpeg[:2] == b"\xff\xd8" and self.jpeg[-2:] == b"\xff\xd9"):
            raise MessageError(f"jpeg: got {len(self.jpeg)} bytes that are no whole JPEG, expected SOI and EOI")


def person_label(number: int) -> str:
    """Name of a person for commands and obstacles: `person 3`."""
    return f"person {number}"
