"""Datasets of the study's tests: the valid synthetic one, and copies of it with something changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from tests import synthetic

from branchdrive_reference.study.study import Study
from branchdrive_reference.study.survey import study_dataset

FIRST = "raw/shard-00000"
"""The shard of groups g0 and g1."""

Edit = Callable[[pa.Table], pa.Table]


def unseen(done: int, total: int, note: str = "") -> None:
    """Progress that nobody watches."""


def written(root: Path, edits: Mapping[str, Edit] | None = None, document: Mapping[str, Any] | None = None) -> Path:
    """The synthetic dataset at `root`, tables of its first shard edited by name."""
    document = synthetic.descriptor() if document is None else document
    has_evidence = "actor_risk_evidence" in document["streams"]
    tables = {
        name: dict(shard)
        for name, shard in (synthetic.base_tables() if has_evidence else synthetic.bare_tables()).items()
    }
    for table, edit in (edits or {}).items():
        tables[FIRST][table] = edit(tables[FIRST][table])
    synthetic.write_dataset(root, tables, document)
    return root


def studied(root: Path, edits: Mapping[str, Edit] | None = None, document: Mapping[str, Any] | None = None) -> Study:
    """Study of the dataset that `written` writes."""
    return study_dataset(written(root, edits, document), unseen)


def replaced(column: str, values: Mapping[str, Any], rows: Callable[[pa.Table], Any] | None = None) -> Edit:
    """Edit that writes a value into `column` in all rows of rollouts, or in those that `rows` marks among them.

    Args:
        column: Column to write.
        values: New value by rollout id; ``None`` is null.
        rows: Marks rows ``[rows]`` of a table.
    """

    def edit(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(column)
        old, owners = table[column].to_pylist(), table["rollout_id"].to_pylist()
        marked = np.ones(len(owners), bool) if rows is None else np.asarray(rows(table))
        new = [values[o] if m and o in values else v for v, o, m in zip(old, owners, marked, strict=True)]
        return table.set_column(index, table.schema.field(index), pa.array(new, table.schema.field(index).type))

    return edit


def dropped(marks: Callable[[pa.Table], Any]) -> Edit:
    """Edit that drops the rows that `marks` marks."""
    return lambda table: table.filter(pa.array(~np.asarray(marks(table), bool)))


def rows_at(rollout_id: str, *ticks: int) -> Callable[[pa.Table], Any]:
    """Marks of a rollout's rows at some ticks, all of them by default."""

    def marks(table: pa.Table) -> Any:
        own = pc.equal(table["rollout_id"], rollout_id).to_numpy(zero_copy_only=False)
        return own & np.isin(table["tick"].to_numpy(), ticks) if ticks else own

    return marks
