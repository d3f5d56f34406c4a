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
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.box import Boxes, pair_bounds
from branchdrive.driving.risk import RANGE_M, PairRisk, corridor_excess_m, pair_risk
from branchdrive.raw.copies import Copies
from branchdrive.raw.motion.route_state import routes
from branchdrive.raw.shard_view import ShardView

__all__ = ["deciding_pairs", "pairs_of_frame", "pairs_of_rows"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

V = TypeVar("V", bound=np.generic)

_NEAR_M = RANGE_M + 1.0
"""Gap beyond which no pair is looked at."""

_ROWS_AT_ONCE = 1 << 14
"""Rows whose bounds are computed at once: intermediate arrays of 64 KiB stay in the cache."""

_EVERY = slice(None)
_POSE = ("x_m", "y_m", "yaw_rad")

_VEHICLE, _PEDESTRIAN, _STATIC, _OTHER = range(4)
_KIND = {"vehicle": _VEHICLE, "cycle": _VEHICLE, "pedestrian": _PEDESTRIAN, "static": _STATIC}


@dataclass(frozen=True)
class _Egos:
    """The ego at observations ``[frames]``."""

    boxes: Boxes
    speed_mps: Array


def _egos(view: ShardView, frames: slice = _EVERY) -> _Egos:
    observations = view.observations
    # Observations of an unknown rollout (-1) get some box: they are in no pair.
    extents = (
        np.append(view.rollouts[name].astype(np.float64), 1.0)[observations.rollout[frames]]
        for name in ("ego_length_m", "ego_width_m")
    )
    boxes = Boxes(*(observations[name][frames].astype(np.float64) for name in _POSE), *extents)
    return _Egos(boxes, observations["speed_mps"][frames].astype(np.float64))


def _kinds(view: ShardView, rows: Index | slice = _EVERY) -> NDArray[np.int8]:
    codes, classes = view.stream("actors").categories("actor_class")
    return np.array([_KIND.get(actor_class, _OTHER) for actor_class in classes] + [_OTHER], np.int8)[codes[rows]]


def _limits(view: ShardView, name: str, column: str) -> NDArray[np.float32]:
    """Value beyond which no pair of an observation decides `column`, ``-inf`` where there is no evidence."""
    evidence, e = view.stream("evidence"), view.descriptor.tolerances.evidence
    limit = (evidence[column].astype(np.float64) + e) / (1 - e)
    limit += 1e-6 * (1 + np.abs(limit))  # far above rounding
    limit[~evidence[f"{name}_available"].astype(bool)] = np.finfo(np.float32).max  # what cannot close is beyond it
    frame = view.observations.rows_of(evidence)
    limits = np.full(len(view.observations), -np.inf, np.float32)
    np.maximum.at(limits, frame[frame >= 0], limit[frame >= 0].astype(np.float32))
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
    egos, stream = _egos(view), view.stream("actors")
    frame, kinds = view.observations.rows_of(stream), _kinds(view)
    yaw = egos.boxes.yaw_rad
    ego_vel_x, ego_vel_y = egos.speed_mps * np.cos(yaw), egos.speed_mps * np.sin(yaw)
    ego_reach = (np.hypot(egos.boxes.length_m, egos.boxes.width_m) / 2).astype(np.float32)
    separation = _limits(view, "separation", "separation_m")
    gap_limits = np.stack([separation] * 4)
    np.maximum(separation, _limits(view, "nearest_vehicle", "nearest_vehicle_gap_m"), out=gap_limits[_VEHICLE])
    np.maximum(separation, _limits(view, "nearest_pedestrian", "nearest_pedestrian_gap_m"), out=gap_limits[_PEDESTRIAN])
    ttc_limits = _limits(view, "ttc", "ttc_s")
    is_judged = np.append(view.cached(Copies).at_moments("observations").judged(len(view.observations)), False)
    judged, kept = np.flatnonzero(is_judged[frame]), [np.zeros(0, np.int64)]
    for start in range(0, len(judged), _ROWS_AT_ONCE):
        rows = judged[start : start + _ROWS_AT_ONCE]
        at = _take(frame, rows)
        half_length, half_width = (_take(stream[name], rows) / 2 for name in ("length_m", "width_m"))
        bounds = pair_bounds(
            _take(stream["x_m"], rows) - _take(egos.boxes.x_m, at),
            _take(stream["y_m"], rows) - _take(egos.boxes.y_m, at),
            _take(ego_reach, at) + np.sqrt(half_length * half_length + half_width * half_width),
            _take(stream["vel_x_mps"], rows) - _take(ego_vel_x, at),
            _take(stream["vel_y_mps"], rows) - _take(ego_vel_y, at),
        )
        gap_limit = _take(gap_limits.ravel(), _take(kinds, rows) * np.int64(len(yaw)) + at)
        matters = ~(bounds.gap_m > gap_limit) | ~(bounds.ttc_s > _take(ttc_limits, at))
        kept.append(rows[matters & (bounds.gap_m <= _NEAR_M)])
    rows = np.concatenate(kept)
    return _actors(rows, [stream[name][rows] for name in _ACTOR_COLUMNS])


def _take(values: NDArray[V], places: Index) -> NDArray[V]:
    """Values at places that there are, without a look at whether there are: faster than by index."""
    return values.take(places, mode="clip")


def _corridor_m(view: ShardView, objects: _Actors) -> Array:
    """Corridor excess of static objects; equal boxes of attempts with equal routes are measured once.

    Static objects keep their place, so sorting by route and actor brings equal boxes together.
    """
    lines, stream = view.cached(routes), view.stream("actors")
    attempt = stream.rollout[objects.row]
    route, width_m = lines.of_rollout[attempt], view.rollouts["ego_width_m"][attempt].astype(np.float64)
    order = np.lexsort((stream["actor_id"][objects.row], width_m, route))
    objects, route, width_m = objects.take(order), route[order], width_m[order]
    is_new = np.ones(len(order), bool)
    is_new[1:] = np.logical_or.reduce([values[1:] != values[:-1] for values in (route, width_m, *objects.boxes)])
    first = np.flatnonzero(is_new)
    excess = np.full(len(first), -np.inf)
    for index in np.unique(route[first]):
        here = np.flatnonzero(route[first] == index)
        if index >= 0:  # else BD-VAL-005 excludes the attempt
            of_route, (x, y) = first[here], lines.polylines[index]
            excess[here] = corridor_excess_m(objects.boxes.take(of_route), x, y, width_m[of_route])
    found = np.empty(len(order))
    found[order] = excess[np.cumsum(is_new) - 1]
    return found


def _pairs(view: ShardView, egos: _Egos, actors: _Actors, frame: Index) -> PairRisk:
    """The pairs that actors form with the ego at a frame each, which indexes `egos`."""
    kind = _kinds(view, actors.row)
    static = np.flatnonzero(kind == _STATIC)
    corridor_m = np.full(len(actors.row), -np.inf)
    corridor_m[static] = _corridor_m(view, actors.take(static))
    return pair_risk(
        egos.boxes,
        egos.speed_mps,
        actors.boxes,
        actors.vel_x_mps,
        actors.vel_y_mps,
        view.stream("actors")["actor_id"][actors.row].astype(np.int64),
        kind == _VEHICLE,
        kind == _PEDESTRIAN,
        frame,
        corridor_m,
    )


def deciding_pairs(view: ShardView) -> PairRisk:
    """Pairs that can agree with or contradict recorded evidence, in order of the actor rows.

    Those of observations that are copies are those of their sources; nominals, which copy nothing, have theirs.
    """
    return _pairs_of_shard(view, _actors_within_limits(view))


def _pairs_of_shard(view: ShardView, actors: _Actors) -> PairRisk:
    """The pairs that actors form; `PairRisk.frame` indexes the view's observations."""
    return _pairs(view, _egos(view), actors, view.observations.rows_of(view.stream("actors"))[actors.row])


def pairs_of_frame(view: ShardView, frame: int, poses_of: int | None = None) -> PairRisk:
    """All pairs of one observation, which becomes frame 0.

    Args:
        view: The shard.
        frame: The observation.
        poses_of: Another observation, which actors have their poses of; those that it lacks are in no pair.
    """
    stream = view.stream("actors")
    rows = _rows_of_frame(view, frame)
    columns = [stream[name][rows] for name in _ACTOR_COLUMNS]
    if poses_of is not None:
        others = _rows_of_frame(view, poses_of)
        _, here, there = np.intersect1d(stream["actor_id"][rows], stream["actor_id"][others], return_indices=True)
        rows, posed = rows[here], others[there]
        columns = [stream[name][posed if name in _POSE else rows] for name in _ACTOR_COLUMNS]
    egos = _egos(view, slice(frame, frame + 1))
    return _pairs(view, egos, _actors(rows, columns), np.zeros(len(rows), np.int64))


def _rows_of_frame(view: ShardView, frame: int) -> Index:
    """Rows of the actors table at an observation."""
    at = slice(frame, frame + 1)
    (first,), (stop,) = view.stream("actors").span(view.observations.rollout[at], view.observations.tick[at])
    return np.arange(first, stop)


def pairs_of_rows(view: ShardView, rows: Index) -> PairRisk:
    """Pairs of the actors in rows of the actors table, in their order; `PairRisk.frame` indexes observations."""
    stream = view.stream("actors")
    return _pairs_of_shard(view, _actors(rows, [stream[name][rows] for name in _ACTOR_COLUMNS]))
