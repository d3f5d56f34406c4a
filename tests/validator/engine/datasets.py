"""Datasets on disk for tests of the engine and its edges: the valid one, and small departures from it."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from tests import synthetic

from branchdrive.engine.report import Report
from branchdrive.testing.defect import with_cells, with_column

Tables = dict[str, dict[str, pa.Table]]

FOLDER, OTHER_FOLDER = "raw/shard-00000", "raw/shard-00001"


def write(
    root: Path, tables: Tables | None = None, document: Mapping[str, Any] | None = None, *, seal: bool = True
) -> Path:
    """Write a dataset, the valid one by default."""
    synthetic.write_dataset(
        root,
        synthetic.base_tables() if tables is None else tables,
        synthetic.descriptor() if document is None else document,
        seal=seal,
    )
    return root


def write_with(root: Path, content: Mapping[str, bytes]) -> Path:
    """Write the valid dataset with some files replaced or added, and a manifest that agrees with them."""
    write(root, seal=False)
    for path, data in content.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(data)
    synthetic.seal_dataset(root)
    return root


def parquet_bytes(table: pa.Table, **options: Any) -> bytes:
    """A table as Parquet, written with other options than the writer's."""
    sink = io.BytesIO()
    pq.write_table(table, sink, **options)
    return sink.getvalue()


def edited(name: str, edit: Callable[[pa.Table], pa.Table], folder: str = FOLDER) -> Tables:
    """The valid tables with one table changed."""
    tables = {folder: dict(shard) for folder, shard in synthetic.base_tables().items()}
    tables[folder][name] = edit(tables[folder][name])
    return tables


def cells(name: str, column: str, values: Mapping[int, Any]) -> Tables:
    """The valid tables with some cells replaced."""
    return edited(name, lambda table: with_cells(table, column, values))


def row_of(name: str, rollout_id: str, number: int) -> int:
    """Row of an attempt in a table of the first shard, by its number among the attempt's."""
    return int(synthetic.base_tables()[FOLDER][name]["rollout_id"].to_pylist().index(rollout_id)) + number


@dataclass(frozen=True)
class Departure:
    """The valid dataset with one thing changed, and what the validator must say."""

    tables: Callable[[], Tables]
    verdict: str
    rules: frozenset[str]
    qualified: int


def _status(table: pa.Table) -> pa.Table:
    return with_cells(with_cells(table, "status", {2: "partial"}), "status_reason", {2: "out of fuel"})


DEPARTURES = {
    "none": Departure(synthetic.base_tables, "valid", frozenset(), 3),
    "speed out of range": Departure(
        lambda: cells("observations", "speed_mps", {row_of("observations", "g0.nominal.a1", 3): 1000.0}),
        "invalid", frozenset({"BD-VAL-002"}), 2,
    ),
    "rows of nobody": Departure(
        lambda: edited("controls", lambda t: pa.concat_tables([t, with_column(t[:9], "rollout_id", ["nobody"] * 9)])),
        "invalid", frozenset({"BD-KEY-004"}), 3,
    ),
    "a row twice": Departure(
        lambda: edited("controls", lambda t: pa.concat_tables([t[:51], t[50:]])),
        "invalid", frozenset({"BD-KEY-007"}), 2,
    ),
    "another command applied": Departure(
        lambda: cells("controls", "applied_brake", {30: 0.75}), "valid", frozenset({"BD-CTL-009"}), 2
    ),
    "an attempt that ended early": Departure(
        lambda: edited("rollouts", _status), "valid", frozenset({"BD-STA-001", "BD-BNK-001"}), 2
    ),
    "another seed": Departure(lambda: cells("rollouts", "seed", {4: 99}), "valid", frozenset({"BD-GRP-003"}), 2),
    "another separation": Departure(
        lambda: cells("evidence", "separation_m", {12: 1.25}), "valid", frozenset({"BD-EVD-001"}), 2
    ),
}  # fmt: skip
"""Departures by name; every one of them in the first shard, in its first group."""


def failing(report: Report) -> frozenset[str]:
    """Rules with findings."""
    return frozenset(tally.rule_id for tally in report.tallies if tally.num_findings)


def status(report: Report, rule_id: str) -> str:
    """Status of one rule."""
    return next(tally.status for tally in report.tallies if tally.rule_id == rule_id)


def outcome(report: Report) -> dict[str, Any]:
    """What must not depend on how a dataset is stored or how many workers read it."""
    return {
        "verdict": report.verdict,
        "errors": report.errors,
        "rules": {
            tally.rule_id: (tally.status, tally.num_findings)
            for tally in report.tallies
            if tally.rule_id != "BD-TAB-007"  # it recommends an order, which no other rule may see
        },
        "funnel": report.funnel.to_json() if report.funnel else None,
        "groups": report.dataset.num_groups,
        "rollouts": report.dataset.num_rollouts,
        "rows": report.dataset.rows,
    }
