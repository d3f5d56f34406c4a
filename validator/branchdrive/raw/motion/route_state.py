"""Where recorded egos and target points lie on the polylines of their attempts.

Source: spec/05-raw-streams.md#projection, #target-points.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds, spec_limits
from branchdrive.contract.timing import FUTURE_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.route import Polylines
from branchdrive.raw.shard_view import ShardView

__all__ = [
    "Routes", "TargetProgress", "contradicts_route", "distinct_routes", "has_judged_rows", "last_progress_m",
    "misplaces_target_points", "route_tolerance_m", "routes", "target_progress",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_COLUMNS = (
    "x_m", "y_m", "yaw_rad", "route_progress_m", "route_offset_m", "route_heading_error_rad",
    "target_point_1_x_m", "target_point_1_y_m", "target_point_2_x_m", "target_point_2_y_m",
)  # fmt: skip
"""What the rules on routes read of an observation."""

_VERTICES_AT_ONCE = 1 << 17
"""Vertices of polylines that are prepared at once, but for one that has more: a few megabytes."""

_ROUNDING = 1e-6
"""Relative error of float32, and of what a pose in float32 is turned by."""


class Routes(NamedTuple):
    """Distinct polylines of a shard, and which of them each attempt has ``[rollouts]``; -1 where it has none.

    An attempt whose polyline breaks BD-VAL-001 or BD-VAL-005 has none.
    """

    polylines: list[tuple[Array, Array]]
    of_rollout: Index


def distinct_routes(view: ShardView) -> tuple[Index, Index]:
    """Attempts with distinct polylines ``[routes]``, and the one of these that each has ``[rollouts]``."""
    pairs = np.stack([view.rollouts.cells("route_x_m"), view.rollouts.cells("route_y_m")], axis=1)
    _, first, which = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    return first, which.ravel()


def routes(view: ShardView) -> Routes:
    """The routes of a shard; attempts of a group share theirs."""
    first, own = distinct_routes(view)
    polylines = [(view.rollouts["route_x_m"][row], view.rollouts["route_y_m"][row]) for row in first]
    is_usable = np.array([_is_usable(x, y) for x, y in polylines] + [False])
    return Routes(polylines, np.where(is_usable[own], own, -1))


def _is_usable(x_m: Array, y_m: Array) -> bool:
    return (
        2 <= len(x_m) == len(y_m) <= spec_limits().max_route_vertices
        and bool(np.isfinite(x_m).all() and np.isfinite(y_m).all())
        and not ((np.diff(x_m) == 0) & (np.diff(y_m) == 0)).any()
    )


def _judged_rows(view: ShardView) -> tuple[Index, Index]:
    """Observations of the windows of attempts with a route, by route, and the first that says what each does."""
    lines, observations = view.cached(routes), view.observations
    offset = observations.tick - np.append(view.branch_tick, 0)[observations.rollout]
    route = np.append(np.where(view.branched, lines.of_rollout, -1), -1)[observations.rollout]
    rows = np.flatnonzero((route >= 0) & (offset >= PREDECESSOR_OFFSET) & (offset <= FUTURE_OFFSETS[-1]))
    columns = [route[rows], *(observations[name][rows] for name in _COLUMNS)]
    order = np.lexsort((columns[1], columns[0]))  # attempts of a group drive alike until they branch
    is_new = np.ones(len(rows), bool)
    is_new[1:] = np.logical_or.reduce([values[order][1:] != values[order][:-1] for values in columns])
    rows = rows[order]
    return rows, rows[is_new][np.cumsum(is_new) - 1]


def has_judged_rows(view: ShardView) -> Mask:
    """Attempts with an observation whose place on a route can be judged ``[rollouts]``."""
    rows, _ = view.cached(_judged_rows)
    return np.bincount(view.observations.rollout[rows], minlength=view.num_rollouts).astype(bool)


def _rows_by_route(view: ShardView) -> Iterator[tuple[Polylines, Index, Index]]:
    """Polylines, the distinct judged observations of the attempts that have one of them, and which that is."""
    lines, (rows, same) = view.cached(routes), view.cached(_judged_rows)
    rows = rows[rows == same]
    route = lines.of_rollout[view.observations.rollout[rows]]  # ascends
    used, place = np.unique(route, return_inverse=True)
    part_of = np.cumsum([len(lines.polylines[i][0]) for i in used], dtype=np.int64) // _VERTICES_AT_ONCE
    for part in np.unique(part_of):
        first, stop = np.searchsorted(part_of, [part, part + 1])
        here = slice(*np.searchsorted(place, [first, stop]))
        yield Polylines([lines.polylines[i] for i in used[first:stop]]), rows[here], place[here] - first


def route_tolerance_m(size_m: Array) -> Array:
    """How far a recorded position of the route may be off, by its size."""
    return np.asarray(physical_bounds().route_tolerance_m + _ROUNDING * np.abs(size_m))


def contradicts_route(view: ShardView) -> Mask:
    """Observations of the windows whose progress, offset and heading error are not those of a nearest foot."""
    observations = view.observations
    x, y, yaw, progress, offset, error = (
        observations[name].astype(np.float64)
        for name in ("x_m", "y_m", "yaw_rad", "route_progress_m", "route_offset_m", "route_heading_error_rad")
    )
    bounds, contradicts = physical_bounds(), np.zeros(len(observations), bool)
    for polylines, rows, polyline in _rows_by_route(view):
        reach = np.abs(offset[rows]) + 2 * route_tolerance_m(offset[rows])
        point, foot = polylines.feet_within(x[rows], y[rows], polyline, reach)
        distance = np.abs(foot.offset_m)
        nearest = np.full(len(rows), np.inf)
        np.minimum.at(nearest, point, distance)
        row = rows[point]
        fits = (
            (distance <= nearest[point] + bounds.route_tolerance_m)
            & (np.abs(foot.progress_m - progress[row]) <= route_tolerance_m(foot.progress_m))
            & (np.abs(foot.offset_m - offset[row]) <= route_tolerance_m(foot.offset_m))
            & (np.abs(wrap_rad(yaw[row] - foot.heading_rad - error[row])) <= bounds.route_tolerance_rad)
        )
        contradicts[rows] = True
        contradicts[row[fits]] = False
    rows, same = view.cached(_judged_rows)
    contradicts[rows] = contradicts[same]
    return contradicts


class TargetProgress(NamedTuple):
    """Where on their polyline the target points of observations may lie, each field ``[2, observations]``.

    Attributes:
        least_m: Smallest progress that has the point ahead of the ego, or of the first one, ``inf`` where none has.
        most_m: Largest progress that has the point, ``-inf`` where none has.
    """

    least_m: Array
    most_m: Array


def target_progress(view: ShardView) -> TargetProgress:
    """Progress of target points of the windows; other observations have ``inf`` and ``-inf``."""
    observations = view.observations
    x, y, yaw, progress = (
        observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad", "route_progress_m")
    )
    points = [[observations[f"target_point_{number}_{axis}_m"] for number in (1, 2)] for axis in ("x", "y")]
    least_m, most_m = (np.full((2, len(observations)), value) for value in (np.inf, -np.inf))
    for polylines, rows, polyline in _rows_by_route(view):
        ahead, left = (np.concatenate([values[rows] for values in axis]).astype(np.float64) for axis in points)
        cos, sin = (np.tile(turn(yaw[rows]), 2) for turn in (np.cos, np.sin))
        target_x, target_y = (
            np.tile(x[rows], 2) + cos * ahead - sin * left,
            np.tile(y[rows], 2) + sin * ahead + cos * left,
        )
        reach = route_tolerance_m(np.hypot(ahead, left))
        point, foot = polylines.feet_within(target_x, target_y, np.tile(polyline, 2), reach)
        number, point = np.divmod(point, len(rows))
        end_m = polylines.length_m[polyline][point]
        is_last = foot.progress_m >= end_m - route_tolerance_m(end_m)
        from_m = progress[rows] - route_tolerance_m(progress[rows])
        for which in (0, 1):
            is_ahead = (number == which) & ((foot.progress_m >= from_m[point]) | (is_last & (which == 1)))
            least, most = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
            np.minimum.at(least, point[is_ahead], foot.progress_m[is_ahead])
            np.maximum.at(most, point[number == which], foot.progress_m[number == which])
            least_m[which, rows], most_m[which, rows] = least, most
            from_m = least + route_tolerance_m(least)
    rows, same = view.cached(_judged_rows)
    for values in (least_m, most_m):
        values[:, rows] = values[:, same]
    return TargetProgress(least_m, most_m)


def misplaces_target_points(view: ShardView) -> Mask:
    """Observations of the windows whose first target point is not on the route ahead, or the second not behind it."""
    rows, _ = view.cached(_judged_rows)
    misplaces = np.zeros(len(view.observations), bool)
    misplaces[rows] = ~np.isfinite(view.cached(target_progress).least_m[:, rows]).all(axis=0)
    return misplaces


def last_progress_m(view: ShardView) -> tuple[Array, Array]:
    """Furthest recorded progress of each attempt, 0 without observations, and the length of its route ``[rollouts]``.

    The length of an unusable route is NaN.
    """
    observations, lines = view.observations, view.cached(routes)
    furthest = np.zeros(view.num_rollouts + 1)
    np.maximum.at(furthest, observations.rollout, observations["route_progress_m"].astype(np.float64))
    lengths = [
        float(np.hypot(np.diff(x), np.diff(y)).sum()) if _is_usable(x, y) else np.nan for x, y in lines.polylines
    ]
    return furthest[:-1], np.array([*lengths, np.nan])[lines.of_rollout]
