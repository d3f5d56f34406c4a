"""What is published: the data that a benchmark is judged on, and predictions."""

from __future__ import annotations

from branchdrive.benchmark.data import TABLES as DATA_TABLES
from branchdrive.benchmark.data import BenchmarkData
from branchdrive.benchmark.prediction_check import mismatch_text, prediction_mismatches
from branchdrive.benchmark.prediction_rows import TABLES
from branchdrive.benchmark.prediction_set import PredictionSet
from branchdrive.benchmark.protocol import BenchmarkProtocol
from branchdrive.contract.layer import table_path
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.table_file import read_table
from branchdrive.tables.arrow import from_arrow
from branchdrive_reference.benchmark.release import Release

__all__ = ["benchmark_data", "published_predictions"]


def benchmark_data(release: Release) -> BenchmarkData:
    """What the benchmark of a release is judged on.

    Raises:
        DatasetError: A table cannot be read or packed.
    """
    frames = {name: from_arrow(read_table(release.root, table_path(name), name), name) for name in DATA_TABLES}
    return BenchmarkData.of(frames, release.layer.descriptor.action_bank)


def published_predictions(release: Release, protocol: BenchmarkProtocol, data: BenchmarkData) -> PredictionSet:
    """Predictions of the published benchmark layer.

    Raises:
        UsageError: None is published.
        DatasetError: They cannot be read, or are not those that the protocol asks for.
    """
    if not release.has_benchmark:
        raise UsageError(f"{release.root}: has no predictions; run `branchdrive predict` first")
    frames = {name: from_arrow(read_table(release.root, table_path(name), name), name) for name in TABLES}
    for wrong in prediction_mismatches(frames, data, protocol):
        raise DatasetError(f"{release.root}: {mismatch_text(wrong)}; run `branchdrive predict` again")
    return PredictionSet.from_frames(frames, data)
