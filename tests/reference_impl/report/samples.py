"""Datasets of the report's tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from tests.reference_impl.study.samples import Edit, replaced, written

__all__ = ["HOSTILE", "damaged", "every", "without", "written"]

HOSTILE = '</script><script>window.hostile=1</script><img src=x onerror="window.hostile=1">'
"""Text that would be markup if anything let it."""


def every(column: str, value: Any) -> Edit:
    """Edit that writes a value into every row of a column."""

    def edit(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(column)
        values = pa.array([value] * len(table), table.schema.field(index).type)
        return table.set_column(index, table.schema.field(index), values)

    return edit


def without(rollout_ids: set[str]) -> Edit:
    """Edit that drops attempts."""
    return lambda table: table.filter(pc.invert(pc.is_in(table["rollout_id"], pa.array(sorted(rollout_ids)))))


def damaged(root: Path) -> Path:
    """A dataset with faults of many kinds in group g0: no number, an unusable box, an attempt that lacks."""

    def broken(table: pa.Table) -> pa.Table:
        owners = np.array(table["rollout_id"].to_pylist(), dtype=object)
        index = table.schema.get_field_index("x_m")
        values = table["x_m"].to_numpy().copy()
        values[owners == "g0.brake_0.30.a1"] = np.nan
        values[(owners == "g0.brake_0.50.a1") & (np.arange(len(values)) % 2 == 0)] = 1e300
        return table.set_column(index, table.schema.field(index), pa.array(values))

    edits: Mapping[str, Edit] = {
        "observations": broken,
        "actors": every("length_m", -1.0),
        "rollouts": without({"g0.steer_left_0.05.a1"}),
        "evidence": every("separation_m", float("nan")),
        "controls": replaced("applied_steer", {"g0.accelerate_0.30.a1": float("inf")}),
    }
    return written(root, edits)
