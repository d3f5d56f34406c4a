"""Candidates of one group against each other: who steers or drives more than whom, and ends where.

They begin alike, so that more of a command shows in the order of their ends, whatever the road and the traffic do.
Source: spec/07-rules.md#response.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, TICK_S
from branchdrive.driving.response import CLEAR_COMMAND, CLEAR_EFFECT_M, MIN_BRAKING, MIN_COMMAND
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.motion.contact import touches
from branchdrive.raw.motion.response import responses
from branchdrive.raw.shard_view import ShardView

__all__ = ["Contrary", "drives_contrary", "steers_contrary"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MAX_ROLLING_BRAKE = 0.4
"""Mean brake up to which wheels roll on any dry road: harder ones may lock them, and hold less than softer ones."""

MAX_STEERING = 0.2
"""Difference of steering up to which tyres that scrub take no way worth naming."""

CLEAR_WAY_M = 0.5
"""Way that gears, slip and rounding do not take from a vehicle that drives more at every tick."""

_FASTER_MPS = 0.5


class Contrary(NamedTuple):
    """Candidates that end contrary to their commands.

    Attributes:
        compared: Groups in which two candidates can be told by it ``[groups]``.
        group: Group of each contrary pair ``[pairs]``.
        more: Attempt of the pair that has more of the command ``[pairs]``.
        less: The other one ``[pairs]``.
        away_m: How far they are apart in the contrary order ``[pairs]``.
    """

    compared: Mask
    group: Index
    more: Index
    less: Index
    away_m: Array


class _Candidates(NamedTuple):
    """Chosen attempts without a contact up to ``t_b + 50``, the nominals among them, by group; each ``[candidates]``.

    Attributes:
        group: Group of the shard, ascending.
        attempt: Attempt of the shard.
        steer: Mean applied steering from ``t_b`` to ``t_b + 49``, positive to the right.
        drive: Applied throttle minus brake ``[candidates, 50]``.
        left_m: Offset from the nominal at ``t_b + 50``, positive to the left.
        way_m: Way from ``t_b`` to ``t_b + 50``, less that of the speed at ``t_b``.
        speed_mps: That speed.
    """

    group: Index
    attempt: Index
    steer: Array
    drive: Array
    left_m: Array
    way_m: Array
    speed_mps: Array


def _candidates(view: ShardView, selection: Selection) -> _Candidates:
    found, every = responses(view, selection, np.zeros(view.num_rollouts, bool))
    _, first = np.unique(found.nominal, return_index=True)
    state = np.concatenate([found.state, found.reference[:, first]], axis=1)[:, :, -len(FUTURE_OFFSETS) - 1 :]
    steer, throttle, brake = np.concatenate([found.command, found.wanted[:, first]], axis=1)
    x, y, _, speed = state
    way = np.hypot(np.diff(x), np.diff(y)).sum(axis=1) - ACTIVE_TICKS * TICK_S * speed[:, 0]
    group, attempt = np.append(found.group, found.group[first]), np.append(found.own, found.nominal[first])
    observations = view.observations
    last = np.append(view.branch_tick, 0)[observations.rollout] + FUTURE_OFFSETS[-1]
    touched = observations.by_rollout(view.cached(touches) & (observations.tick <= last)).any
    order = np.lexsort((attempt, group))
    kept = order[~touched[attempt[order]]]
    left = np.append(every.lateral_m, np.zeros(len(first)))
    values = group, attempt, steer.mean(axis=1), throttle - brake, left, way, speed[:, 0]
    return _Candidates(*(value[kept] for value in values))


def _pairs(group: Index) -> Iterator[tuple[Index, Index]]:
    """Pairs of places with one group, which ascends, in blocks of at most one for each place."""
    for step in range(1, len(group)):
        one = np.flatnonzero(group[step:] == group[:-step])
        if not len(one):
            return
        yield one, one + step


def _contrary(view: ShardView, every: _Candidates, found: list[tuple[Index, Index, Array]], least_m: float) -> Contrary:
    """From pairs that can be told: who has more and less of a command, and how much further the first should end."""
    none = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    more, less, order_m = (np.concatenate(parts) for parts in zip(*none, *found, strict=True))
    compared = np.bincount(every.group[more], minlength=len(view.group_ids)) > 0
    wrong = np.flatnonzero(order_m <= -least_m)
    more, less = more[wrong], less[wrong]
    return Contrary(compared, every.group[more], every.attempt[more], every.attempt[less], -order_m[wrong])


def steers_contrary(view: ShardView, selection: Selection) -> Contrary:
    """Candidates that end to the left of others though they alone steer to the right of them, or reverse."""
    every, found = _candidates(view, selection), []
    drive = every.drive.mean(axis=1)
    for one, other in _pairs(every.group):
        apart = every.steer[one] - every.steer[other]
        right_m = every.left_m[other] - every.left_m[one]
        tells = (np.abs(apart) >= CLEAR_COMMAND) & (np.abs(drive[one] - drive[other]) < MIN_COMMAND)
        tells &= np.abs(right_m) >= CLEAR_EFFECT_M
        more, less = np.where(apart > 0, one, other), np.where(apart > 0, other, one)
        found.append((more[tells], less[tells], (np.sign(apart) * right_m)[tells]))
    return _contrary(view, every, found, CLEAR_EFFECT_M)


def drives_contrary(view: ShardView, selection: Selection) -> Contrary:
    """Candidates that come less far than others though they drive more, at no tick less, and steer much alike."""
    every, found = _candidates(view, selection), []
    drive = every.drive.mean(axis=1)
    for one, other in _pairs(every.group):
        apart = drive[one] - drive[other]
        more, less = np.where(apart > 0, one, other), np.where(apart > 0, other, one)
        tells = (np.abs(apart) >= MIN_BRAKING) & (np.abs(every.steer[one] - every.steer[other]) < MAX_STEERING)
        tells &= (drive[more] >= -MAX_ROLLING_BRAKE) & (every.drive[more] >= every.drive[less]).all(axis=1)
        tells &= np.minimum(every.speed_mps[one], every.speed_mps[other]) > _FASTER_MPS
        found.append((more[tells], less[tells], (every.way_m[more] - every.way_m[less])[tells]))
    return _contrary(view, every, found, CLEAR_WAY_M)
