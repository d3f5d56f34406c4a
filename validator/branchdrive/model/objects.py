"""Objects of the model layer: what sensors of the vehicle tell of others at the observations up to the branch.

They follow from the recorded actors of the nominal at ``t_b - 75 .. t_b``, so that all candidates of a group share
them and nothing later is in them. Source: spec/12-model.md#objects.
"""

from __future__ import annotations

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

__all__ = ["OBJECTS", "object_columns"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

OBJECTS = "objects"
"""Name of the table."""

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
    x_m, y_m, yaw_rad, *others = (
        take_float(actors, name, row)
        for name in ("x_m", "y_m", "yaw_rad", "length_m", "width_m", "vel_x_mps", "vel_y_mps")
    )
    ego_x_m, ego_y_m, ego_yaw_rad = (take_float(view.observations, name, ego) for name in ("x_m", "y_m", "yaw_rad"))
    bodies = Bodies(x_m - ego_x_m[moment], y_m - ego_y_m[moment], yaw_rad, *others)
    identity = actors["actor_id"][row].astype(np.int64)
    kept, rank = nearest(bodies, moment, identity)
    bodies, moment, row, identity = bodies.take(kept), moment[kept], row[kept], identity[kept]
    is_seen = np.zeros(len(row), bool)
    for first in range(0, len(ego), _MOMENTS_AT_ONCE):
        part = slice(*np.searchsorted(moment, (first, first + _MOMENTS_AT_ONCE)))
        is_seen[part] = in_sight(bodies.take(part), moment[part] - first, rank[part], _MOMENTS_AT_ONCE)
    bodies, moment, row, identity = bodies.take(is_seen), moment[is_seen], row[is_seen], identity[is_seen]
    group = moment // num_moments
    number = _numbers(group, identity)
    order = np.lexsort((number, moment))
    bodies, moment, row, group, number = bodies.take(order), moment[order], row[order], group[order], number[order]
    group_ids = view.rollouts["group_id"][nominals]
    found = measured(bodies, ego_yaw_rad[moment], _variates(group_ids, np.bincount(group, minlength=len(nominals))))
    codes, classes = actors.categories("actor_class")
    return {
        "group_id": group_ids[group],
        "offset_ticks": np.tile(np.array(HISTORY_OFFSETS, np.int32), len(nominals))[moment],
        "object_index": number.astype(np.int32),
        "object_class": np.array(classes, object)[codes[row]],
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
