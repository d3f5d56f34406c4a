"""What executed interventions do: effects on the vehicle against the nominal rollout of the group.

At ``t_b + 50``, with the pose ``(x, y, psi)`` and speed ``v`` of an intervention and those of its nominal ``0``::

    lateral effect    -sin(psi_0) (x - x_0) + cos(psi_0) (y - y_0)      positive to the left
    speed effect      v - v_0

Commands are compared over the active ticks: the mean of the applied steering minus the nominal's, positive to the
right, and the same for throttle minus brake. Source: spec/07-rules.md#response.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import wrap_rad

__all__ = [
    "BEFORE_BRANCH", "CLEAR_COMMAND", "CLEAR_EFFECT_M", "MIN_BRAKING", "MIN_COMMAND", "MIN_EFFECT_M", "MIN_EFFECT_MPS",
    "NO_RESPONSE", "TURN_OFFSET", "Responses", "Sights", "first_response", "lateral_effect_m",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_COMMAND = 0.04
"""Mean difference of commands below which nothing is expected: the smallest steering of the bank `bd13` is 0.05."""

MIN_BRAKING = 0.2
"""Mean difference of throttle minus brake that slows any vehicle; more throttle may find one at its top speed."""

MIN_EFFECT_M = 0.1
MIN_EFFECT_MPS = 0.1
"""Effects below these have no sign; replays of one rollout differ by about as much where a simulator has noise."""

CLEAR_COMMAND = 0.08
CLEAR_EFFECT_M = 0.3
"""Steering and lateral effect from which single candidates have sides: twice and three times those of many."""

MIN_EFFECT_MPS2 = 2.0
"""Change of an acceleration that no noise of replays explains in nine of ten interventions."""

MIN_GAIN_MPS = 2.0
"""Gain of speed in the window of a vehicle that is at no top speed, of its own or of a limit."""

MIN_TOLD_MPS2 = 0.5
"""Difference of the first accelerations of two actions that tells them apart."""

ROUNDING = 1e-6
"""Of a mean of commands."""

TURN_OFFSET = 20
"""Ticks after ``t_b`` in which a turn shows steering: a second, before which no vehicle comes round."""

MIN_TURN_RAD = 0.01
"""Turn from which two interventions have an order: replays with noise differ by less."""

BEFORE_BRANCH = -1
"""`Responses.first` of a rollout that differs from its nominal before the branch already."""

NO_RESPONSE = 11
"""`Responses.first` of a rollout that equals its nominal up to ``t_b + 50``."""


@dataclass(frozen=True)
class Responses:
    """Interventions against their nominal rollouts, each field ``[interventions]``.

    Attributes:
        group: The group, as 63 bits of a digest of its id.
        policy: Index into the bank.
        steer: Mean applied steering minus the nominal's, positive to the right.
        drive: Mean applied throttle minus brake, minus the nominal's.
        lateral_m: Lateral effect, positive to the left.
        turn_rad: Turn to the left from ``t_b`` to ``t_b + 20`` minus the nominal's.
        speed_mps: Speed effect.
        first: The first observation that differs from the nominal's: 0 is that of ``t_b``, ``j`` that of ``t_b + 5 j``;
            `BEFORE_BRANCH`, or `NO_RESPONSE`.
        moves: Whether the nominal vehicle moves between ``t_b`` and ``t_b + 50``.
        accel_mps2: Longitudinal acceleration minus the nominal's, at ``t_b`` and at ``t_b + 5`` ``[interventions, 2]``.
        began_mps: Speed at ``t_b``.
        gain_mps: Speed at ``t_b + 50`` minus that.
        future: Its poses and speeds from ``t_b + 5`` to ``t_b + 50``, to three decimals, as 63 bits of a digest.
        nominal_future: The same of the nominal.
        expert: What the expert commanded while it was overridden, of its steering and of its throttle and brake:
            whether that changed from ``t_b - 1`` to ``t_b + 50``, was one command in the window, was the nominal's, and
            was what the vehicle got ``[interventions, 2, 4]``.
    """

    group: Index
    policy: Index
    steer: Array
    drive: Array
    lateral_m: Array
    turn_rad: Array
    speed_mps: Array
    first: Index
    moves: NDArray[np.bool_]
    accel_mps2: Array
    began_mps: Array
    gain_mps: Array
    future: Index
    nominal_future: Index
    expert: NDArray[np.bool_]

    @classmethod
    def none(cls) -> Responses:
        """No intervention."""
        index, value = np.zeros(0, np.int64), np.zeros(0)
        accel, expert = np.zeros((0, 2)), np.zeros((0, 2, 4), bool)
        return cls(
            index, index, value, value, value, value, value, index, np.zeros(0, bool), accel, value, value, index,
            index, expert,
        )  # fmt: skip

    @cached_property
    def _rows_of_policy(self) -> dict[int, Index]:
        """Interventions of each policy, in the order of their groups, which have one each."""
        order = np.lexsort((self.group, self.policy))
        ordered = self.policy[order]
        policies = np.unique(ordered)
        start, stop = (np.searchsorted(ordered, policies, side=side) for side in ("left", "right"))
        return {policy: order[start[i] : stop[i]] for i, policy in enumerate(policies.tolist())}

    def _pairs(self, first: int, second: int) -> tuple[Index, Index]:
        """Interventions of two policies in the groups that have both."""
        none = np.zeros(0, np.int64)
        a, b = (self._rows_of_policy.get(policy, none) for policy in (first, second))
        place = np.searchsorted(self.group[b], self.group[a])
        is_shared = np.append(self.group[b], -1)[place] == self.group[a]
        return a[is_shared], b[place[is_shared]]

    def orders(self, first: int, second: int) -> tuple[Array, Array]:
        """In which groups two policies respond in the order of their commands, where the nominal moves.

        Args:
            first: Index of a policy.
            second: Index of another one.

        Returns:
            Of steering and the first turn, and of throttle minus brake and the first acceleration: 1, -1, or 0 where
            either hardly differs or the other command differs too, in each group with both.
        """
        a, b = self._pairs(first, second)
        steer, drive = self.steer[a] - self.steer[b], self.drive[a] - self.drive[b]
        turn, accel = wrap_rad(self.turn_rad[a] - self.turn_rad[b]), self.accel_mps2[a, 1] - self.accel_mps2[b, 1]
        turns = _agreement(-steer, drive, turn, MIN_TURN_RAD)
        drives = _agreement(drive, steer, accel, MIN_EFFECT_MPS2)
        return np.where(self.moves[a], turns, 0.0), np.where(self.moves[a], drives, 0.0)

    def others(self, first: int, second: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Where the commands of two policies differ, and where they have one future that is not the nominal's.

        Args:
            first: Index of a policy.
            second: Index of another one.

        Returns:
            Whether commands differ and the nominal moves, and whether the future is one, in each group with both.
        """
        a, b = self._pairs(first, second)
        away = np.maximum(np.abs(self.steer[a] - self.steer[b]), np.abs(self.drive[a] - self.drive[b]))
        is_one = (self.first[a] != NO_RESPONSE) & (self.future[a] == self.future[b])
        return self.moves[a] & (away >= MIN_COMMAND), is_one

    def denied(self, first: int, second: int) -> tuple[int, int]:
        """How often two policies have one future of a vehicle that gains speed, though others tell them apart.

        What keeps throttle from having an effect at a speed, as a limit of the power or of the tyres, keeps it from
        that at all higher speeds, or at all lower ones.

        Args:
            first: Index of a policy.
            second: Index of another one.

        Returns:
            In how many groups others deny it, one that begins no faster than they end and one that begins no slower
            than they do, in which drives are no further apart; and how many groups tell both policies apart.
        """
        a, b = self._pairs(first, second)
        drive, accel = self.drive[a] - self.drive[b], self.accel_mps2[a, 1] - self.accel_mps2[b, 1]
        counts = (np.abs(drive) >= MIN_COMMAND) & (np.abs(self.steer[a] - self.steer[b]) < MIN_COMMAND)
        told = np.flatnonzero(counts & (np.sign(drive) * accel >= MIN_TOLD_MPS2))
        is_one = (self.first[a] != NO_RESPONSE) & (self.future[a] == self.future[b])
        equal = np.flatnonzero(counts & is_one & (self.gain_mps[a] >= MIN_GAIN_MPS))
        told = told[np.argsort(self.began_mps[a[told]], kind="stable")]
        speed, apart = self.began_mps[a[told]], np.abs(drive[told])
        begin, own_apart = self.began_mps[a[equal]], np.abs(drive[equal]) + ROUNDING
        up_to = np.insert(np.minimum.accumulate(apart), 0, np.inf)
        beyond = np.append(np.minimum.accumulate(apart[::-1])[::-1], np.inf)
        by_slower = up_to[np.searchsorted(speed, begin + self.gain_mps[a[equal]], "right")] <= own_apart
        by_faster = beyond[np.searchsorted(speed, begin)] <= own_apart
        return int((by_slower & by_faster).sum()), len(told)

    @classmethod
    def of_all(cls, parts: Iterable[Responses]) -> Responses:
        """The interventions of several shards."""
        every = [cls.none(), *parts]
        return cls(*(np.concatenate([getattr(part, field.name) for part in every]) for field in fields(cls)))

    @property
    def is_commanded(self) -> NDArray[np.bool_]:
        """Interventions whose commands differ from the nominal's, of a vehicle that moves."""
        return self.moves & (np.maximum(np.abs(self.steer), np.abs(self.drive)) >= MIN_COMMAND)

    @property
    def is_overridden(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Interventions that steer, and those that drive, otherwise than the nominal, and so that it shows.

        Those whose expert never changes its command are left out: nobody steers a train.
        """
        steers = (np.abs(self.steer) >= MIN_COMMAND) & (np.abs(self.lateral_m) >= MIN_EFFECT_M)
        drives = (np.abs(self.drive) >= MIN_COMMAND) & (np.abs(self.speed_mps) >= MIN_EFFECT_MPS)
        steering, pedals = self.expert[:, :, 0].T
        return np.asarray(self.moves & steers & steering), np.asarray(self.moves & drives & pedals)

    def copies(self, nominal: int) -> list[tuple[int, frozenset[int]]]:
        """Groups in which candidates that steer or brake otherwise have one future, each with their policies.

        Throttle alone may change nothing at a top speed.

        Args:
            nominal: Index of the nominal policy, which is a candidate too.
        """
        known, first = np.unique(self.group, return_index=True)
        count = len(known)
        group, moves = np.append(self.group, known), np.append(self.moves, self.moves[first])
        policy = np.append(self.policy, np.full(count, nominal))
        future = np.append(self.future, self.nominal_future[first])
        steer, drive = (np.append(values, np.zeros(count)) for values in (self.steer, self.drive))
        order = np.lexsort((future, group))
        begins = np.ones(len(order), bool)
        begins[1:] = (np.diff(group[order]) != 0) | (np.diff(future[order]) != 0)
        start, stop = np.flatnonzero(begins), np.flatnonzero(np.append(begins[1:], True)) + 1
        found = []
        for i in np.flatnonzero((stop - start > 1) & moves[order][start]).tolist():
            same = order[start[i] : stop[i]]
            least = drive[same].min()
            brakes = np.ptp(drive[same]) >= MIN_BRAKING and least <= -MIN_BRAKING
            if brakes or np.ptp(steer[same]) >= MIN_COMMAND:
                found.append((int(group[same[0]]), frozenset(policy[same].tolist())))
        return found

    @property
    def is_anticipated(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Interventions whose acceleration has changed clearly after the branch, and those at the branch already."""
        at_branch, later = self.accel_mps2.T
        counts: NDArray[np.bool_] = np.abs(later) >= MIN_EFFECT_MPS2
        return counts, counts & (np.sign(later) * at_branch >= np.abs(later) / 2)

    @property
    def steering(self) -> Array:
        """Agreement of steering and lateral effect: 1, -1, or 0 where either is small or the drive differs too."""
        return _agreement(-self.steer, self.drive, self.lateral_m, MIN_EFFECT_M)

    @property
    def driving(self) -> Array:
        """Agreement of throttle minus brake and speed effect: 1, -1, or 0 where either is small or it steers too."""
        return _agreement(self.drive, self.steer, self.speed_mps, MIN_EFFECT_MPS)


@dataclass(frozen=True)
class Sights:
    """Images of one camera against those of the nominal, each field ``[interventions]``.

    Attributes:
        response_m: How far the vehicle is from its nominal at its first response.
        is_hidden: Whether the image of that observation is the nominal's, byte for byte.
        shown_m: How far it is at the first observation whose image is another, NaN where there is none.
    """

    response_m: Array
    is_hidden: NDArray[np.bool_]
    shown_m: Array

    @classmethod
    def of_all(cls, parts: Iterable[Sights]) -> Sights:
        """The interventions of several shards."""
        every = [cls(np.zeros(0), np.zeros(0, bool), np.zeros(0)), *parts]
        return cls(*(np.concatenate([getattr(part, field.name) for part in every]) for field in fields(cls)))

    @property
    def resolved_m(self) -> float:
        """What the camera can show: a quarter of its first other images shows less; infinity where it has none.

        A camera hides small ways more often than large ones: of those of at least this, fewer than three in four.
        """
        shown_m = np.sort(self.shown_m[np.isfinite(self.shown_m)])
        return float(shown_m[len(shown_m) // 4]) if len(shown_m) else np.inf


def _agreement(command: Array, other: Array, effect: Array, min_effect: float) -> Array:
    counts = (np.abs(command) >= MIN_COMMAND) & (np.abs(other) < MIN_COMMAND) & (np.abs(effect) >= min_effect)
    return np.where(counts, np.sign(command) * np.sign(effect), 0.0)


def lateral_effect_m(x_m: Array, y_m: Array, nominal_x_m: Array, nominal_y_m: Array, nominal_yaw_rad: Array) -> Array:
    """Offset from the nominal pose across the nominal heading, metres, positive to the left."""
    return np.cos(nominal_yaw_rad) * (y_m - nominal_y_m) - np.sin(nominal_yaw_rad) * (x_m - nominal_x_m)


def first_response(differs: NDArray[np.bool_], num_before: int) -> Index:
    """`Responses.first` from where a rollout differs from its nominal.

    Args:
        differs: Observations that differ ``[interventions, num_before + 11]``: before the branch, then from ``t_b`` on.
        num_before: Observations before the branch.
    """
    after = differs[:, num_before:]
    first = np.where(after.any(axis=1), after.argmax(axis=1), NO_RESPONSE)
    return np.where(differs[:, :num_before].any(axis=1), BEFORE_BRANCH, first).astype(np.int64)
