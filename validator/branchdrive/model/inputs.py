"""Inputs of the model layer: what the nominal rollout of each group recorded before its branch.

Everything here is read at exact ticks ``<= t_b`` (observations) and ``< t_b`` (controls).
Source: paper, "Model Inputs and Targets"; spec/12-model.md#histories.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES, Column
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import CONTROL_WINDOW, STATE_WINDOW, control_history, state_history
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows
from branchdrive.tables.frame import Values

__all__ = ["INPUT_TABLES", "empty_columns", "inputs_of"]

Index = NDArray[np.int64]

INPUT_TABLES = ("state", "past_controls", "expert", "surroundings")
"""Tables of histories, in the order of their tracks."""


def inputs_of(view: ShardView, nominals: Index) -> dict[str, dict[str, Values]]:
    """Frames of `INPUT_TABLES` for nominal rollouts with whole windows, one block of rows for each."""
    found = {"state": _state(view, nominals), "past_controls": _controls(view, nominals)}
    for name, table in (("expert", "observations"), ("surroundings", "evidence")):
        there = nominals if table in view else nominals[:0]
        found[name] = _copied(view, name, table, there)
    return found


def _keys(view: ShardView, nominals: Index, offsets: tuple[int, ...]) -> dict[str, Values]:
    return {
        "group_id": np.repeat(view.rollouts["group_id"][nominals], len(offsets)),
        "offset_ticks": np.tile(np.array(offsets, np.int32), len(nominals)),
    }


def _window(
    view: ShardView, table: str, columns: tuple[str, ...], nominals: Index, offsets: tuple[int, ...]
) -> tuple[dict[str, NDArray[Any]], NDArray[Any]]:
    stream = view.stream(table)
    rows = window_rows(view, stream, nominals, offsets)
    return {column: stream[column][rows] for column in columns}, stream.tick[rows]


def _state(view: ShardView, nominals: Index) -> dict[str, Values]:
    profile = SENSOR_PROFILE.without(view.descriptor.unrecorded)
    columns, tick = _window(view, "observations", profile.state_columns, nominals, STATE_WINDOW)
    history = state_history(profile, columns, tick=tick, branch_tick=view.branch_tick[nominals])
    values = history.values.reshape(-1, history.values.shape[2])
    recorded: dict[str, NDArray[Any]] = dict(zip((feature.name for feature in profile.state), values.T, strict=True))
    absent = np.full(len(values), np.nan)
    frame = _keys(view, nominals, HISTORY_OFFSETS)
    for column in LAYER_TABLES["state"].value_columns:
        cells = recorded.get(column.name, absent)
        frame[column.name] = np.ma.masked_array(cells, cells is absent) if column.nullable else cells
    return frame


def _controls(view: ShardView, nominals: Index) -> dict[str, Values]:
    columns, tick = _window(view, "controls", SENSOR_PROFILE.control_columns, nominals, CONTROL_WINDOW)
    history = control_history(SENSOR_PROFILE, columns, tick=tick, branch_tick=view.branch_tick[nominals])
    values = history.values.reshape(-1, history.values.shape[2]).astype(np.float32)
    names = [feature.name for feature in SENSOR_PROFILE.controls]
    return {**_keys(view, nominals, CONTROL_WINDOW), **dict(zip(names, values.T, strict=True))}


def empty_columns(declared: Sequence[Column]) -> dict[str, Values]:
    """Declared columns without a row."""
    kinds = {
        "string": object, "bool": bool, "int32": np.int32, "int64": np.int64, "float32": np.float32,
        "float64": np.float64,
    }  # fmt: skip
    empty: dict[str, Values] = {}
    for column in declared:
        values = np.zeros(0, kinds[column.type])
        empty[column.name] = np.ma.masked_array(values) if column.nullable else values
    return empty


def _copied(view: ShardView, name: str, table: str, nominals: Index) -> dict[str, Values]:
    """Columns of the table `name` that are the columns of `table` at the 16 observations."""
    keys = _keys(view, nominals, HISTORY_OFFSETS)
    declared = LAYER_TABLES[name].value_columns
    if not len(nominals):
        return {**keys, **empty_columns(declared)}
    stream = view.stream(table)
    rows = window_rows(view, stream, nominals, HISTORY_OFFSETS).ravel()
    frame: dict[str, Values] = dict(keys)
    for column in declared:
        values = stream[column.name][rows]
        if column.type == "float64":
            values = values.astype(np.float64)
        frame[column.name] = np.ma.masked_array(values, ~stream.valid(column.name)[rows]) if column.nullable else values
    return frame
