"""Whether target points follow from polyline and progress: they never go back where the progress grows.

Source: spec/05-raw-streams.md#target-points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.raw.motion.route_state import route_tolerance_m, routes, target_progress
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows

__all__ = ["TargetOrder", "target_order"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_OFFSETS = (PREDECESSOR_OFFSET, *HISTORY_OFFSETS, *FUTURE_OFFSETS)

_ATTEMPTS_AT_ONCE = 1 << 10


class TargetOrder(NamedTuple):
    """What contradicts what.

    Attributes:
        compared: Attempts with two observations that can be compared ``[rollouts]``.
        row: Observations whose target points are not those of their progress ``[rows]``.
        other: Observation of the attempt, or of its nominal, that contradicts each ``[rows]``.
        number: Which target point it is, 0 or 1 ``[rows]``.
    """

    compared: Mask
    row: Index
    other: Index
    number: Index


class _Points(NamedTuple):
    """Target points of observations of attempts, each field ``[attempts, observations]``; NaN where there is none."""

    progress_m: Array
    x_m: Array
    y_m: Array
    least_m: Array
    most_m: Array
    slack_m: Array

    def take(self, attempts: Index) -> _Points:
        return _Points(*(values[attempts] for values in self))


def target_order(view: ShardView) -> TargetOrder:
    """Observations of the windows whose target points are contradicted by others of the attempt or its nominal."""
    observations, route = view.observations, np.append(view.cached(routes).of_rollout, -1)
    attempts = np.flatnonzero(view.branched & (route[:-1] >= 0) & observations.is_there)
    compared, found = np.zeros(view.num_rollouts, bool), [np.zeros((3, 0), np.int64)]
    for start in range(0, len(attempts), _ATTEMPTS_AT_ONCE):
        part = attempts[start : start + _ATTEMPTS_AT_ONCE]
        own = window_rows(view, observations, part, _OFFSETS)
        nominal = np.where(route[view.nominal[part]] == route[part], view.nominal[part], part)
        nominal = np.where(view.branched[nominal], nominal, part)
        rows = np.concatenate([own, window_rows(view, observations, nominal, _OFFSETS)], axis=1)
        for number in (0, 1):
            points = _points(view, rows, number)
            compared[part] |= np.isfinite(points.least_m[:, : len(_OFFSETS)]).sum(axis=1) > 1
            doubtful = np.flatnonzero(_may_go_back(points))
            for attempt in doubtful.tolist():  # few
                pairs = _contradictions(points.take(np.array([attempt])))
                found.append(
                    np.stack([rows[attempt][pairs[0]], rows[attempt][pairs[1]], np.full(len(pairs[0]), number)])
                )
    row, other, number = np.concatenate(found, axis=1)
    _, first = np.unique(row, return_index=True)
    return TargetOrder(compared, row[first], other[first], number[first])


def _points(view: ShardView, rows: Index, number: int) -> _Points:
    observations, places = view.observations, view.cached(target_progress)
    there = rows >= 0
    least, most = (np.where(there, values[number][rows], np.nan) for values in places)
    known = np.isfinite(least) & np.isfinite(most)
    progress, x, y, ahead, left = (
        np.where(known, observations[name][rows].astype(np.float64), np.nan)
        for name in (
            "route_progress_m",
            "x_m",
            "y_m",
            f"target_point_{number + 1}_x_m",
            f"target_point_{number + 1}_y_m",
        )
    )
    slack = route_tolerance_m(np.hypot(ahead, left)) + route_tolerance_m(progress)
    return _Points(progress, x, y, np.where(known, least, np.nan), np.where(known, most, np.nan), slack)


def _may_go_back(points: _Points) -> Mask:
    """Attempts in which a target point may lie behind that of an observation of less progress or the same."""
    last = np.where(np.isfinite(points.least_m), points.progress_m, np.inf)
    order = np.lexsort((-points.least_m, last), axis=1)
    least, most, slack = (np.take_along_axis(v, order, axis=1) for v in (points.least_m, points.most_m, points.slack_m))
    furthest = np.fmax.accumulate(least, axis=1)
    return np.asarray((most < furthest - slack).any(axis=1))


def _contradictions(points: _Points) -> tuple[Index, Index]:
    """Places of observations of one attempt, and of what contradicts each: of its own or its nominal's observations.

    Of two of its own the later one is at fault.
    """
    num_own = len(_OFFSETS)
    progress, x, y, least, most, slack = (values[0] for values in points)
    own = np.s_[:num_own, None]
    both = slack[own] + slack
    same = (x[own] == x) & (y[own] == y) & (progress[own] == progress)
    is_behind = ((progress[own] >= progress + both) | same) & (most[own] < least - both)
    is_beyond = ((progress >= progress[own] + both) | same) & (most < least[own] - both)
    is_earlier = np.arange(num_own)[:, None] > np.arange(2 * num_own)
    pairs = (is_behind | is_beyond) & (is_earlier | (np.arange(2 * num_own) >= num_own))
    row, other = np.nonzero(pairs)
    return row, other
