"""How the people of the simulated world hold themselves: lying, sitting, standing, waving, walking, jumping.

Angles are of a joint in its parent's frame (x forward, y left, z up while standing), for the left side; the right side
is its mirror image. `flex` swings a limb backwards, `spread` sideways, `twist` turns it about itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from common.geometry.rotation import as_quat, matrix_to_quat, quat_exp, quat_multiply
from common.messages import Quat
from simulation.world.body import Stance

Posture = Literal["standing", "waving", "jumping", "sitting", "supine", "prone", "side"]
POSTURES: tuple[Posture, ...] = get_args(Posture)
LYING: tuple[Posture, ...] = ("supine", "prone", "side")

STRIDE = 0.8
"""Length of a double step at an easy pace, in body heights."""
_JUMP_S, _JUMP = 0.95, 0.16
"""Time from jump to jump, s, and how high the feet get, in body heights."""
_WAVE_S = 1.1
_JITTER_RAD = 0.07
# Columns: where the body's own x, y and z point while it lies (x to the head, z up).
_SUPINE = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
_PRONE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
_ON_THE_SIDE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

Angles = dict[str, tuple[float, float, float]]
"""Part (without side where both do the same, else with `_l`, `_r`) to spread, flex, twist, rad."""


def stance(posture: Posture, limbs: int, t_s: float = 0.0) -> Stance:
    """How somebody holds themselves at a time.

    Args:
        posture: what they do.
        limbs: number that sets how arms and legs lie; the same number, the same body.
        t_s: time, s, for what moves.
    """
    rng = np.random.default_rng((limbs, 77))
    return _POSTURES[posture](rng, t_s)


def walking(phase_rad: float, speed_m_s: float) -> Stance:
    """A step of somebody who walks.

    Args:
        phase_rad: 2 pi for each double step.
        speed_m_s: the slower, the smaller the swing; 1 m/s and more is an easy pace.
    """
    pace = min(speed_m_s, 1.2)
    swing = {"l": math.sin(phase_rad), "r": -math.sin(phase_rad)}
    moving = {"l": math.cos(phase_rad), "r": -math.cos(phase_rad)}
    angles: Angles = {"chest": (0.0, 0.06 * pace, 0.08 * pace * math.sin(phase_rad)), "head": (0.0, -0.04, 0.0)}
    for side in ("l", "r"):
        lifted = max(moving[side], 0.0)
        angles[f"thigh_{side}"] = (0.02, pace * (-0.42 * swing[side] - 0.08), 0.08)
        angles[f"shin_{side}"] = (0.0, pace * (0.12 + 0.8 * lifted * lifted), 0.0)
        angles[f"foot_{side}"] = (0.0, pace * (0.12 * swing[side] - 0.05), 0.0)
        angles[f"upper_arm_{side}"] = (0.12, pace * 0.4 * swing[side], 0.0)
        angles[f"forearm_{side}"] = (0.0, -0.15 - 0.35 * pace, 0.0)
    return Stance(_turns(angles))


def _standing(rng: np.random.Generator, t_s: float) -> Stance:
    angles: Angles = {
        "upper_arm": (0.16, 0.02, 0.0),
        "forearm": (0.0, -0.25, 0.0),
        "thigh": (0.06, -0.02, 0.12),
        "shin": (0.0, 0.04, 0.0),
    }
    return Stance(_turns(angles, rng))


def _waving(rng: np.random.Generator, t_s: float) -> Stance:
    beat = math.sin(math.tau * t_s / _WAVE_S)
    angles: Angles = {
        "upper_arm": (2.2 + 0.25 * beat, -0.2, 0.0),
        "forearm": (0.45 + 0.4 * beat, -0.1, 0.0),
        "thigh": (0.10, -0.02, 0.12),
        "shin": (0.0, 0.04, 0.0),
    }
    return Stance(_turns(angles, rng))


def _jumping(rng: np.random.Generator, t_s: float) -> Stance:
    phase = math.tau * t_s / _JUMP_S
    open_ = 0.5 - 0.5 * math.cos(phase)
    crouch = max(-math.sin(phase), 0.0)
    angles: Angles = {
        "upper_arm": (0.3 + 1.9 * open_, -0.1, 0.0),
        "forearm": (0.15 + 0.3 * open_, -0.15, 0.0),
        "thigh": (0.05 + 0.28 * open_, -0.45 * crouch, 0.12),
        "shin": (0.0, 0.8 * crouch, 0.0),
        "foot": (0.0, 0.35 * (1.0 - crouch), 0.0),
    }
    return Stance(_turns(angles, rng), lift=_JUMP * max(math.sin(phase), 0.0))


def _sitting(rng: np.random.Generator, t_s: float) -> Stance:
    back, knees = float(rng.uniform(0.05, 0.3)), float(rng.uniform(0.05, 0.5))
    angles: Angles = {
        "chest": (0.0, float(rng.uniform(0.0, 0.3)), 0.0),
        "thigh": (float(rng.uniform(0.12, 0.3)), -math.pi / 2 + back - knees, 0.0),
        "shin": (0.0, 2.0 * knees, 0.0),
        "foot": (0.0, 0.3, 0.0),
    }
    if rng.random() < 0.5:  # leaning back on the hands
        angles |= {"upper_arm": (0.35, 0.75 + back, 0.0), "forearm": (0.0, -0.1, 0.0), "hand": (0.0, -0.8, 0.0)}
    else:  # hands on the knees
        angles |= {"upper_arm": (0.2, -0.75 + back, 0.0), "forearm": (0.0, -0.4, 0.0)}
    return Stance(_turns(angles, rng), as_quat(quat_exp((0.0, -back, 0.0))))


def _supine(rng: np.random.Generator, t_s: float) -> Stance:
    angles: Angles = {"thigh": (float(rng.uniform(0.06, 0.3)), 0.04, 0.35), "shin": (0.0, 0.04, 0.0)}
    angles |= {"foot": (0.0, 0.55, 0.0), "head": (0.0, 0.06, float(rng.normal(0.0, 0.25)))}
    if rng.random() < 0.35:
        bent = "l" if rng.random() < 0.5 else "r"
        angles |= {f"thigh_{bent}": (0.55, -0.25, 0.9), f"shin_{bent}": (0.0, 0.9, 0.0)}
    for side in ("l", "r"):
        angles |= _arm_on_the_ground(side, rng, backwards=0.16)
    return Stance(_turns(angles, rng), as_quat(matrix_to_quat(_SUPINE)))


def _prone(rng: np.random.Generator, t_s: float) -> Stance:
    # The feet lie on their toes, the face to one side.
    side = float(rng.choice([-1.0, 1.0]))
    angles: Angles = {"thigh": (float(rng.uniform(0.06, 0.25)), 0.04, -0.1), "foot": (0.0, 1.2, 0.0)}
    angles |= {"shin": (0.0, 0.06, 0.0), "head": (0.0, -0.05, side * 1.0)}
    for arm in ("l", "r"):
        angles |= _arm_on_the_ground(arm, rng, backwards=-0.18)
    return Stance(_turns(angles, rng), as_quat(matrix_to_quat(_PRONE)))


def _side(rng: np.random.Generator, t_s: float) -> Stance:
    """On the right side, the upper arm and leg in front, as in the recovery position."""
    angles: Angles = {
        "chest": (0.0, 0.12, 0.0),
        "thigh_l": (-0.15, -0.75, 0.0),
        "shin_l": (0.0, 1.0, 0.0),
        "thigh_r": (0.0, -0.25, 0.0),
        "shin_r": (0.0, 0.5, 0.0),
        "upper_arm_l": (-0.35, -1.0, 0.0),
        "forearm_l": (0.0, -0.7, 0.0),
        "upper_arm_r": (0.0, -1.3, 0.0),
        "forearm_r": (0.0, -0.5, 0.0),
        "foot": (0.0, 0.4, 0.0),
        "head": (0.12, 0.1, 0.0),
    }
    # A little rolled forward: nobody balances on the edge of a shoulder.
    rolled = quat_multiply(matrix_to_quat(_ON_THE_SIDE), quat_exp((0.0, 0.0, -float(rng.uniform(0.05, 0.3)))))
    return Stance(_turns(angles, rng), as_quat(rolled))


def _arm_on_the_ground(side: str, rng: np.random.Generator, backwards: float) -> Angles:
    """An arm of somebody who lies: beside the body, stretched out, bent, or above the head.

    Args:
        side: `l` or `r`.
        rng: which of them.
        backwards: flexion that brings the elbow to the ground, rad.
    """
    spread, bend = ((0.2, 0.1), (0.9, 0.1), (1.35, 0.9), (2.5, 0.3))[int(rng.choice(4, p=[0.4, 0.25, 0.2, 0.15]))]
    upper = (spread + float(rng.normal(0.0, 0.1)), backwards, 0.0)
    return {f"upper_arm_{side}": upper, f"forearm_{side}": (bend, -0.4 * backwards, 0.0)}


_POSTURES: dict[Posture, Callable[[np.random.Generator, float], Stance]] = {
    "standing": _standing,
    "waving": _waving,
    "jumping": _jumping,
    "sitting": _sitting,
    "supine": _supine,
    "prone": _prone,
    "side": _side,
}
_SIDED = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")
_LOOSE = ("upper_arm", "forearm", "thigh")


def _turns(angles: Angles, rng: np.random.Generator | None = None) -> dict[str, Quat]:
    """Quaternion of each part; limbs a little different from the book's when there is an rng."""
    turns: dict[str, Quat] = {}
    for part in ("pelvis", "chest", "head"):
        if part in angles:
            turns[part] = _turn(*angles[part])
    for part in _SIDED:
        for side, sign in (("l", 1.0), ("r", -1.0)):
            spread, flex, twist = angles.get(f"{part}_{side}", angles.get(part, (0.0, 0.0, 0.0)))
            if rng is not None and part in _LOOSE:
                spread += float(rng.normal(0.0, _JITTER_RAD))
            if spread or flex or twist:
                turns[f"{part}_{side}"] = _turn(sign * spread, flex, sign * twist)
    return turns


def _turn(spread: float, flex: float, twist: float) -> Quat:
    """Spread about x after flexion about y after twist about z."""
    about_x, about_y = quat_exp((spread, 0.0, 0.0)), quat_exp((0.0, flex, 0.0))
    return as_quat(quat_multiply(about_x, quat_multiply(about_y, quat_exp((0.0, 0.0, twist)))))
