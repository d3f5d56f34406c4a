"""Metamorphic steps: changes of the raw log that must not change an input of the model layer by one bit.

* ``truncation``: everything after the branch is cut off: observations after ``t_b``, controls from ``t_b`` on;
* ``future_swap``: what follows the branch moves on to the next candidate of the group;
* ``renaming``: attempts get other identities, and rows another order;
* ``replay_swap``: what precedes the branch moves on to the next intervention of the group.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" (sensor-oriented inputs, one shared history);
spec/13-leakage.md#metamorphic.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from branchdrive.contract.timing import ACTIVE_TICKS, PREDECESSOR_OFFSET
from branchdrive.model.inputs import INPUT_TABLES, inputs_of
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.frame import Values
from branchdrive.tables.view import StreamView

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_STREAMS = ("observations", "controls", "evidence")
_CONTROLS = "controls"


def changed_groups(view: ShardView, nominals: Index, candidates: Index) -> dict[str, tuple[str, ...]]:
    """Groups whose inputs a step changed, by step.

    Args:
        view: The shard.
        nominals: Nominal of each integrity-complete group ``[groups]``.
        candidates: Their chosen attempts ``[groups, policies]``, the nominal among them.
    """
    if not len(nominals):
        return dict.fromkeys(STEPS, ())
    expected = inputs_of(view, nominals)
    group_ids = view.rollouts["group_id"][nominals]
    view = _narrowed(view, candidates)
    return {
        step: tuple(sorted(group_ids[_differs(expected, change(view, nominals, candidates), len(nominals))].tolist()))
        for step, change in STEPS.items()
    }


def _differs(
    expected: Mapping[str, Mapping[str, Values]], found: Mapping[str, Mapping[str, Values]], size: int
) -> Mask:
    """Groups in which any input has other bits ``[groups]``; rows of a group are a block in both."""
    differs = np.zeros(size, bool)
    for name in INPUT_TABLES:
        for column, values in expected[name].items():
            if column == "group_id" or not len(values):
                continue
            other = found[name][column]
            same = _same_bits(np.ma.getdata(values), np.ma.getdata(other))
            same |= np.ma.getmaskarray(values)
            same &= np.ma.getmaskarray(values) == np.ma.getmaskarray(other)
            differs |= ~same.reshape(size, -1).all(axis=1)
    return differs


def _same_bits(one: NDArray[Any], other: NDArray[Any]) -> Mask:
    """Values whose bits are equal, those of NaN among them ``[rows]``; text is equal as text."""
    if one.dtype != other.dtype or one.dtype.hasobject:
        return np.asarray((one == other) & (one.dtype == other.dtype))
    bits = [np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1) for values in (one, other)]
    return np.asarray((bits[0] == bits[1]).all(axis=1))


def _narrowed(view: ShardView, candidates: Index) -> ShardView:
    """The shard without rows that are far from every branch, and without other attempts' rows."""
    member = np.zeros(view.num_rollouts + 1, bool)
    member[candidates] = True
    tables = {"rollouts": view.rollouts.arrow}
    for stream in _streams(view):
        relative = stream.tick - np.append(view.branch_tick, 0)[stream.rollout]
        near = (relative >= PREDECESSOR_OFFSET) & (relative <= ACTIVE_TICKS)
        tables[stream.name] = stream.arrow.filter(_arrow_mask(near & member[stream.rollout]))
    return ShardView(tables, view.descriptor)


def _rebuilt(view: ShardView, tables: Mapping[str, pa.Table], nominals: Index) -> dict[str, dict[str, Values]]:
    return inputs_of(ShardView({"rollouts": view.rollouts.arrow, **tables}, view.descriptor), nominals)


def _streams(view: ShardView) -> list[StreamView]:
    return [view.stream(name) for name in _STREAMS if name in view]


def _is_before(view: ShardView, stream: StreamView) -> Mask:
    """Rows of known rollouts that a history may use: up to ``t_b``, a control before it."""
    relative = stream.tick - view.branch_tick[stream.rollout]
    return np.asarray(relative < 0 if stream.name == _CONTROLS else relative <= 0)


def _with_rollouts(view: ShardView, stream: StreamView, rollout: Index) -> pa.Table:
    """The stream's rows, given to other rollouts."""
    column = pa.DictionaryArray.from_arrays(pa.array(rollout, pa.int32()), pa.array(view.rollout_ids, pa.string()))
    return _with_column(stream.arrow, column)


def _with_column(table: pa.Table, rollout_ids: pa.Array) -> pa.Table:
    return table.set_column(table.schema.get_field_index("rollout_id"), "rollout_id", rollout_ids)


def _truncated(view: ShardView, nominals: Index, _: Index) -> dict[str, dict[str, Values]]:
    tables = {stream.name: stream.arrow.filter(_arrow_mask(_is_before(view, stream))) for stream in _streams(view)}
    return _rebuilt(view, tables, nominals)


def _arrow_mask(mask: Mask) -> pa.Array:
    return pa.array(mask)


def _moved(view: ShardView, cycles: Index, nominals: Index, *, before: bool) -> dict[str, dict[str, Values]]:
    """Inputs after rows before (or from) the branch moved on along each row of `cycles`.

    Attempts that branch at another tick than their nominal stay as they are: their rows do not fit.
    """
    same = (view.branch_tick[cycles] == view.branch_tick[nominals][:, None]).all(axis=1)
    partner = np.arange(view.num_rollouts)
    partner[cycles[same]] = np.roll(cycles[same], -1, axis=1)
    tables = {}
    for stream in _streams(view):
        moves = _is_before(view, stream) == before
        tables[stream.name] = _with_rollouts(view, stream, np.where(moves, partner[stream.rollout], stream.rollout))
    return _rebuilt(view, tables, nominals)


def _future_swapped(view: ShardView, nominals: Index, candidates: Index) -> dict[str, dict[str, Values]]:
    return _moved(view, candidates, nominals, before=False)


def _replays_swapped(view: ShardView, nominals: Index, candidates: Index) -> dict[str, dict[str, Values]]:
    interventions = candidates[candidates != nominals[:, None]].reshape(len(nominals), candidates.shape[1] - 1)
    return _moved(view, interventions, nominals, before=True)


def _renamed(view: ShardView, nominals: Index, _: Index) -> dict[str, dict[str, Values]]:
    names = pa.array([hashlib.sha256(name.encode()).hexdigest() for name in view.rollout_ids], pa.string())
    tables = {}
    for stream in _streams(view):
        renamed = pa.DictionaryArray.from_arrays(pa.array(stream.rollout, pa.int32()), names)
        tables[stream.name] = _with_column(stream.arrow, renamed).take(np.arange(len(stream))[::-1])
    order = np.arange(view.num_rollouts)[::-1]
    tables["rollouts"] = _with_column(view.rollouts.arrow, names).take(order)
    return inputs_of(ShardView(tables, view.descriptor), order[nominals])


_Change = Callable[[ShardView, Index, Index], dict[str, dict[str, Values]]]

STEPS: Mapping[str, _Change] = {
    "truncation": _truncated,
    "future_swap": _future_swapped,
    "renaming": _renamed,
    "replay_swap": _replays_swapped,
}
"""Inputs after each change, by name of the step."""
