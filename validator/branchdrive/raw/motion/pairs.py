"""Pairs of an observation and an actor that can decide whether a shard's evidence is sound.

Boxes are compared only where their outcome matters. Let ``r`` be recorded and ``e`` the tolerance.
A pair with the value ``x`` agrees with ``r`` where ``|r - x| <= e (1 + x)``, so ``x <= (r + e) / (1 - e)``;
a pair that contradicts ``r`` is smaller still. Pairs that a lower bound places beyond this limit
decide nothing. Where evidence is recorded as unavailable, every pair in range contradicts it, a time to
collision every pair that may close.

Observations that are copies as a whole have the pairs of their sources, and are left out.

Source: spec/05-raw-streams.md#evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import spec_limits
from branchdrive.driving.box import Boxes, pair_bounds
from branchdrive.driving.risk import RANGE_M, PairRisk, corridor_excess_m, pair_risk
from branchdrive.raw.copies import Copies
from branchdrive.raw.shard_view import ShardView

__all__ = ["deciding_pairs", "pairs_of_frame", "pairs_of_rows"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_NEAR_M = RANGE_M + 1.0
"""Gap beyond which no pair is looked at."""

_ROWS_AT_ONCE = 1 << 14
"""Rows whose bounds are computed at once: intermediate arrays of 128 KiB stay in the cache."""

_VEHICLE, _PEDESTRIAN, _STATIC, _OTHER = range(4)
_KIND = {"vehicle": _VEHICLE, "cycle": _VEHICLE, "pedestrian": _PEDESTRIAN, "static": _STATIC}


@dataclass(frozen=True)
class _Egos:
    """The ego at each observation ``[frames]``."""

    boxes: Boxes
    speed_mps: Array


def _egos(view: ShardView) -> _Egos:
    observations = view.observations
    # Observations of an unknown rollout (-1) get some box: they are in no pair.
    extents = (
        np.append(view.rollouts[name].astype(np.float64), 1.0)[observations.rollout]
        for name in ("ego_length_m", "ego_width_m")
    )
    boxes = Boxes(*(observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad")), *extents)
    return _Egos(boxes, observations["speed_mps"].astype(np.float64))


def _kinds(view: ShardView) -> NDArray[np.int8]:
    codes, classes = view.stream("actors").categories("actor_class")
    return np.array([_KIND.get(actor_class, _OTHER) for actor_class in classes] + [_OTHER], np.int8)[codes]


def _limits(view: ShardView, name: str, column: str) -> Array:
    """Value beyond which no pair of an observation decides `column`, ``-inf`` where there is no evidence."""
    evidence, e = view.stream("evidence"), view.descriptor.tolerances.evidence
    limit = (evidence[column].astype(np.float64) + e) / (1 - e)
    limit += 1e-9 * (1 + np.abs(limit))  # far above rounding
    limit[~evidence[f"{name}_available"].astype(bool)] = np.finfo(np.float64).max  # what cannot close is beyond it
    frame = view.observations.rows_of(evidence)
    limits = np.full(len(view.observations), -np.inf)
    np.maximum.at(limits, frame[frame >= 0], limit[frame >= 0])
    return limits


class _Actors(NamedTuple):
    """Rows of the actors table and what pairs need of them, each field ``[rows]``."""

    row: Index
    boxes: Boxes
    vel_x_mps: Array
    vel_y_mps: Array

    def take(self, places: NDArray[np.intp]) -> _Actors:
        return _Actors(self.row[places], self.boxes.take(places), self.vel_x_mps[places], self.vel_y_mps[places])


_ACTOR_COLUMNS = (*Boxes._fields, "vel_x_mps", "vel_y_mps")


def _actors(rows: Index, columns: Sequence[NDArray[Any]]) -> _Actors:
    *box, vel_x, vel_y = (values.astype(np.float64, copy=False) for values in columns)
    return _Actors(rows, Boxes(*box), vel_x, vel_y)


def _actors_within_limits(view: ShardView) -> _Actors:
    """Actors whose bounds do not rule them out, at observations that are no copies."""
    egos, stream = view.cached(_egos), view.stream("actors")
    frame, kinds = view.observations.rows_of(stream), view.cached(_kinds)
    yaw = egos.boxes.yaw_rad
    ego_vel_x, ego_vel_y = egos.speed_mps * np.cos(yaw), egos.speed_mps * np.sin(yaw)
    ego_reach = np.hypot(egos.boxes.length_m, egos.boxes.width_m) / 2
    separation = _limits(view, "separation", "separation_m")
    gap_limits = np.stack([separation] * 4)
    np.maximum(separation, _limits(view, "nearest_vehicle", "nearest_vehicle_gap_m"), out=gap_limits[_VEHICLE])
    np.maximum(separation, _limits(view, "nearest_pedestrian", "nearest_pedestrian_gap_m"), out=gap_limits[_PEDESTRIAN])
    ttc_limits = _limits(view, "ttc", "ttc_s")
    is_judged = np.append(view.cached(Copies).at_moments("observations").judged(len(view.observations)), False)
    pieces = []
    for start, columns in stream.pieces(_ACTOR_COLUMNS, _ROWS_AT_ONCE) if len(view.observations) else ():
        judged = np.flatnonzero(is_judged[frame[start : start + len(columns[0])]])
        if len(judged) < len(columns[0]):
            columns = [values[judged] for values in columns]
        x, y, _, length, width, vel_x, vel_y = columns
        here = start + judged
        at = frame[here]
        half_length, half_width = length.astype(np.float64) / 2, width.astype(np.float64) / 2
        bounds = pair_bounds(
            x - egos.boxes.x_m[at],
            y - egos.boxes.y_m[at],
            ego_reach[at] + np.sqrt(half_length * half_length + half_width * half_width),
            vel_x - ego_vel_x[at],
            vel_y - ego_vel_y[at],
        )
        gap_limit = gap_limits.take(kinds[here] * np.int64(len(yaw)) + at, mode="clip")  # faster than [kind, frame]
        matters = ~(bounds.gap_m > gap_limit) | ~(bounds.ttc_s > ttc_limits[at])
        kept = np.flatnonzero(matters & (bounds.gap_m <= _NEAR_M))
        pieces.append([here[kept], *(values[kept] for values in columns)])  # the rest is not held
    if not pieces:
        return _actors(np.zeros(0, np.int64), [np.zeros(0)] * len(_ACTOR_COLUMNS))
    rows, *columns = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    return _actors(rows, columns)


def _routes(view: ShardView) -> tuple[list[tuple[Array, Array, float]], Index]:
    """Distinct routes with their ego widths, and which of them each attempt has."""
    index: dict[tuple[bytes, bytes, float], int] = {}
    columns = (view.rollouts[name] for name in ("route_x_m", "route_y_m", "ego_width_m"))
    own = [index.setdefault((x.tobytes(), y.tobytes(), float(w)), len(index)) for x, y, w in zip(*columns, strict=True)]
    return [(np.frombuffer(x), np.frombuffer(y), width) for x, y, width in index], np.array(own, np.int64)


def _corridor_m(view: ShardView, objects: _Actors) -> Array:
    """Corridor excess of static objects; equal boxes of attempts with equal routes are measured once.

    Static objects keep their place, so sorting by route and actor brings equal boxes together.
    """
    stream = view.stream("actors")
    routes, route_of = _routes(view)
    route = route_of[stream.rollout[objects.row]]
    order = np.lexsort((stream["actor_id"][objects.row], route))
    objects, route = objects.take(order), route[order]
    is_new = np.ones(len(order), bool)
    is_new[1:] = np.logical_or.reduce([values[1:] != values[:-1] for values in (route, *objects.boxes)])
    first = np.flatnonzero(is_new)
    excess = np.full(len(first), -np.inf)
    for index, (x, y, width) in enumerate(routes):
        here = np.flatnonzero(route[first] == index)
        if len(here) and len(x) == len(y) <= spec_limits().max_route_vertices:  # else BD-VAL-005 excludes the attempt
            excess[here] = corridor_excess_m(objects.boxes.take(first[here]), x, y, width)
    found = np.empty(len(order))
    found[order] = excess[np.cumsum(is_new) - 1]
    return found


def _pairs(view: ShardView, actors: _Actors) -> PairRisk:
    """The pairs that actors form; `PairRisk.frame` indexes the view's observations."""
    egos, stream = view.cached(_egos), view.stream("actors")
    static = np.flatnonzero(view.cached(_kinds)[actors.row] == _STATIC)
    corridor_m = np.full(len(actors.row), -np.inf)
    corridor_m[static] = _corridor_m(view, actors.take(static))
    kind = view.cached(_kinds)[actors.row]
    return pair_risk(
        egos.boxes,
        egos.speed_mps,
        actors.boxes,
        actors.vel_x_mps,
        actors.vel_y_mps,
        stream["actor_id"][actors.row].astype(np.int64),
        kind == _VEHICLE,
        kind == _PEDESTRIAN,
        view.observations.rows_of(stream)[actors.row],
        corridor_m,
    )


def deciding_pairs(view: ShardView) -> PairRisk:
    """Pairs that can agree with or contradict recorded evidence, in order of the actor rows.

    Those of observations that are copies are those of their sources; nominals, which copy nothing, have theirs.
    """
    return _pairs(view, _actors_within_limits(view))


def pairs_of_frame(view: ShardView, frame: int) -> PairRisk:
    """All pairs of one observation, which becomes frame 0."""
    pairs = pairs_of_rows(view, np.flatnonzero(view.observations.rows_of(view.stream("actors")) == frame))
    return replace(pairs, frame=np.zeros(len(pairs.frame), np.int64))


def pairs_of_rows(view: ShardView, rows: Index) -> PairRisk:
    """Pairs of the actors in rows of the actors table, in their order; `PairRisk.frame` indexes observations."""
    stream = view.stream("actors")
    return _pairs(view, _actors(rows, [stream[name][rows] for name in _ACTOR_COLUMNS]))
