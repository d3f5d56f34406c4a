"""Predictions of the locked checkpoints, published together with their lock before any outcome is compared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.cli.progress import Update
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.layer import table_path
from branchdrive.contract.layout import BENCHMARK, BENCHMARK_LEDGER_FILE, LOCK_FILE, PROTOCOL_FILE
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import part_numbers
from branchdrive.tables.arrow import to_arrow
from branchdrive.tables.frame import sort_rows
from branchdrive_reference.benchmark.lock import changed_checkpoints_of, read_lock
from branchdrive_reference.benchmark.release import Release, benchmark_data
from branchdrive_reference.benchmark.workspace import Workspace
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint
from branchdrive_reference.learning.prediction import predict

__all__ = ["locked_checkpoints", "predict_all"]


def predict_all(workspace: Workspace, protocol: BenchmarkProtocol, *, device: str, show: Update) -> PredictionSet:
    """Predict with every locked checkpoint, and publish the benchmark layer without results.

    Raises:
        UsageError: Nothing is locked, or a checkpoint is missing or not the one that was locked.
        DatasetError: The release or a checkpoint cannot be read.
    """
    release, lock = workspace.release, read_lock(workspace, protocol)
    for file in changed_checkpoints_of(workspace, lock):
        raise UsageError(f"{release}: {file!r} is not the checkpoint that was locked; run `branchdrive lock` again")
    data = benchmark_data(release)
    partitions = [name for name in protocol.predicted if name in data.parts]
    found: dict[str, dict[int, dict[str, Predictions]]] = {}
    for done, entry in enumerate(lock["checkpoints"]):
        show(done, len(lock["checkpoints"]), f"{entry['model']} seed {entry['seed']}")
        parts = found.setdefault(entry["model"], {}).setdefault(entry["seed"], {})
        for partition in partitions:
            (one,) = predict([workspace.area / entry["file"]], release.layer, partition, device=device)
            parts[partition] = Predictions.of(one.scalars, one.trajectories)
    show(len(lock["checkpoints"]), len(lock["checkpoints"]))
    predictions = PredictionSet(found)
    _publish(workspace, lock, predictions, data)
    return predictions


def _publish(workspace: Workspace, lock: dict[str, Any], predictions: PredictionSet, data: BenchmarkData) -> None:
    files = {path: _there(workspace, path) for path in (PROTOCOL_FILE, LOCK_FILE)}
    files[BENCHMARK_LEDGER_FILE] = workspace.read(BENCHMARK_LEDGER_FILE) or dump_json({"entries": []})
    files |= _tables(predictions, data, workspace.release.parts)
    for entry in lock["checkpoints"]:
        files[f"{BENCHMARK}/{entry['file']}"] = (workspace.area / entry["file"]).read_bytes()
    before = workspace.release.benchmark_files()
    if all(before.get(path) == content for path, content in files.items()):
        return  # results that follow from the same predictions stay
    workspace.publish(files)


def _tables(predictions: PredictionSet, data: BenchmarkData, parts: Mapping[str, int]) -> dict[str, bytes]:
    """Files of predictions by path, whose rows are made part by part, and in a part model by model."""
    predicted = {name for by_seed in predictions.by_model.values() for said in by_seed.values() for name in said}
    groups = [group for partition in predicted for group in data.part(partition).groups]
    files, numbers = {}, part_numbers(groups, parts)
    for number in np.unique(numbers).tolist():
        own = {group for group, of_group in zip(groups, numbers.tolist(), strict=True) if of_group == number}
        for name in TABLES:
            key, orders = LAYER_TABLES[name].key, {"action_key": data.candidates}
            rows = [to_arrow(name, sort_rows(frame, key, orders)) for frame in predictions.frames(name, data, own)]
            files[table_path(name, part=number)] = encode_table(pa.concat_tables(rows))
    return files


def _there(workspace: Workspace, path: str) -> bytes:
    content = workspace.read(path)
    if content is None:
        raise DatasetError(f"{workspace.release}: {path!r} is gone; run `branchdrive lock` again")
    return content


def locked_checkpoints(release: Release, lock: Mapping[str, Any], model: str) -> list[Checkpoint]:
    """The published checkpoints of a model, one for each seed in the order of the lock.

    Raises:
        DatasetError: One cannot be read, or is not the one that was locked.
    """
    return [
        read_checkpoint(f"{BENCHMARK}/{entry['file']}", sha256=entry["sha256"], store=release.layer.folder)
        for entry in lock["checkpoints"]
        if entry["model"] == model
    ]
