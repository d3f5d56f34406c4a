"""Objects of the model layer: what sensors of the vehicle tell of others at the observations up to the branch.

They follow from the recorded actors of the nominal at ``t_b - 75 .. t_b``, so that all candidates of a group share
them and nothing later is in them. Source: spec/12-model.md#objects.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.object_sensor import NUM_VARIATES, Bodies, in_sight, measured, nearest
from branchdrive.model.inputs import empty_columns
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import take_float, window_rows
from branchdrive.statistics.random_words import WORDS_PER_NORMAL, normals, words
from branchdrive.tables.frame import Frame

__all__ = ["OBJECTS", "object_columns", "seen_objects"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

OBJECTS = "objects"
"""Name of the table."""

_POSE = ("x_m", "y_m", "yaw_rad")
_OTHERS = ("length_m", "width_m", "vel_x_mps", "vel_y_mps")
_SEED = 0
_MOMENTS_AT_ONCE = 64


def object_columns(view: ShardView, nominals: Index) -> Frame:
    """Objects around nominal rollouts with whole windows, in the order of observations and objects of each."""
    if "actors" not in view or not len(nominals):
        columns = LAYER_TABLES[OBJECTS].columns
        return empty_columns([column for column in columns if column.name != "partition"])
    actors, num_moments = view.stream("actors"), len(HISTORY_OFFSETS)
    ego = window_rows(view, view.observations, nominals, HISTORY_OFFSETS).ravel()
    ticks = view.branch_tick[nominals][:, None] + np.array(HISTORY_OFFSETS)
    start, stop = (rows.ravel() for rows in actors.span(np.repeat(nominals[:, None], num_moments, axis=1), ticks))
    moment = np.repeat(np.arange(len(ego)), stop - start)
    row = np.arange(len(moment)) + (start - np.cumsum(stop - start) + (stop - start))[moment]
    codes, classes = actors.categories("actor_class")
    return seen_objects(
        {name: take_float(view.observations, name, ego) for name in _POSE},
        {
            **{name: take_float(actors, name, row) for name in (*_POSE, *_OTHERS)},
            "actor_id": actors["actor_id"][row],
            "actor_class": np.array(classes, object)[codes[row]],
        },
        moment,
        view.rollouts["group_id"][nominals],
    )


def seen_objects(
    ego: Mapping[str, Array],
    actors: Mapping[str, NDArray[Any]],
    moment: Index,
    names: NDArray[np.object_],
) -> Frame:
    """Objects at the observations of histories, in the order of observations and objects of each.

    Args:
        ego: Its `x_m`, `y_m` and `yaw_rad` at the observations, history by history ``[histories * 16]``.
        actors: Columns of the actors that were recorded then, each ``[n]``.
        moment: Place of the observation of each, ascending ``[n]``.
        names: What each history is called in `group_id`; the noise follows from it ``[histories]``.
    """
    num_moments = len(HISTORY_OFFSETS)
    others = (np.asarray(actors[name], np.float64) for name in ("yaw_rad", *_OTHERS))
    bodies = Bodies(actors["x_m"] - ego["x_m"][moment], actors["y_m"] - ego["y_m"][moment], *others)
    identity = actors["actor_id"].astype(np.int64)
    row, rank = nearest(bodies, moment, identity)
    bodies, moment = bodies.take(row), moment[row]
    is_seen = np.zeros(len(row), bool)
    for first in range(0, len(ego["x_m"]), _MOMENTS_AT_ONCE):
        part = slice(*np.searchsorted(moment, (first, first + _MOMENTS_AT_ONCE)))
        is_seen[part] = in_sight(bodies.take(part), moment[part] - first, rank[part], _MOMENTS_AT_ONCE)
    bodies, moment, row = bodies.take(is_seen), moment[is_seen], row[is_seen]
    history = moment // num_moments
    number = _numbers(history, identity[row])
    order = np.lexsort((number, moment))
    bodies, moment, row, history, number = bodies.take(order), moment[order], row[order], history[order], number[order]
    found = measured(bodies, ego["yaw_rad"][moment], _variates(names, np.bincount(history, minlength=len(names))))
    return {
        "group_id": names[history],
        "offset_ticks": np.tile(np.array(HISTORY_OFFSETS, np.int32), len(names))[moment],
        "object_index": number.astype(np.int32),
        "object_class": actors["actor_class"][row],
        "x_m": found.dx_m.astype(np.float32),
        "y_m": found.dy_m.astype(np.float32),
        "yaw_rad": found.yaw_rad.astype(np.float32),
        "length_m": found.length_m.astype(np.float32),
        "width_m": found.width_m.astype(np.float32),
        "vel_x_mps": found.vel_x_mps.astype(np.float32),
        "vel_y_mps": found.vel_y_mps.astype(np.float32),
    }


def _numbers(group: Index, identity: Index) -> Index:
    """Number of each actor in its group, from 0, in the order in which they come; groups ascend ``[rows]``."""
    pairs, first, own = np.unique(np.stack([group, identity]), axis=1, return_index=True, return_inverse=True)
    order = np.lexsort((first, pairs[0]))
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order)) - np.searchsorted(pairs[0], pairs[0], side="left")[order]
    return number[own.reshape(-1)]


def _variates(group_ids: NDArray[np.object_], counts: Index) -> Array:
    """Noise of the rows of all groups, one after the other: row `i` of a group has row `i` of its stream."""
    num_words = NUM_VARIATES * WORDS_PER_NORMAL
    drawn = [
        words(_SEED, f"model/objects/{name}", count, num_words)
        for name, count in zip(group_ids.tolist(), counts.tolist(), strict=True)
    ]
    return normals(np.concatenate(drawn))
