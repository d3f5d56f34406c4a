"""Which way routes turn while the navigation commands left or right.

Of a run of observations with one such command, the route turns by the sum of the angles between its segments at the
vertices between the least and the largest progress of the run. A command may come well before its junction, and last
beyond it, so that what the route turns to the named side is looked for further.

Source: spec/05-raw-streams.md#navigation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.driving.angle import wrap_rad
from branchdrive.raw.motion.residual import follows
from branchdrive.raw.motion.route_state import routes
from branchdrive.raw.shard_view import ShardView

__all__ = ["CommandedTurns", "commanded_turns"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_EARLY_M = 50.0
"""How far before its junction a command may come, and how far beyond it last."""


class CommandedTurns(NamedTuple):
    """Runs of observations with the command left or right, in which the progress grows no faster than the ego drives.

    Attributes:
        first: First observation of each run ``[runs]``.
        away_rad: How far the route turns to the side that is not named, less what it turns to the named one ``[runs]``.
        named_rad: How far it turns to the named side from 50 m before to 50 m beyond, all turns together ``[runs]``.
    """

    first: Index
    away_rad: Array
    named_rad: Array


def commanded_turns(view: ShardView) -> CommandedTurns:
    """Runs of attempts with a route; see `CommandedTurns`."""
    observations, lines = view.observations, view.cached(routes)
    route = np.append(lines.of_rollout, -1)[observations.rollout]
    side = observations.equals("command", "left").astype(np.int64) - observations.equals("command", "right")
    progress = observations["route_progress_m"].astype(np.float64)
    rows = np.flatnonzero((route >= 0) & (side != 0))
    goes_on = (follows(observations) & (np.diff(side, prepend=0) == 0) & ~_leaps(view, progress))[rows]
    starts = np.flatnonzero(~(goes_on & (np.diff(rows, prepend=-2) == 1)))
    first = rows[starts]
    least, most = (
        extreme.reduceat(progress[rows], starts) if len(starts) else progress[:0]
        for extreme in (np.minimum, np.maximum)
    )
    away, named = (np.zeros(len(first)) for _ in range(2))
    for i in np.unique(route[first]).tolist():
        own, (x, y) = route[first] == i, lines.polylines[i]
        away[own], named[own] = _turned(x, y, least[own], most[own], side[first[own]])
    return CommandedTurns(first, away, named)


def _leaps(view: ShardView, progress: Array) -> NDArray[np.bool_]:
    """Observations whose progress differs from the one before by more than twice the way: it is of another foot."""
    x, y = (view.observations[name] for name in ("x_m", "y_m"))
    way = np.hypot(np.diff(x, prepend=np.nan), np.diff(y, prepend=np.nan))
    return np.asarray(np.abs(np.diff(progress, prepend=np.nan)) > physical_bounds().displacement_m + 2 * way)


def _turned(x_m: Array, y_m: Array, least_m: Array, most_m: Array, side: Index) -> tuple[Array, Array]:
    """`CommandedTurns.away_rad` and `named_rad` of runs on one polyline, by progress and side, 1 for the left."""
    east, north = np.diff(x_m), np.diff(y_m)
    vertex_m = np.cumsum(np.hypot(east, north))[:-1]
    turn = wrap_rad(np.diff(np.arctan2(north, east)))

    def between(values: Array, first_m: Array, last_m: Array) -> Array:
        total = np.append(0.0, np.cumsum(values))
        begin, end = np.searchsorted(vertex_m, first_m, side="right"), np.searchsorted(vertex_m, last_m)
        return np.asarray(total[np.maximum(begin, end)] - total[begin])

    further = least_m - _EARLY_M, most_m + _EARLY_M
    left, right = (between(np.maximum(sense * turn, 0.0), *further) for sense in (1, -1))
    return -side * between(turn, least_m, most_m), np.where(side > 0, left, right)
