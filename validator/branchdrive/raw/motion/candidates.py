"""Candidates of one group against each other: who steers or drives more than whom, and comes to which place.

They begin alike, so that more of a command at every tick shows in where they are at the last observation before one of
them touches something, whatever the road and the traffic do.
Source: spec/07-rules.md#response.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.response import CLEAR_COMMAND, CLEAR_EFFECT_M, MIN_BRAKING, MIN_COMMAND
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.motion.contact import COLLISION_COUNTS, is_free
from branchdrive.raw.motion.response import responses
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows

__all__ = ["Contrary", "drives_contrary", "steers_contrary"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_OFFSETS = (0, *FUTURE_OFFSETS)

MAX_ROLLING_BRAKE = 0.4
"""Mean brake up to which wheels roll on any dry road: harder ones may lock them, and hold less than softer ones."""

LOCKED_SHARE = 0.75
"""Share of the hold of a wheel that rolls which it keeps, at least, where it locks: tyres on a dry or a wet road."""

MAX_STEERING = 0.2
"""Difference of steering up to which tyres that scrub take no way worth naming."""

CLEAR_WAY_M = 0.5
"""Way that gears, slip and rounding do not take from a vehicle that drives more at every tick."""

_FASTER_MPS = 0.5


class Contrary(NamedTuple):
    """Candidates whose places are contrary to their commands.

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
    """Chosen attempts that are compared, the nominals among them, by group; ``[candidates]`` where nothing is said.

    Attributes:
        group: Group of the shard, ascending.
        attempt: Attempt of the shard.
        steer: Applied steering from ``t_b`` on, positive to the right ``[candidates, 50]``.
        drive: Applied throttle minus brake ``[candidates, 50]``.
        ahead_m: Places from ``t_b`` to ``t_b + 50``, seen from the own pose at ``t_b`` ``[candidates, 11]``.
        left_m: The same, to the left.
        way_m: Way from ``t_b`` on, less that of the speed at ``t_b`` ``[candidates, 11]``.
        speed_mps: That speed.
        num_free: Observations behind ``t_b`` up to which no contact keeps motion from being judged.
        num_driven: Observations behind ``t_b`` up to which it drives, faster than 0.5 m/s forwards at each.
    """

    group: Index
    attempt: Index
    steer: Array
    drive: Array
    ahead_m: Array
    left_m: Array
    way_m: Array
    speed_mps: Array
    num_free: Index
    num_driven: Index


def _candidates(view: ShardView, selection: Selection) -> _Candidates:
    found, _ = responses(view, selection, np.zeros(view.num_rollouts, bool))
    _, first = np.unique(found.nominal, return_index=True)
    x, y, yaw, speed = np.concatenate([found.state, found.reference[:, first]], axis=1)[:, :, -len(_OFFSETS) :]
    steer, throttle, brake = np.concatenate([found.command, found.wanted[:, first]], axis=1)
    east, north, cos, sin = x - x[:, :1], y - y[:, :1], np.cos(yaw[:, :1]), np.sin(yaw[:, :1])
    way = np.cumsum(np.hypot(np.diff(x, prepend=x[:, :1]), np.diff(y, prepend=y[:, :1])), axis=1)
    group, attempt = np.append(found.group, found.group[first]), np.append(found.own, found.nominal[first])
    rows = window_rows(view, view.observations, attempt, _OFFSETS)
    num_free = np.logical_and.accumulate(view.cached(is_free)[rows], axis=1).sum(axis=1) - 1
    if "evidence" not in view:
        collides = np.logical_or.reduce(
            [view.rollouts.valid(name) & (view.rollouts[name] > 0) for name in COLLISION_COUNTS]
        )
        num_free[collides[attempt]] = 0
    order = np.lexsort((attempt, group))
    kept = order[num_free[order] > 0]
    values = (
        group, attempt, steer, throttle - brake, cos * east + sin * north, cos * north - sin * east,
        way - speed[:, :1] * TICK_S * np.asarray(_OFFSETS), speed[:, 0], num_free,
        np.logical_and.accumulate(speed > _FASTER_MPS, axis=1).sum(axis=1) - 1,
    )  # fmt: skip
    return _Candidates(*(value[kept] for value in values))


class _Pairs(NamedTuple):
    """Pairs of candidates of one group up to the last observation before one of them touches something ``[pairs]``.

    Attributes:
        more: The candidate that has more of a command in the mean.
        less: The other one.
        last: Place of that observation behind ``t_b``.
        apart: By how much more it has.
        never_less: Whether it has as much or more at every tick.
    """

    more: Index
    less: Index
    last: Index
    apart: Array
    never_less: Mask


