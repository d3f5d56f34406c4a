"""Predictions of the locked checkpoints, published together with their lock before any outcome is compared."""

from __future__ import annotations

from typing import Any

from branchdrive.cli.progress import Update
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.layer import table_path
from branchdrive.dataset.frame import from_arrow, to_arrow
from branchdrive.dataset.parquet import encode_table
from branchdrive.dataset.table_file import read_table
from branchdrive.derive.benchmark.data import TABLES as DATA_TABLES
from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.prediction_set import TABLES, PredictionSet, prediction_problems
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol
from branchdrive.derive.layer.frame import sort_rows
from branchdrive.derive.metric.outcome import Predictions
from branchdrive.errors import DatasetError, UsageError
from branchdrive_reference.benchmark.locking import changed_checkpoints, read_lock
from branchdrive_reference.benchmark.release import LAYER, Release
from branchdrive_reference.benchmark.workspace import LOCK, OPENINGS, PROTOCOL, Workspace
from branchdrive_reference.learning.prediction import predict

__all__ = ["benchmark_data", "predict_all", "published_predictions"]


def benchmark_data(release: Release) -> BenchmarkData:
    """What the benchmark of a release is judged on.

    Raises:
        DatasetError: A table cannot be read or packed.
    """
    frames = {name: from_arrow(read_table(release.root, table_path(name), name), name) for name in DATA_TABLES}
    return BenchmarkData.of(frames, release.layer.descriptor.action_bank)


def predict_all(workspace: Workspace, protocol: BenchmarkProtocol, *, device: str, show: Update) -> PredictionSet:
    """Predict with every locked checkpoint, and publish the benchmark layer without results.

    Raises:
        UsageError: Nothing is locked, or a checkpoint is missing or not the one that was locked.
        DatasetError: The release or a checkpoint cannot be read.
    """
    release, lock = workspace.release, read_lock(workspace, protocol)
    for file in changed_checkpoints(workspace, lock):
        raise UsageError(
            f"{release.root}: {file!r} is not the checkpoint that was locked; run `branchdrive lock` again"
        )
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
    files = {path: _there(workspace, path) for path in (PROTOCOL, LOCK)}
    files[OPENINGS] = workspace.read(OPENINGS) or dump_json({"entries": []})
    for name, frame in predictions.to_frames(data).items():
        rows = sort_rows(frame, LAYER_TABLES[name].key, {"action_key": data.candidates})
        files[table_path(name)] = encode_table(to_arrow(name, rows))
    for entry in lock["checkpoints"]:
        files[f"{LAYER}/{entry['file']}"] = (workspace.area / entry["file"]).read_bytes()
    before = workspace.release.benchmark_files()
    if all(before.get(path) == content for path, content in files.items()):
        return  # results that follow from the same predictions stay
    workspace.publish(files)


def _there(workspace: Workspace, path: str) -> bytes:
    content = workspace.read(path)
    if content is None:
        raise DatasetError(f"{workspace.release.root}: {path!r} is gone; run `branchdrive lock` again")
    return content


def published_predictions(release: Release, protocol: BenchmarkProtocol, data: BenchmarkData) -> PredictionSet:
    """Predictions of the published benchmark layer.

    Raises:
        UsageError: None is published.
        DatasetError: They cannot be read, or are not those that the protocol asks for.
    """
    if not release.has_benchmark:
        raise UsageError(f"{release.root}: has no predictions; run `branchdrive predict` first")
    frames = {name: from_arrow(read_table(release.root, table_path(name), name), name) for name in TABLES}
    for problem in prediction_problems(frames, data, protocol):
        raise DatasetError(f"{release.root}: {problem}; run `branchdrive predict` again")
    return PredictionSet.from_frames(frames, data)
