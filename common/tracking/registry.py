"""The single-object trackers by name; a new one is a class in its own file and one line here."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

import numpy as np

from common.config import Config, ConfigError, load_object
from common.tracking.base import Tracker

TRACKERS = {
    "particle_filter": "common.tracking.particle_filter:ParticleFilterTracker",
    "dsst": "common.tracking.dsst:DsstTracker",
    "cmt": "common.tracking.cmt:CmtTracker",
    "struck": "common.tracking.struck:StruckTracker",
    "tld": "common.tracking.tld:TldTracker",
    "mil": "common.tracking.mil:MilTracker",
    "nano": "common.tracking.deep:NanoTracker",
    "vit": "common.tracking.deep:VitTracker",
    "hab-df": "onboard.fusion.tracker:HabDfTracker",
}
"""Name to `module:Class`, imported when it is asked for: one costs half a second of compiled code, one stands on the
vehicle's side, two need the user's model files. A class has `config_type` and is made from (its section, rng), or by
its own `make(config, rng)`."""


def tracker_class(name: str) -> Any:
    """Class of the tracker of this name.

    Raises:
        ConfigError: unknown name; the text lists the right ones.
    """
    check_name(name, "tracker")
    return load_object(TRACKERS[name])


def check_name(name: str, what: str) -> None:
    """Refuse a name that is not in the registry.

    Args:
        name: the name.
        what: what it is given as, for the error.

    Raises:
        ConfigError: unknown name; the text lists the right ones.
    """
    if name not in TRACKERS:
        near = get_close_matches(name, TRACKERS, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"{what}: got {name!r}, expected one of: {', '.join(TRACKERS)}{hint}")


def make_tracker(name: str, config: Config, rng: np.random.Generator) -> Tracker:
    """A tracker of this name with its configuration section and its source of randomness.

    Raises:
        ConfigError: unknown name.
        KeyError: its section is not registered.
    """
    kind = tracker_class(name)
    if hasattr(kind, "make"):
        return kind.make(config, rng)
    return kind(config.section(kind.config_type), rng)
