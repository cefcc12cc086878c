"""What is known of each kind of tracker before it has said anything."""

from __future__ import annotations

from common.config import Section
from onboard.fusion.source import Source


class Character(Section, frozen=True, kw_only=True):
    """What is known of a kind of tracker beforehand: Γ of eq. 4.8, and what its word is worth."""

    place: float = 0.05
    """Standard deviation of its centre, target sizes."""
    size: float = 0.1
    """Standard deviation of its height and width, target sizes."""
    vouches: float = 1.0
    """`Source.vouches`."""


CHARACTERS = {
    "particle_filter": Character(place=0.1, size=0.2, vouches=0.4),
    "mil": Character(place=0.15, size=0.4, vouches=0.2),
    "tld": Character(size=0.2),
    "cmt": Character(size=0.04),
}
"""By name; another tracker has the defaults. From each one's error while it has the target, on a face, a pedestrian and
a car. TLD's windows have sizes a fifth apart. CMT measures each size against the first picture, by all its keypoints;
who measures it against the last one drifts, and takes along who is put on the answer. The colour filter and MIL also
follow what is not the target, so neither alone shows that it is seen."""


def source_of(name: str) -> Source:
    """A tracker of the registry as a source of the fusion."""
    character = CHARACTERS.get(name, Character())
    noise = (character.place, character.place, character.size, character.size)
    return Source(name, noise, threshold=0.5, vouches=character.vouches)
