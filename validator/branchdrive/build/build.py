"""Build of a release: stages in order, each published when it is done.

Layers are added beside the raw layer, or make a detached release of their own in another folder. Equal raw
layers and options give equal bytes. Source: paper III-F; spec/10-layers.md#derivation, #detached.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from branchdrive.audit.worker import Executor, in_process
from branchdrive.build.layers import LEDGER, BuiltLayers, load_layers
from branchdrive.build.leakage import build_leakage
from branchdrive.build.publish import publish, staging, stated_identity
from branchdrive.build.scan import RawScan, scan_raw
from branchdrive.build.stage import SOURCE, BuildOptions, build_canonical, build_model, build_quality
from branchdrive.contract.descriptor import Descriptor
from branchdrive.dataset.descriptor_file import read_descriptor
from branchdrive.dataset.layout import CARD_FILE, DESCRIPTOR_FILE, LEAKAGE_FILE, LICENCE_FILE, RAW_DIR, STAGING_DIR
from branchdrive.dataset.manifest import Manifest
from branchdrive.derive.layer.card import render_card, render_licence
from branchdrive.derive.leakage.audit import AuditProtocol
from branchdrive.errors import UsageError

__all__ = ["STAGES", "BuildReport", "build_release"]

STAGES = ("canonical", "quality", "leakage", "model")
"""Stages in order."""

_NEEDS = {"canonical": "", "quality": "canonical", "leakage": "quality", "model": "quality"}

StageProgress = Callable[[str, int, int, str], None]
"""Called with the stage, the parts of it that are done, their number, and a note."""


@dataclass(frozen=True)
class BuildReport:
    """What a build made.

    Attributes:
        target: Folder of the release.
        identity: Its identity.
        layers: Layers that it claims.
        documents: Its documents by path.
    """

    target: Path
    identity: str
    layers: tuple[str, ...]
    documents: dict[str, Any]


def build_release(
    root: Path | str,
    *,
    output: Path | str | None = None,
    stages: Sequence[str] = STAGES,
    options: BuildOptions | None = None,
    protocol: AuditProtocol | None = None,
    executor: Executor = in_process,
    progress: StageProgress | None = None,
) -> BuildReport:
    """Add derived layers to the dataset at `root`, or make a detached release of them in `output`.

    Args:
        root: Dataset with a finished raw layer.
        output: Folder of the detached release; None adds the layers in place.
        stages: Stages to carry out, of `STAGES`.
        options: What the builder decides.
        protocol: Numbers of the leakage audit.
        executor: How shards are read.
        progress: Told after every part of a stage.

    Raises:
        UsageError: A stage is unknown or lacks the one before it, or the folders do not go together.
        DatasetError: The raw layer is damaged or breaks the format, or has too few groups.
    """
    source, target = Path(root), Path(output if output is not None else root)
    options = options or BuildOptions()
    _check(source, target, stages)
    report = progress or (lambda *_: None)
    scan = scan_raw(source, executor, lambda done, total: report("raw", done, total, "shards"))
    with staging(target) as area:
        layers = load_layers(target, scan.descriptor.action_bank.keys)
        _check_source(scan, layers, stages, target)
        manifest = None
        for stage in [stage for stage in STAGES if stage in stages]:
            report(stage, 0, 1, "")
            _carry_out(stage, stages, scan, layers, options, protocol, area, report)
            manifest = _published(target, scan, layers)
            report(stage, 1, 1, "")
        assert manifest is not None  # noqa: S101  (there is a stage; for the type checker)
    return BuildReport(target, manifest.identity, layers.names, layers.documents)


def _check(source: Path, target: Path, stages: Sequence[str]) -> None:
    unknown = sorted(set(stages) - set(STAGES))
    if unknown or not stages:
        raise UsageError(f"stages are {', '.join(STAGES)}; found {', '.join(unknown) or 'none'}")
    if source.resolve() != target.resolve():
        for one, other in ((source, target), (target, source)):
            if one.resolve().is_relative_to(other.resolve()):
                raise UsageError(f"{one} lies inside {other}; a detached release has a folder of its own")
        _check_own_folder(source, target)


def _check_own_folder(source: Path, target: Path) -> None:
    """A detached release has a new folder, an empty one, or its own."""
    if not target.exists():
        return
    if not target.is_dir():
        raise UsageError(f"{target} is no folder; give a detached release a folder of its own")
    names = {entry.name for entry in target.iterdir()} - {STAGING_DIR}
    if RAW_DIR in names:
        raise UsageError(f"{target} holds a raw layer; give a detached release a folder of its own")
    if names and DESCRIPTOR_FILE not in names:
        raise UsageError(f"{target} holds other files, such as {min(names)!r}; give a release a folder of its own")
    if names:
        theirs, ours = (read_descriptor(folder).dataset_id for folder in (target, source))
        if theirs != ours:
            raise UsageError(f"{target} holds a release of {theirs!r}, not of {ours!r}; choose another folder")


def _check_source(scan: RawScan, layers: BuiltLayers, stages: Sequence[str], target: Path) -> None:
    """The stages before those asked for are there, and of this raw layer."""
    first = min(stages, key=STAGES.index)
    needed = _NEEDS[first]
    if needed and needed not in layers.names:
        raise UsageError(
            f"{target}: the stage {first!r} needs the layer {needed!r}, which is not there; build it first"
        )
    if needed and layers.documents[SOURCE]["raw_layer"] != scan.digest:
        raise UsageError(f"{target}: its layers are of another raw layer; begin with the stage 'canonical'")


def _carry_out(
    stage: str,
    stages: Sequence[str],
    scan: RawScan,
    layers: BuiltLayers,
    options: BuildOptions,
    protocol: AuditProtocol | None,
    area: Path,
    report: StageProgress,
) -> None:
    if stage == "canonical":
        before = dict(layers.contents)
        build_canonical(scan, layers)
        if layers.contents != {**layers.contents, **before}:
            layers.drop_after("canonical")
        if LEDGER in layers.contents and "quality" not in (*layers.names, *stages):
            raise UsageError(
                f"{scan.root}: the ledger of openings has no layer to lie in; build 'quality' together with 'canonical'"
            )
    elif stage == "quality":
        before = dict(layers.contents)
        build_quality(scan, layers, options, layers.documents.get(LEDGER))
        if layers.contents != {**layers.contents, **before}:
            layers.drop_after("quality")
            for held in (layers.contents, layers.documents):
                held.pop(LEAKAGE_FILE, None)
    elif stage == "leakage":
        build_leakage(
            scan,
            layers,
            area,
            seed=options.seed,
            protocol=protocol,
            progress=lambda done, total, note: report(stage, done, total, note),
        )
    else:
        build_model(scan, layers)


def _published(target: Path, scan: RawScan, layers: BuiltLayers) -> Any:
    in_place = target.resolve() == scan.root.resolve()
    kept_files = scan.files if in_place else {}
    if "benchmark" in layers.names and _identity(kept_files, layers) != stated_identity(target):
        layers.drop_after("model")  # it belongs to another release
    claimed = (("raw",) if in_place else ()) + layers.names
    descriptor = Descriptor.model_validate({**scan.descriptor.model_dump(mode="json"), "layers": list(claimed)})
    # The ledger stays in its place while the layer around it is built again.
    kept = {*layers.names, LEDGER}
    files = {path: content for path, content in layers.contents.items() if {path, path.split("/")[0]} & kept}
    if "quality" in layers.names:
        named = {
            name: layers.documents[f"quality/{name}.json"]
            for name in ("population", "split", "thresholds", "retention", "ledger", "variants")
        }
        leakage = layers.documents.get(LEAKAGE_FILE)
        files[CARD_FILE] = render_card(descriptor, layers.documents[SOURCE], **named, leakage=leakage).encode()
        files[LICENCE_FILE] = render_licence(descriptor.licence).encode()
    return publish(target, kept_files, files, descriptor)


def _identity(kept: Mapping[str, str], layers: BuiltLayers) -> str:
    return Manifest.of({**kept, **{path: layers.digest(path) for path in layers.contents}}).identity
