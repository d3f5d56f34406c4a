"""What a build does with the rows of one part: tasks of workers, which write tables and give back small results.

Source: paper, "Release Structure"; spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.canonical.record import source_counts
from branchdrive.contract.layer import LAYERS
from branchdrive.model.arrays import pack_arrays, pack_history
from branchdrive.model.normalisation_document import fitted_arrays
from branchdrive.model.rows import context_rows
from branchdrive.quality.fidelity import (
    CRITERIA,
    Largest,
    largest_of,
    passing_counts,
    thresholds_of,
    with_passes,
    with_validity,
)
from branchdrive.quality.filtering import FilterFigures, shares_above
from branchdrive.quality.partition import assignment_of
from branchdrive.release.built_layers import StoredFile, TableStore
from branchdrive.release.scan import RawPart
from branchdrive.statistics.split import TRAINING
from branchdrive.tables.frame import Frame, of_groups, with_homes

__all__ = [
    "CanonicalTask", "FilesAndCounts", "FittedTask", "HistoriesTask", "JudgedPart", "JudgedTask", "ModelTask",
    "canonical_part", "fitted_part", "histories_part", "judged_part", "model_part",
]  # fmt: skip


@dataclass(frozen=True)
class CanonicalTask:
    """The tables of the canonical layer, of one part.

    Attributes:
        part: The part.
        store: Where tables are written.
    """

    part: RawPart
    store: TableStore


@dataclass(frozen=True)
class FilesAndCounts:
    """Files of tables of one part by path, and counts of their rows."""

    files: dict[str, StoredFile]
    counts: dict[str, Any] = field(default_factory=dict)


def canonical_part(task: CanonicalTask) -> FilesAndCounts:
    """Write the canonical layer of a part; the counts are those of `source_counts`."""
    tables = {name: task.part.rows[name] for name in LAYERS["canonical"].tables}
    files = _written(task.store, tables, task.part.number)
    return FilesAndCounts(files, source_counts(tables["records"], tables["attempts"]))


def _written(store: TableStore, tables: Mapping[str, Frame], part: int) -> dict[str, StoredFile]:
    return {path: file for name, rows in tables.items() for path, file in store.put(name, rows, part).items()}


@dataclass(frozen=True)
class FittedTask:
    """What thresholds are fitted on, of one part.

    Attributes:
        part: The part.
        groups: Eligible training groups of it, sorted.
    """

    part: RawPart
    groups: list[str]


def fitted_part(task: FittedTask) -> Largest:
    """Largest discrepancies of groups."""
    return largest_of(task.part.rows["pairs"], task.groups)


@dataclass(frozen=True)
class JudgedTask:
    """Pairs to judge by thresholds, of one part.

    Attributes:
        part: The part.
        store: Where tables are written.
        groups: Rows of `group_quality` of the part, with partitions.
        fitted_on: Eligible training groups of it, sorted.
        thresholds: Document ``thresholds.json``.
    """

    part: RawPart
    store: TableStore
    groups: Frame
    fitted_on: list[str]
    thresholds: Mapping[str, Any]


@dataclass(frozen=True)
class JudgedPart:
    """What became of the pairs of one part.

    Attributes:
        files: Files of `attempt_quality` and `pairs`, by path.
        valid: Whether each group passes each criterion, rows as in the task ``[groups, criteria]``.
        counts: Values of `passing_counts` of the groups that have a partition, in the order of the rows.
        figures: What the groups add to ``filtering.json``.
    """

    files: dict[str, StoredFile]
    valid: NDArray[np.bool_]
    counts: NDArray[np.int64]
    figures: FilterFigures


def judged_part(task: JudgedTask) -> JudgedPart:
    """Judge the pairs of a part, and write them and the quality of its attempts.

    Shares of frames above the floor, of the groups that thresholds are fitted on, go into the spool, for `whole_task`.
    """
    rows = task.part.rows
    pairs = with_passes(rows["pairs"], thresholds_of(task.thresholds))
    valid = with_validity(task.groups, pairs)
    every = [*assignment_of(task.groups)]
    above = shares_above(pairs, rows["replay_frames"], task.fitted_on)
    task.part.put_array("training.above", above)
    figures = FilterFigures.of(pairs, rows["replay_frames"], above, task.fitted_on, sorted(every), task.thresholds)
    return JudgedPart(
        _written(task.store, {"attempt_quality": rows["attempt_quality"], "pairs": pairs}, task.part.number),
        np.stack([valid[f"{criterion}_valid"] for criterion in CRITERIA], axis=1),
        passing_counts(pairs, every).values,
        figures,
    )


@dataclass(frozen=True)
class HistoriesTask:
    """Histories to compare with those of other parts.

    Attributes:
        part: The part.
        groups: Groups of it, sorted.
    """

    part: RawPart
    groups: list[str]


def histories_part(task: HistoriesTask) -> None:
    """Put the state and control histories of groups as arrays into the spool, for `whole_task`."""
    for table in ("state", "past_controls"):
        packed = pack_history([of_groups(task.part.rows[table], task.groups)], table, task.groups)
        task.part.put_array(f"valid.{table}", packed)


@dataclass(frozen=True)
class ModelTask:
    """The tables of the model layer, of one part.

    Attributes:
        part: The part.
        store: Where tables are written.
        groups: Rows of `group_quality` of the part, complete.
        records: File with the records of the part.
        actions: Rows of the table `actions`.
        tables: Names of the tables that the layer gets.
    """

    part: RawPart
    store: TableStore
    groups: Frame
    records: StoredFile
    actions: Frame
    tables: tuple[str, ...]


def model_part(task: ModelTask) -> FilesAndCounts:
    """Write the model layer of a part, and put what scalings are fitted on into the spool, for `whole_task`."""
    rows = task.part.rows
    contexts = context_rows(task.groups, task.records.rows("records"))
    groups, partitions = contexts["group_id"].tolist(), contexts["partition"].tolist()
    homes = dict(zip(groups, partitions, strict=True))
    others = [name for name in task.tables if name not in ("contexts", "actions")]
    tables = {"contexts": contexts, **{name: with_homes(rows[name], homes) for name in others}}
    files = _written(task.store, tables, task.part.number)
    if groups:
        packed = pack_arrays({**tables, "actions": task.actions}, groups, task.store.keys)
        in_training = np.array([partition == TRAINING for partition in partitions])
        for name, values in fitted_arrays(packed).items():
            task.part.put_array(f"training.{name}", values[in_training])
    return FilesAndCounts(files)
