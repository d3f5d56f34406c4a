"""Counter-based randomness: a number is a pure function of (seed, purpose, actor, tick).

There is no generator state, so every branch of a group sees the same exogenous noise whatever the
ego does, and drawing one number more never shifts another. Each key part is absorbed by one round
of the SplitMix64 finaliser (Steele, Lea and Flood, "Fast splittable pseudorandom number
generators", OOPSLA 2014); the upper 53 bits of the result are the mantissa of a uniform number.
"""

from __future__ import annotations

import math
from enum import IntEnum, unique

import numpy as np

from branchdrive_reference.kernel import kernel

__all__ = ["Purpose", "choice", "integer", "normal", "uniform", "uniform_between"]

_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30, _SHIFT_27, _SHIFT_31, _SHIFT_11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


@unique
class Purpose(IntEnum):
    """What a number is drawn for; a member keeps its value for ever."""

    PLAN_ROUTE = 1
    PLAN_ENVIRONMENT = 2
    PLAN_SEED = 3
    PLAN_BRANCH = 4
    BRANCH_LEAD = 5
    BRANCH_QUIET = 6
    SITE = 10
    EGO_SPEED = 11
    SCENARIO_TIMING = 13
    SCENARIO_STRENGTH = 14
    SCENARIO_PLACE = 15
    SCENARIO_SPEED = 16
    SCENARIO_COUNT = 17
    SCENARIO_BODY = 18
    SCENARIO_GAP = 19
    SCENARIO_SIDE = 26
    SCENARIO_ANGLE = 27
    TRAFFIC_PRESENCE = 20
    TRAFFIC_GAP = 21
    TRAFFIC_SPEED = 22
    TRAFFIC_HEADWAY = 23
    TRAFFIC_BODY = 24
    TRAFFIC_MOOD = 25
    WALKER_PLACE = 30
    WALKER_SPEED = 31
    FURNITURE_PLACE = 32
    WALKER_HEADING = 35
    WALKER_DISTANCE = 36
    PARKED_PRESENCE = 33
    PARKED_PLACE = 34
    SIGNAL_OFFSET = 40
    REPLAY_TRAFFIC = 50
    REPLAY_EGO = 51
    REPLAY_CONTROL = 52
    REPLAY_SENSOR = 53
    REPLAY_SCALE = 54
    REPLAY_KEY = 55
    FAULT_PARTIAL = 100
    FAULT_QUARANTINED = 101
    FAULT_UNRETRIED = 102
    FAULT_DUPLICATE = 103
    FAULT_ABANDONED = 104
    FAULT_SEED_DISAGREEMENT = 105
    FAULT_ONLINE_STEERING = 106
    FAULT_WRONG_DURATION = 107
    FAULT_EARLY_BRANCH = 108
    FAULT_LATE_BRANCH = 109
    FAULT_TRUNCATED_LOG = 110
    FAULT_DROPPED_FRAME = 111
    FAULT_EXTENT = 112
    FAULT_POLICIES_BEGUN = 113
    FAULT_OTHER_SEED = 114
    FAULT_SEED_POLICY = 115
    FAULT_IMAGE_DROPPED = 120
    FAULT_IMAGE_DAMAGED = 121
    FAULT_IMAGE_LATE = 122
    FAULT_IMAGE_DUPLICATED = 123
    FAULT_IMAGE_SWAPPED = 124
    FAULT_IMAGE_TICK = 125
    FAULT_IMAGE_CAMERA = 126


@kernel
def _absorb(state: np.uint64, part: np.uint64) -> np.uint64:
    mixed = (state ^ part) + _INCREMENT
    mixed = (mixed ^ (mixed >> _SHIFT_30)) * _MIX_1
    mixed = (mixed ^ (mixed >> _SHIFT_27)) * _MIX_2
    return mixed ^ (mixed >> _SHIFT_31)


@kernel
def uniform(seed: int, purpose: int, actor: int = 0, tick: int = 0) -> float:
    """Uniform number in ``[0, 1)`` of the key; all parts are non-negative 63-bit integers."""
    state = _absorb(np.uint64(0), np.uint64(seed))
    state = _absorb(state, np.uint64(purpose))
    state = _absorb(state, np.uint64(actor))
    state = _absorb(state, np.uint64(tick))
    return float(state >> _SHIFT_11) * _UNIT


def uniform_between(low: float, high: float, seed: int, purpose: Purpose, actor: int = 0) -> float:
    """Uniform number in ``[low, high)`` of the key."""
    return low + (high - low) * uniform(seed, int(purpose), actor)


def choice(count: int, seed: int, purpose: Purpose, actor: int = 0) -> int:
    """Uniform index in ``0 .. count - 1`` of the key."""
    return min(int(count * uniform(seed, int(purpose), actor)), count - 1)


def normal(seed: int, purpose: Purpose, actor: int = 0, tick: int = 0) -> float:
    """Standard normal number of the key: Box and Muller's transform of two uniform numbers, at most 8.6."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(seed, int(purpose), 2 * actor, tick)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, int(purpose), 2 * actor + 1, tick))


def integer(seed: int, purpose: Purpose, actor: int = 0) -> int:
    """Uniform non-negative 53-bit integer of the key, usable as a seed."""
    return int(uniform(seed, int(purpose), actor) / _UNIT)
