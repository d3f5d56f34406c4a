"""Predictions of others: one Parquet file with a row for every candidate of every group of the test partition.

=====================  ==============  ============================================================
column                 type            meaning
=====================  ==============  ============================================================
``group_id``           string          branch group
``action_key``         string          candidate of the bank
``seed``               integer         seed of the training; may be left out, then it is 0
six targets            float64         by name, as ``min_separation_m``, in their units
five components        list<float64>   of the path, as ``x_m``: ten values each, from +0.25 s to +2.5 s
=====================  ==============  ============================================================

Beside the test partition, whole other partitions but training may be predicted: the guard's model needs them.

Source: this project's choice.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.benchmark.prediction.check import mismatch_text, prediction_mismatches
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES, PredictionRows
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.protocol.selection import MEAN
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.errors import DatasetError, DecodeError, UsageError
from branchdrive.formats.named_file import read_named_file
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.tables.frame import Values

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["mean_predictions", "read_predictions"]

_SCALARS = tuple(target.name for target in TARGETS)
_TEXT, _SEED = ("group_id", "action_key"), "seed"


def read_predictions(path: Path, name: str, data: BenchmarkData, protocol: BenchmarkProtocol) -> PredictionSet:
    """Predictions of the model `name` in a file.

    Raises:
        UsageError: The protocol declares a model of that name, or a test of one.
        DatasetError: The file cannot be read, lacks a column, a candidate or a number, or has rows of training groups,
            of unknown groups or several of one candidate.
    """
    if name in protocol.model_names:
        raise UsageError(f"--name: {name!r} is a model of the protocol; choose another name")
    try:
        table = decode_table(read_named_file(path, spec_limits().max_table_bytes))
        rows = PredictionRows({of: [frame] for of, frame in _frames(table, name).items()}, data)
    except (DatasetError, DecodeError) as error:
        raise DatasetError(f"{path}: {error}") from error
    for wrong in prediction_mismatches(rows, protocol):
        if wrong.location.get("model", name) == name:  # no other model has rows here
            raise DatasetError(f"{path}: {mismatch_text(wrong)}")
    return PredictionSet.of_rows(rows)


def mean_predictions(data: BenchmarkData, protocol: BenchmarkProtocol) -> PredictionSet:
    """What M0 predicts for the reported partition: the simplest baseline, which takes no training and no lock.

    One outcome for every candidate of every group, the mean over all training rows; a target over its available values.
    """
    outcomes, report = data.part(protocol.partitions.fit).outcomes, protocol.partitions.report
    counts = np.maximum(outcomes.available.sum(axis=(0, 1)), 1)
    scalars = np.where(outcomes.available, outcomes.scalars, 0.0).sum(axis=(0, 1)) / counts
    paths = outcomes.paths[outcomes.complete]
    path = paths.mean(axis=0) if len(paths) else np.zeros(outcomes.paths.shape[2:])
    shape = (len(data.part(report).groups), len(data.candidates))
    predicted = Predictions.of(
        np.broadcast_to(scalars, (*shape, *scalars.shape)), np.broadcast_to(path, (*shape, *path.shape))
    )
    return PredictionSet({MEAN: {0: {report: predicted}}})


def _frames(table: pa.Table, name: str) -> dict[str, dict[str, Values]]:
    wanted = (*_TEXT, *_SCALARS, *TRAJECTORY)
    for column in (column for column in wanted if column not in table.column_names):
        raise DatasetError(f"has no column {column!r}")
    for column in (column for column in table.column_names if column not in (*wanted, _SEED)):
        raise DatasetError(f"has an unknown column {column!r}; leave it out")
    if not table.num_rows:
        raise DatasetError("holds no row")
    keys: dict[str, Values] = {"model": np.full(table.num_rows, name, object), _SEED: _seeds(table)}
    keys |= {column: _texts(table, column) for column in _TEXT}
    scalars = {column: _numbers(table.column(column).combine_chunks(), column) for column in _SCALARS}
    paths = {column: _lists(table, column) for column in TRAJECTORY}
    repeated = {column: np.repeat(values, FUTURE_OBSERVATIONS) for column, values in keys.items()}
    step = np.tile(np.arange(1, FUTURE_OBSERVATIONS + 1, dtype=np.int32), table.num_rows)
    return dict(zip(TABLES, (keys | scalars, repeated | {"step": step} | paths), strict=True))


def _texts(table: pa.Table, column: str) -> Values:
    import pyarrow as pa

    values = table.column(column)
    _check_nulls(values, column)
    kind = values.type.value_type if pa.types.is_dictionary(values.type) else values.type
    if not pa.types.is_string(kind):
        raise DatasetError(f"column {column!r} is {values.type}, expected text")
    return np.array(values.to_pylist(), object)


def _seeds(table: pa.Table) -> Values:
    import pyarrow as pa

    if _SEED not in table.column_names:
        return np.zeros(table.num_rows, np.int64)
    values = table.column(_SEED)
    _check_nulls(values, _SEED)
    if not pa.types.is_integer(values.type):
        raise DatasetError(f"column {_SEED!r} is {values.type}, expected integers")
    seeds = np.asarray(values.to_numpy())
    for seed in seeds[(seeds < 0) | (seeds > np.iinfo(np.int64).max)][:1].tolist():
        raise DatasetError(f"column {_SEED!r} holds {seed}, expected integers from 0 to {np.iinfo(np.int64).max}")
    return seeds.astype(np.int64)


def _check_nulls(values: Any, column: str, per_row: int = 1) -> None:
    """Raises where a value is null, which is what NaN becomes when pandas writes Parquet; rows count from 0."""
    if values.null_count:
        row = values.is_null().to_pylist().index(True) // per_row
        raise DatasetError(
            f"column {column!r} has no value in row {row}, counted from 0, {values.null_count} in all; expected no "
            "nulls (pandas writes NaN as null)"
        )


def _numbers(values: Any, column: str, per_row: int = 1) -> Values:
    import pyarrow as pa

    _check_nulls(values, column, per_row)
    if not pa.types.is_floating(values.type):
        raise DatasetError(f"column {column!r} is {values.type}, expected floats")
    return np.asarray(values.to_numpy(zero_copy_only=False), np.float64)


def _lists(table: pa.Table, column: str) -> Values:
    import pyarrow as pa
    import pyarrow.compute as pc

    values = table.column(column).combine_chunks()
    if pa.types.is_fixed_size_list(values.type):
        values = values.cast(pa.list_(values.type.value_type))
    _check_nulls(values, column)
    if not pa.types.is_list(values.type):
        raise DatasetError(f"column {column!r} is {values.type}, expected lists")
    if not pc.all(pc.equal(pc.list_value_length(values), FUTURE_OBSERVATIONS)).as_py():
        raise DatasetError(f"column {column!r} holds a list of another length, expected {FUTURE_OBSERVATIONS} values")
    return _numbers(pc.list_flatten(values), column, FUTURE_OBSERVATIONS)
