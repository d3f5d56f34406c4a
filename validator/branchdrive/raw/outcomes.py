"""What became of the candidates of a branch group: results of their drives, and the targets of the window.

Source: paper, "Model Inputs and Targets"; spec/12-model.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.driving.target import TARGETS, Motion, Risk, scalar_targets
from branchdrive.raw.rollout import ROLLOUTS, Rollout

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["RESULTS", "outcomes"]

RESULTS = tuple(column.name for column in TABLES[ROLLOUTS].columns if column.name.startswith("result_"))
"""Columns that say how the whole drive went."""


def outcomes(candidates: Sequence[Rollout]) -> pa.Table:
    """One row for each attempt: its policy, its status, how its drive went, and the six scalar targets of its window.

    A target is null where it is not available, as in the model layer.
    """
    import pyarrow as pa

    schema = table_schema(ROLLOUTS)
    columns: dict[str, Any] = {
        name: pa.array([candidate.record[name] for candidate in candidates], schema.field(name).type)
        for name in ("rollout_id", "action_key", "status", *RESULTS)
    }
    motion = Motion(*(_window(candidates, "observations", name, (0, *FUTURE_OFFSETS)) for name in Motion._fields))
    evidence = {name: _window(candidates, "evidence", name, FUTURE_OFFSETS) for name in Risk._fields}
    known = {name: evidence[name] == 1 for name in ("separation_available", "ttc_available")}
    with np.errstate(all="ignore"):
        found = scalar_targets(motion, Risk(**{**evidence, **known}))
    for place, target in enumerate(TARGETS):
        columns[target.name] = pa.array(found.values[:, place], mask=~found.available[:, place])
    return pa.table(columns)


def _window(candidates: Sequence[Rollout], table: str, column: str, offsets: Sequence[int]) -> NDArray[np.float64]:
    """A column at ticks relative to the branch ``[candidates, offsets]``, NaN where there is no row of one."""
    found = np.full((len(candidates), len(offsets)), np.nan)
    for place, candidate in enumerate(candidates):
        if candidate.branch_tick is None or table not in candidate.tables:
            continue
        ticks, wanted = candidate.column(table, "tick"), np.asarray(offsets) + candidate.branch_tick
        first, after = (np.searchsorted(ticks, wanted, side=side) for side in ("left", "right"))
        is_there = after - first == 1
        values = candidate.column(table, column).astype(np.float64)
        found[place, is_there] = np.ma.filled(values, np.nan)[first[is_there]]
    return found
