"""The single-object trackers by name; a new one is a class in its own file and one line here."""

from __future__ import annotations

from difflib import get_close_matches

import numpy as np

from common.config import Config, ConfigError
from common.tracking.base import Tracker
from common.tracking.particle_filter import ParticleFilterTracker

TRACKERS = {
    "particle_filter": ParticleFilterTracker,
}
"""Name to class; a class has `config_type` and is made from (its section, rng)."""


def tracker_class(name: str) -> type[ParticleFilterTracker]:
    """Class of the tracker of this name.

    Raises:
        ConfigError: unknown name; the text lists the right ones.
    """
    try:
        return TRACKERS[name]
    except KeyError:
        near = get_close_matches(name, TRACKERS, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"tracker: got {name!r}, expected one of: {', '.join(TRACKERS)}{hint}") from None


def make_tracker(name: str, config: Config, rng: np.random.Generator) -> Tracker:
    """A tracker of this name with its configuration section and its source of randomness.

    Raises:
        ConfigError: unknown name.
        KeyError: its section is not registered.
    """
    kind = tracker_class(name)
    return kind(config.section(kind.config_type), rng)
