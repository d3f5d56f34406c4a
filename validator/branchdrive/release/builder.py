"""Build of a release: stages in order, published together when all of them are done.

Layers are added beside the raw layer, or make a detached release of their own in another folder. Equal raw
layers and options give equal bytes. Source: paper, "Release Structure"; spec/10-layers.md#derivation, #detached.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from branchdrive.card.card import release_card
from branchdrive.card.croissant import croissant
from branchdrive.card.licence import render_licence
from branchdrive.contract.companion import CROISSANT_FILE, IGNORE_FILE, Companions
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import (
    BENCHMARK,
    BENCHMARK_LEDGER_FILE,
    CARD_FILE,
    DESCRIPTOR_FILE,
    LEAKAGE_FILE,
    LEDGER_FILE,
    LICENCE_FILE,
    RAW_DIR,
    SOURCE_FILE,
    STAGING_DIR,
)
from branchdrive.engine.spool import Spool
from branchdrive.errors import UsageError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.durable import delete, make_dir
from branchdrive.formats.folder import Folder, folder_of
from branchdrive.formats.manifest import Manifest
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.leakage.protocol import AuditProtocol
from branchdrive.quality.ledger import merged
from branchdrive.release.built_layers import LEDGERS, BuiltLayers, StoredFile, TableStore, load_layers, load_ledger
from branchdrive.release.leakage import build_leakage
from branchdrive.release.publish import has_card, publish, published_identity, staging
from branchdrive.release.scan import RawScan, check_unchanged, scan_raw
from branchdrive.release.stage import BuildOptions, build_canonical, build_model, build_quality, check_encoding
from branchdrive.release.stage_work import StageWork
from branchdrive.runtime.executor import Executor, in_process

__all__ = ["STAGES", "BuildReport", "build_release"]

STAGES = ("canonical", "quality", "leakage", "model")
"""Stages in order."""

_NEEDS = {"canonical": "", "quality": "canonical", "leakage": "quality", "model": "quality"}

_TABLES_DIR = "tables"
"""Folder in the working area of a build where tables wait."""

StageProgress = Callable[[str, int, int, str], None]
"""Called with the stage, the parts of it that are done, their number, and a note."""


@dataclass(frozen=True)
class BuildReport:
    """What a build made.

    Attributes:
        target: Folder of the release, or where it was uploaded.
        identity: Its identity.
        layers: Layers that it claims.
        documents: Its documents by path.
    """

    target: Path | str
    identity: str
    layers: tuple[str, ...]
    documents: dict[str, Any]


def build_release(
    root: Place,
    *,
    output: Path | str | None = None,
    stages: Sequence[str] = STAGES,
    options: BuildOptions | None = None,
    protocol: AuditProtocol | None = None,
    drop_leakage: bool = False,
    executor: Executor = in_process,
    progress: StageProgress | None = None,
) -> BuildReport:
    """Add derived layers to the dataset at `root`, or make a detached release of them in `output`.

    Args:
        root: Dataset with a finished raw layer; a detached release may be built from any place, see `open_store`.
        output: Folder of the detached release; None adds the layers in place.
        stages: Stages to carry out, of `STAGES`.
        options: What the builder decides.
        protocol: Numbers of the leakage audit.
        drop_leakage: Whether to leave out an audit that an earlier build has made; without it, one that still is
            of this release stays.
        executor: How shards are read.
        progress: Called after every part of a stage.

    Raises:
        UsageError: A stage is unknown or lacks the one before it, the folders do not go together, or a collection
            or another build is running in the folder; or layers are to be added where there is no folder.
        DatasetError: The raw layer is damaged, breaks the format, has too few groups or was changed meanwhile, or
            the bank has an encoding of its own.
        PlatformError: A store cannot be reached or refuses.
    """
    source = open_store(root)
    target = folder_of(source, "a build without `output`") if output is None else Folder.at(output)
    _check(source, target, stages, drop_leakage)
    report = progress or (lambda *_: None)
    options = options or BuildOptions()

    is_in_place = _is_one(source, target)
    with Spool.temporary() as spool, ExitStack() as resources:

        def scanned() -> RawScan:
            return scan_raw(
                source,
                spool,
                executor,
                lambda done, total: report("raw", done, total, "shards"),
                optional=options.tables,
            )

        # What is built from elsewhere is read before its release has a folder.
        scan = None if is_in_place else scanned()
        area = resources.enter_context(staging(target.root, create=not is_in_place))
        _check_card(target, stages)
        scan = scan or scanned()
        if "model" in stages:
            check_encoding(scan)
        layers = load_layers(target)
        _check_source(scan, layers, stages, target)
        if drop_leakage:
            layers.drop(LEAKAGE_FILE)
        work = StageWork(scan, layers, _table_store(area, scan), executor)
        job = _Job(work, target, tuple(stages), options, protocol, area, report)
        for stage in STAGES:
            if stage in stages:
                job.carry_out(stage)
        manifest = job.publish()
        target.replace(CROISSANT_FILE, dump_json(croissant(read_descriptor(target), manifest.files)))
    return BuildReport(target.root, manifest.identity, layers.names, layers.documents)


def _table_store(area: Path, scan: RawScan) -> TableStore:
    """An empty folder for tables in the working area of a build."""
    folder = area / _TABLES_DIR
    delete(folder)
    make_dir(folder)
    return TableStore(Folder(folder), scan.descriptor.action_bank.keys)


def _is_one(source: Store, target: Folder) -> bool:
    return isinstance(source, Folder) and source.root.resolve() == target.root.resolve()


def _check(source: Store, target: Folder, stages: Sequence[str], drop_leakage: bool) -> None:
    unknown = sorted(set(stages) - set(STAGES))
    if unknown or not stages:
        raise UsageError(f"stages are {', '.join(STAGES)}; found {', '.join(unknown) or 'none'}")
    if drop_leakage and "leakage" in stages:
        raise UsageError("the leakage audit is either carried out or left out; drop one of the two")
    if not _is_one(source, target):
        for one, other in ((source, target), (target, source)) if isinstance(source, Folder) else ():
            if one.root.resolve().is_relative_to(other.root.resolve()):
                raise UsageError(f"{one} lies inside {other}; a detached release has a folder of its own")
        _check_own_folder(source, target)


def _check_own_folder(source: Store, target: Folder) -> None:
    """A detached release has a new folder, an empty one, or its own."""
    if not target.root.exists():
        return
    if not target.root.is_dir():
        raise UsageError(f"{target} is not a folder; give a detached release a folder of its own")
    beside = Companions()
    names = {entry.name for entry in target.root.iterdir() if entry.name not in beside} - {STAGING_DIR}
    if RAW_DIR in names:
        raise UsageError(f"{target} holds a raw layer; give a detached release a folder of its own")
    if names and DESCRIPTOR_FILE not in names:
        raise UsageError(f"{target} holds other files, such as {min(names)!r}; give a release a folder of its own")
    if names:
        theirs, ours = (read_descriptor(dataset).dataset_id for dataset in (target, source))
        if theirs != ours:
            raise UsageError(f"{target} holds a release of {theirs!r}, not of {ours!r}; choose another folder")


def _check_card(target: Folder, stages: Sequence[str]) -> None:
    """No text of another author is where the card of the release goes."""
    if {*stages} != {"canonical"} and (target.root / CARD_FILE).exists() and not has_card(target):
        raise UsageError(
            f"{target}: {CARD_FILE} is a text of your own, and the card of the release takes its place; rename it, and "
            f"name it in {IGNORE_FILE} if it stays in the folder"
        )


def _check_source(scan: RawScan, layers: BuiltLayers, stages: Sequence[str], target: Folder) -> None:
    """The stages before those asked for are there, and of this raw layer."""
    first = min(stages, key=STAGES.index)
    needed = _NEEDS[first]
    if needed and needed not in layers.names:
        raise UsageError(
            f"{target}: the stage {first!r} needs the layer {needed!r}, which is not there; build it first"
        )
    if needed and layers.documents[SOURCE_FILE]["raw_layer"] != scan.digest:
        raise UsageError(f"{target}: its layers were built from another raw layer; start with the stage 'canonical'")


@dataclass(frozen=True)
class _Job:
    """One build: what it reads, where it writes, and what was decided."""

    work: StageWork
    target: Folder
    stages: tuple[str, ...]
    options: BuildOptions
    protocol: AuditProtocol | None
    area: Path
    report: StageProgress

    @property
    def scan(self) -> RawScan:
        return self.work.scan

    @property
    def layers(self) -> BuiltLayers:
        return self.work.layers

    @property
    def is_in_place(self) -> bool:
        return _is_one(self.scan.dataset, self.target)

    def carry_out(self, stage: str) -> None:
        """Build a stage, beside its place: what is there stays as it is until all of it is built."""
        self.report(stage, 0, 1, "")
        work = {
            "canonical": self._canonical,
            "quality": self._quality,
            "leakage": self._leakage,
            "model": self._model,
        }
        work[stage]()
        self.report(stage, 1, 1, "")

    def _canonical(self) -> None:
        layers, before = self.layers, self.layers.digests
        build_canonical(self.work)
        if layers.changed_since(before):
            layers.drop_after("canonical")
        if layers.contents.keys() & {*LEDGERS} and "quality" not in (*layers.names, *self.stages):
            raise UsageError(
                f"{self.scan.dataset}: the ledger of test-set accesses belongs to the quality layer; build 'quality' "
                "together with 'canonical'"
            )

    def _quality(self) -> None:
        layers, before = self.layers, self.layers.digests
        ledger = layers.documents.get(LEDGER_FILE)
        if not self.is_in_place:
            for path in LEDGERS:
                theirs = load_ledger(self.scan.dataset, path)
                ledger = merged(ledger, theirs, beside=layers.documents.get(BENCHMARK_LEDGER_FILE))
        build_quality(self.work, self.options, ledger)
        if layers.changed_since(before):
            layers.drop_after("quality")
            layers.drop(LEAKAGE_FILE)

    def _leakage(self) -> None:
        build_leakage(
            self.work,
            self.area,
            seed=self.options.seed,
            protocol=self.protocol,
            progress=lambda done, total, note: self.report("leakage", done, total, note),
        )

    def _model(self) -> None:
        build_model(self.work, self.options)

    def publish(self) -> Manifest:
        """Put everything in its place; the manifest of the release."""
        scan, layers = self.scan, self.layers
        kept_files = scan.files if self.is_in_place else {}
        if BENCHMARK in layers.names and _identity(kept_files, layers) != published_identity(self.target):
            layers.drop_after("model")  # it belongs to another release
        if BENCHMARK not in layers.names:
            self._keep_accesses()
        claimed = (("raw",) if self.is_in_place else ()) + layers.names
        descriptor = Descriptor.model_validate({**scan.descriptor.model_dump(mode="json"), "layers": list(claimed)})
        # The ledger stays in its place while the layer around it is built again.
        kept = {*layers.names, LEDGER_FILE}
        built: dict[str, bytes | StoredFile] = {**layers.contents, **layers.files}
        files = {path: file for path, file in built.items() if {path, path.split("/")[0]} & kept}
        if "quality" in layers.names:
            files[CARD_FILE] = release_card(descriptor, layers.documents, files).encode()
            files[LICENCE_FILE] = render_licence(descriptor.licence).encode()
        check_unchanged(scan)
        return publish(self.target, kept_files, files, descriptor)

    def _keep_accesses(self) -> None:
        """Put the accesses of a benchmark that goes on the ledger of the release."""
        before = self.layers.documents.get(LEDGER_FILE)
        ledger = merged(before, self.layers.documents.get(BENCHMARK_LEDGER_FILE))
        if ledger != before:
            self.layers.put_document(LEDGER_FILE, ledger)


def _identity(kept: Mapping[str, str], layers: BuiltLayers) -> str:
    return Manifest.of({**kept, **layers.digests}).identity
