"""Datasets of the report's tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from tests.reference_impl.study.samples import Edit, replaced, written
from tests.synthetic import BRANCH_TICK

__all__ = ["HOSTILE", "damaged", "every", "without", "written"]

HOSTILE = '</script><script>window.hostile=1</script><img src=x onerror="window.hostile=1">'
"""Text that would be markup if anything let it."""


def every(column: str, value: Any) -> Edit:
    """Edit that writes a value into every row of a column."""

    def edit(table: pa.Table) -> pa.Table:
        return _with(table, column, [value] * len(table))

    return edit


def without(rollout_ids: set[str]) -> Edit:
    """Edit that drops attempts."""
    return lambda table: table.filter(pc.invert(pc.is_in(table["rollout_id"], pa.array(sorted(rollout_ids)))))


def damaged(root: Path) -> Path:
    """A dataset with faults of many kinds in group g0, and group g1 without a place.

    In g0 places are no number, attempts lack, and all boxes are unusable but those beside `accelerate_0.50`, where one
    actor has a heading in degrees 20 ticks after the branch.
    """

    def broken(table: pa.Table) -> pa.Table:
        owners = np.array(table["rollout_id"].to_pylist(), dtype=object)
        values = table["x_m"].to_numpy().copy()
        values[(owners == "g0.brake_0.30.a1") | np.char.startswith(owners.astype(str), "g1.")] = np.nan
        values[(owners == "g0.brake_0.50.a1") & (np.arange(len(values)) % 2 == 0)] = 1e300
        return _with(table, "x_m", values)

    def unusable(table: pa.Table) -> pa.Table:
        is_spared = np.array(table["rollout_id"].to_pylist(), dtype=object) == "g0.accelerate_0.50.a1"
        yaw_rad = table["yaw_rad"].to_numpy().copy()
        yaw_rad[np.flatnonzero(is_spared & (table["tick"].to_numpy() == BRANCH_TICK + 20))[0]] = 90.0
        length_m = np.where(is_spared, table["length_m"].to_numpy(), np.float32(-1.0))
        return _with(_with(table, "yaw_rad", yaw_rad), "length_m", length_m)

    edits: Mapping[str, Edit] = {
        "observations": broken,
        "actors": unusable,
        "rollouts": without({"g0.steer_left_0.05.a1"}),
        "evidence": every("separation_m", float("nan")),
        "controls": replaced("applied_steer", {"g0.accelerate_0.30.a1": float("inf")}),
    }
    return written(root, edits)


def _with(table: pa.Table, column: str, values: Any) -> pa.Table:
    index = table.schema.get_field_index(column)
    return table.set_column(index, table.schema.field(index), pa.array(values, table.schema.field(index).type))
