"""What becomes of each frame on the video link: passed, broken, lost or frozen, by chance and in bursts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulation.world.scenario import RadioConfig


@dataclass(frozen=True)
class LinkState:
    """Memory of the link between two frames."""

    lost_left: int = 0
    """Frames of the present burst that are still to be lost."""
    frozen_until_ns: int = 0
    """Until when the picture stands still, ns."""


@dataclass(frozen=True)
class Fate:
    """What happens to one frame."""

    lost: bool = False
    """It never arrives."""
    frozen: bool = False
    """The pixels of an earlier one arrive in its place."""
    broken: bool = False
    """Blocks of it are broken."""


def next_fate(state: LinkState, radio: RadioConfig, t_ns: int, rng: np.random.Generator) -> tuple[LinkState, Fate]:
    """Fate of the frame at a time, ns, and the state of the link after it.

    A loss goes before a freeze, a freeze before broken blocks. The same number of random values is drawn for every
    frame, so that one setting does not shift the others' events.
    """
    lose, freeze, breaks, burst, span = rng.random(5)
    frozen_until = state.frozen_until_ns
    if t_ns >= frozen_until and freeze < radio.frozen_probability:
        frozen_until = t_ns + int(span * radio.frozen_s * 1e9)
    lost_left = state.lost_left
    if lost_left == 0 and lose < radio.lost_probability:
        lost_left = 1 + int(burst * radio.lost_burst_frames)
    after = LinkState(max(lost_left - 1, 0), frozen_until)
    if lost_left > 0:
        return after, Fate(lost=True)
    if t_ns < frozen_until:
        return after, Fate(frozen=True)
    return after, Fate(broken=bool(breaks < radio.block_probability))