def _pairs(every: _Candidates, command: Array) -> Iterator[_Pairs]:
    """All pairs, in blocks of at most one for each candidate, by which of both has more of a command."""
    total, tick = _totals(command), np.arange(ACTIVE_TICKS)
    for step in range(1, len(every.group)):
        one = np.flatnonzero(every.group[step:] == every.group[:-step])
        if not len(one):
            return
        other = one + step
        last = np.minimum(every.num_free[one], every.num_free[other])
        apart = _mean_apart(total, one, other, last)
        more, less = np.where(apart > 0, one, other), np.where(apart > 0, other, one)
        is_over = tick >= last[:, None] * OBSERVATION_STRIDE_TICKS
        never_less = np.asarray(((command[more] >= command[less]) | is_over).all(axis=1))
        yield _Pairs(more, less, last, np.abs(apart), never_less)


def _totals(command: Array) -> Array:
    """Sums of a command over the ticks before each ``[candidates, 51]``."""
    return np.cumsum(np.pad(command, ((0, 0), (1, 0))), axis=1)


def _mean_apart(total: Array, one: Index, other: Index, last: Index) -> Array:
    """Mean of the command of one minus that of the other up to an observation, from their sums."""
    ticks = last * OBSERVATION_STRIDE_TICKS
    return np.asarray((total[one, ticks] - total[other, ticks]) / ticks)


def _contrary(view: ShardView, every: _Candidates, found: list[tuple[Index, Index, Array]], least_m: float) -> Contrary:
    """From pairs that can be told: who has more and less of a command, and by how much the first is in order."""
    none = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    more, less, order_m = (np.concatenate(parts) for parts in zip(*none, *found, strict=True))
    compared = np.bincount(every.group[more], minlength=len(view.group_ids)) > 0
    wrong = np.flatnonzero(order_m <= -least_m)
    more, less = more[wrong], less[wrong]
    return Contrary(compared, every.group[more], every.attempt[more], every.attempt[less], -order_m[wrong])


@np.errstate(all="ignore")  # what overflows is no number, and tells nothing
def steers_contrary(view: ShardView, selection: Selection) -> Contrary:
    """Candidates that come to the left of others though they alone steer to the right of them, or reverse."""
    every, found = _candidates(view, selection), []
    drive = _totals(every.drive)
    for more, less, last, apart, never_less in _pairs(every, every.steer):
        (ahead, left), (ahead_0, left_0) = ((every.ahead_m[own, last], every.left_m[own, last]) for own in (more, less))
        # Across the mean way of both: twice the area between the ways over the length of their sum.
        right_m = 2 * (ahead_0 * -left + left_0 * ahead) / np.hypot(ahead + ahead_0, left + left_0)
        tells = never_less & (apart >= CLEAR_COMMAND) & (np.abs(right_m) >= CLEAR_EFFECT_M)
        tells &= np.abs(_mean_apart(drive, more, less, last)) < MIN_COMMAND
        found.append((more[tells], less[tells], right_m[tells]))
    return _contrary(view, every, found, CLEAR_EFFECT_M)


@np.errstate(all="ignore")
def drives_contrary(view: ShardView, selection: Selection) -> Contrary:
    """Candidates that come less far than others though they drive more, at no tick less, and steer much alike.

    Of two that brake harder than wheels surely roll, the harder brake holds its share, for as long as both drive.
    """
    every, found = _candidates(view, selection), []
    drive, steer = _totals(every.drive), _totals(every.steer)
    for more, less, last, apart, never_less in _pairs(every, every.drive):
        tells = never_less & (apart >= MIN_BRAKING) & (np.abs(_mean_apart(steer, more, less, last)) < MAX_STEERING)
        ticks = last * OBSERVATION_STRIDE_TICKS
        tells &= np.minimum(every.speed_mps[more], every.speed_mps[less]) > _FASTER_MPS
        may_lock = drive[more, ticks] < -MAX_ROLLING_BRAKE * ticks
        both_drive = np.minimum(every.num_driven[more], every.num_driven[less])
        at = np.where(may_lock, np.minimum(last, both_drive), last)
        order_m = np.where(may_lock, LOCKED_SHARE, 1.0) * every.way_m[more, at] - every.way_m[less, at]
        found.append((more[tells], less[tells], order_m[tells]))
    return _contrary(view, every, found, CLEAR_WAY_M)
