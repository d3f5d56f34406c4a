"""Replays against their nominals: discrepancies before the branch, and whether whole records are equal bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.view import ShardView, StreamView
from branchdrive.contract.columns import TABLES
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OFFSETS
from branchdrive.derive.discrepancy import (
    EXTENDED,
    NO_LIGHT,
    History,
    HistoryEvidence,
    core_discrepancy,
    extended_discrepancy,
)
from branchdrive_reference.study.window import window_rows

__all__ = ["COMPARED_TABLES", "discrepancies", "equal_records"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

COMPARED_TABLES = ("controls", "observations", "actors", "evidence")
"""Tables in which a nominal replay and its nominal are compared."""


def _history(view: ShardView, rollouts: Index) -> History:
    observed = window_rows(view, view.observations, rollouts, HISTORY_OFFSETS)
    driven = window_rows(view, view.controls, rollouts, range(-CONTROL_HISTORY_TICKS, 0))
    columns = [view.observations[name][observed] for name in ("x_m", "y_m", "yaw_rad", "speed_mps")]
    columns += [view.controls[f"applied_{name}"][driven] for name in ("steer", "throttle", "brake")]
    columns.append(view.branch_tick[rollouts])
    return History(*columns)


def _history_evidence(view: ShardView, rollouts: Index) -> HistoryEvidence:
    evidence = view.stream("evidence")
    rows = window_rows(view, evidence, rollouts, HISTORY_OFFSETS)
    light, _ = evidence.words("traffic_light")
    return HistoryEvidence(
        evidence["nearest_vehicle_available"][rows],
        evidence["nearest_vehicle_gap_m"][rows],
        evidence["nearest_vehicle_rel_speed_mps"][rows],
        evidence["num_actors"][rows],
        np.where(evidence["traffic_light_available"][rows], light[rows], NO_LIGHT),
        evidence["nearest_pedestrian_available"][rows],
        evidence["nearest_pedestrian_gap_m"][rows],
    )


def discrepancies(view: ShardView, replays: Index, nominals: Index) -> NDArray[np.float64]:
    """Core and extended variables of paired rollouts with whole windows, ``[pairs, 7 + 5]``.

    The extended ones are NaN where no evidence is claimed.
    """
    core = core_discrepancy(_history(view, replays), _history(view, nominals))
    if "evidence" in view:
        extended = extended_discrepancy(_history_evidence(view, replays), _history_evidence(view, nominals))
    else:
        extended = np.full((len(replays), len(EXTENDED)), np.nan)
    return np.concatenate([core, extended], axis=1)


def equal_records(view: ShardView, replays: Index, nominals: Index) -> dict[str, Mask]:
    """For every compared table of the shard: pairs ``[pairs]`` whose rows hold the same bits, rollout ids apart.

    Order of rows carries no meaning. Numbers are equal where their bits are: 0 and -0 are not, NaN and NaN are.
    """
    return {table: _equal_rows(view.stream(table), replays, nominals) for table in COMPARED_TABLES if table in view}


def _equal_rows(stream: StreamView, replays: Index, nominals: Index) -> Mask:
    lengths, wanted = (stream.stop[side] - stream.start[side] for side in (replays, nominals))
    equal = np.asarray(lengths == wanted)
    pair = np.repeat(np.arange(len(replays)), np.where(equal, lengths, 0))
    sides = [_rows(stream, side[equal], lengths[equal], pair) for side in (replays, nominals)]
    for column in TABLES[stream.name].columns:
        if column.name == "rollout_id":
            continue
        a, b = (_bits(stream, column.name, rows) for rows in sides)
        equal[pair[(a != b).any(axis=1)]] = False
    return equal


def _rows(stream: StreamView, rollouts: Index, lengths: Index, pair: Index) -> Index:
    """Rows of `rollouts` one after the other, each sorted by tick and, if the table has them, by actor."""
    offset = np.arange(len(pair)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    rows = np.repeat(stream.start[rollouts], lengths) + offset
    if "actor_id" in stream:
        rows = rows[np.lexsort((stream["actor_id"][rows], stream.tick[rows], pair))]
    return np.asarray(rows)


def _bits(stream: StreamView, column: str, rows: Index) -> NDArray[np.uint8]:
    """Bytes of a column's values at `rows`, and whether they are null: ``[rows, bytes]``."""
    if TABLES[stream.name][column].type == "string":
        values: NDArray[Any] = stream.words(column)[0][rows]
    else:
        values = stream[column][rows]
    valid = stream.valid(column)[rows]
    raw = np.ascontiguousarray(values).view(np.uint8).reshape(len(rows), values.dtype.itemsize)
    return np.concatenate([raw, valid[:, None].astype(np.uint8)], axis=1)
