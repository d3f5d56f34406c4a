"""The release that a benchmark is about: its files under their digests, its data, and the predictions published there.

Only files of derived layers are read, so a detached release serves as well as one in place. They are compared with
the manifest first: a lock names digests, and they are to be those of the files that were used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from branchdrive.benchmark.prediction.check import mismatch_text, prediction_mismatches
from branchdrive.benchmark.prediction.data import ENDINGS, BenchmarkData
from branchdrive.benchmark.prediction.data import TABLES as DATA_TABLES
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES, PredictionRows
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.ranking.context import Contexts, contexts_of
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS, table_file, table_paths
from branchdrive.contract.layout import BENCHMARK, MANIFEST_FILE, RAW_DIR, layer_of
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.manifest import Manifest, read_manifest
from branchdrive.formats.place import Place
from branchdrive.formats.table_file import absent_table, layer_table_paths, read_layer_table, read_table
from branchdrive.model.objects import OBJECTS
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.quality.partition import assignment_of, clusters_of, partition_sizes
from branchdrive.tables.arrow import from_arrow
from branchdrive.tables.frame import Frame, Values
from branchdrive.tables.stored import layer_frames

__all__ = [
    "Release", "baseline_contexts", "benchmark_data", "need_objects", "open_release", "published_predictions",
]  # fmt: skip

_READ = ("quality", "model", BENCHMARK)
_REMEDY = "restore it, or run `branchdrive build` to make the derived layers again"


@dataclass(frozen=True)
class Release:
    """A release with a model layer, as its manifest has it.

    Attributes:
        layer: Its model layer.
        manifest: Its manifest, which its derived layers agree with.
    """

    layer: ModelLayer
    manifest: Manifest

    @property
    def root(self) -> Path:
        """Its folder.

        Raises:
            UsageError: It is in no folder.
        """
        return self.layer.root

    def __str__(self) -> str:
        return str(self.layer.folder)

    @property
    def has_raw(self) -> bool:
        """Whether the raw layer lies beside the derived ones."""
        return RAW_DIR in self.layer.descriptor.layers

    @property
    def has_benchmark(self) -> bool:
        """Whether a benchmark layer is published."""
        return BENCHMARK in self.layer.descriptor.layers

    @cached_property
    def clusters(self) -> dict[str, int]:
        """Route cluster of every group of the model layer."""
        return clusters_of(self._contexts)

    @cached_property
    def sizes(self) -> dict[str, dict[str, int]]:
        """Groups and route clusters of every partition of the model layer that has a group."""
        return partition_sizes(assignment_of(self._contexts), self.clusters)

    @cached_property
    def _contexts(self) -> Frame:
        return from_arrow(read_layer_table(self.layer.folder, "contexts"), "contexts")

    @cached_property
    def parts(self) -> dict[str, int]:
        """Number of the part with the rows of every group of the model layer."""
        folder = self.layer.folder
        return {
            group_id: file.part
            for path in layer_table_paths(folder, "contexts")
            if (file := table_file(path)) is not None and file.part is not None
            for group_id in from_arrow(read_table(folder, path, "contexts"), "contexts")["group_id"].tolist()
        }

    def content(self, path: str) -> bytes:
        """Bytes of a file.

        Raises:
            DatasetError: It cannot be read.
        """
        return self.layer.folder.read(path, spec_limits().max_table_bytes)

    def document(self, path: str) -> Any | None:
        """A JSON document; ``None`` if the release has none of that name.

        Raises:
            DatasetError: It cannot be read, or does not conform to its schema.
        """
        if path not in self.manifest.files:
            return None
        return self.parsed(path, self.layer.folder.read(path, spec_limits().max_document_bytes), "restore the file")

    def parsed(self, path: str, content: bytes, advice: str) -> Any:
        """A JSON document of a layer from its bytes.

        Raises:
            DatasetError: It is no JSON, or does not conform to the schema of a document at `path`; with the advice.
        """
        try:
            document = parse_json(content)
        except (ValueError, RecursionError) as error:
            raise DatasetError(f"{self}: {path!r} {error}; {advice}") from error
        layer, _, name = path.partition("/")
        declared = LAYERS[layer].documents.get(name)
        for wrong in schema_mismatches(document, declared.schema) if declared is not None else ():
            pointer = wrong.location["pointer"]
            raise DatasetError(f"{self}: {path!r} at {pointer}: expected {wrong.expected}; {advice}")
        return document

    def benchmark_files(self) -> dict[str, bytes]:
        """Bytes of every file of the published benchmark layer, by path; none where none is published."""
        paths = [path for path in self.manifest.files if layer_of(path) == BENCHMARK] if self.has_benchmark else []
        return {path: self.content(path) for path in paths}


def open_release(root: Place) -> Release:
    """Open the release at `root`, wherever that is, and hold its derived layers against its manifest.

    Raises:
        DatasetError: There is no model layer or no manifest, or a file is not the one that the manifest lists.
        PlatformError: A store cannot be reached or refuses.
    """
    layer = open_model(root)
    manifest, mismatches = read_manifest(layer.folder)
    if mismatches or manifest != Manifest.of(manifest.files):
        raise DatasetError(f"{root}: {MANIFEST_FILE} contradicts itself; run `branchdrive build`")
    for name, digest in manifest.files.items():
        if layer_of(name) in _READ:
            try:
                found = layer.folder.digest(name)
            except DatasetError as error:
                raise DatasetError(f"{error}; {_REMEDY}") from error
            if found != digest:
                raise DatasetError(f"{root}: {name!r} is not the file that {MANIFEST_FILE} lists; {_REMEDY}")
    return Release(layer, manifest)


def benchmark_data(release: Release) -> BenchmarkData:
    """What the benchmark of a release is judged on.

    Raises:
        DatasetError: A table cannot be read or packed.
    """
    has_endings = bool(table_paths(ENDINGS, release.manifest.files))
    tables = (*DATA_TABLES, *([ENDINGS] if has_endings else []))
    frames = {name: layer_frames(release.layer.folder, name) for name in tables}
    return BenchmarkData.of(frames, release.layer.descriptor.action_bank)


def need_objects(release: Release) -> None:
    """Make sure that the release tells what sensors see of others.

    Raises:
        DatasetError: It does not.
    """
    if not table_paths(OBJECTS, release.manifest.files):
        raise absent_table(release.layer.folder, OBJECTS)


def baseline_contexts(release: Release, protocol: BenchmarkProtocol, data: BenchmarkData) -> Contexts | None:
    """What the baselines of a protocol see; ``None`` where it declares none.

    Raises:
        DatasetError: A table cannot be read or packed.
    """

    def frame_of(name: str) -> dict[str, Values]:
        return from_arrow(read_layer_table(release.layer.folder, name), name)

    return contexts_of(frame_of, data.groups, protocol.baselines) if protocol.baselines else None


def published_predictions(release: Release, protocol: BenchmarkProtocol, data: BenchmarkData) -> PredictionSet:
    """Predictions of the published benchmark layer.

    Raises:
        UsageError: None is published.
        DatasetError: They cannot be read, or are not those that the protocol asks for.
    """
    if not release.has_benchmark:
        raise UsageError(
            f"{release}: has no predictions; `branchdrive benchmark` makes them, or `branchdrive train`, `lock` "
            "and `predict`, and `--predictions FILE --name NAME` evaluates those of your own model"
        )
    rows = PredictionRows({name: layer_frames(release.layer.folder, name) for name in TABLES}, data)
    for wrong in prediction_mismatches(rows, protocol):
        raise DatasetError(f"{release}: {mismatch_text(wrong)}; run `branchdrive predict` again")
    return PredictionSet.of_rows(rows)
