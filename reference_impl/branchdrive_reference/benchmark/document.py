"""Documents of a benchmark at work: the one that waits in the working area, else the published one.

Learned risks of guards wait there too, until the ranking lock holds them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from branchdrive.benchmark.guard.risk import Risks
from branchdrive.benchmark.lock import further_risks_of
from branchdrive.benchmark.protocol.protocol import (
    BenchmarkProtocol,
    default_protocol,
    read_protocol,
    visual_protocol,
)
from branchdrive.benchmark.shortage import shortage_sentences, sizes_sentence
from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.layout import PROTOCOL_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.named_file import read_named_file
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.benchmark.workspace import Workspace
from branchdrive_reference.learning.configuration import Configuration
from branchdrive_reference.learning.image_encoding import STREAM_OF

__all__ = [
    "PROTOCOLS",
    "RISK",
    "choose_protocol",
    "keep_risks",
    "objects_protocol",
    "published_protocol",
    "read_protocol_file",
    "sentences_before_training",
    "stored_document",
    "trees_protocol",
    "untrained_sentence",
    "waiting_risks",
]


@cache
def trees_protocol() -> BenchmarkProtocol:
    """The normative protocol with boosted trees, `T3` and as a bound `T3p`; they need the extra `trees`."""
    return _with_models("trees", "trees.json")


@cache
def objects_protocol() -> BenchmarkProtocol:
    """That of trees with models of objects, `M3o`, `M3or` and `T3o`, for releases that have them."""
    return _with_models("objects", "trees.json", "objects.json")


def _with_models(name: str, *files: str) -> BenchmarkProtocol:
    """The normative protocol with further models, under a name of its own."""
    folder, normative = resources.files("branchdrive_reference.benchmark"), default_protocol().document
    models = [model for file in files for model in json.loads(folder.joinpath(file).read_text("utf-8"))]
    return read_protocol(
        normative | {"name": f"branchdrive-benchmark-{name}", "models": [*normative["models"], *models]}
    )


PROTOCOLS = {
    "structured": default_protocol, "visual": visual_protocol, "trees": trees_protocol, "objects": objects_protocol,
}  # fmt: skip
"""Protocols by the names that commands know them by."""

RISK = "benchmark/risk.json"
"""Where risks wait until the ranking lock holds them; it is no file of the release."""


def choose_protocol(workspace: Workspace, file: Path | None, *, keep: bool) -> BenchmarkProtocol:
    """The protocol in `file`, else the one that waits or is published, else the normative one for the release.

    Args:
        workspace: The working area.
        file: What the user named; see `read_protocol_file`.
        keep: Whether it waits from now on, for the commands that follow.

    Raises:
        UsageError: The file holds no protocol, or one with a model that this software cannot train.
        DatasetError: The stored one cannot be read.
    """
    protocol = (
        _protocol(workspace.release, stored_document(workspace, PROTOCOL_FILE))
        if file is None
        else read_protocol_file(file)
    )
    if file is not None and workspace.read(PROTOCOL_FILE) != dump_json(protocol.document):
        _check_models(file, protocol)
    if keep and workspace.read(PROTOCOL_FILE) != dump_json(protocol.document):
        workspace.keep(PROTOCOL_FILE, dump_json(protocol.document))
    return protocol


def published_protocol(release: Release) -> BenchmarkProtocol:
    """The published protocol, else the normative one for the release.

    Raises:
        DatasetError: It cannot be read.
    """
    return _protocol(release, release.document(PROTOCOL_FILE))


def _protocol(release: Release, stored: Any | None) -> BenchmarkProtocol:
    try:
        if stored is not None:
            return read_protocol(stored)
        return default_protocol() if _lacking_streams(release) else visual_protocol()
    except DatasetError as error:
        raise DatasetError(f"{release}: {PROTOCOL_FILE!r}: {error}") from error


def _lacking_streams(release: Release) -> tuple[str, ...]:
    """Streams of images that the normative models read and of which the release has none."""
    claimed = release.layer.descriptor.streams if release.has_raw else ()
    return tuple(stream for stream in STREAM_OF.values() if stream not in claimed)


def untrained_sentence(
    release: Release, protocol: BenchmarkProtocol, models: Sequence[str] | None = None
) -> str | None:
    """Which normative models are left out because the release has no images for them; ``None`` where none is.

    Args:
        release: The release.
        protocol: The one in force.
        models: Models that are asked for; all by default. Nothing is said of others.
    """
    lacking = _lacking_streams(release)
    if protocol.digest != default_protocol().digest or not lacking:
        return None
    left_out = [model.id for model in visual_protocol().models if protocol.model(model.id) is None]
    if models is not None and not {*models} & {*left_out}:
        return None
    unclaimed = [stream for stream in STREAM_OF.values() if stream not in release.layer.descriptor.streams]
    reason = (
        f"has no images of {', '.join(unclaimed)}; `branchdrive render` draws them for a dataset, `branchdrive collect "
        "--media` while it is collected, and a release of that has them"
        if unclaimed
        else "is here without its raw layer, where images lie and outcomes repeat; `branchdrive build DATASET` without "
        "`--output` makes a release in place, to benchmark instead"
    )
    return f"{', '.join(left_out)} are not trained: the release {reason}"


def sentences_before_training(
    release: Release, protocol: BenchmarkProtocol, models: Sequence[str] | None = None, *, with_guard: bool
) -> list[str]:
    """What is to be known before hours of training: sizes of partitions, what they lack, models that are left out.

    Args:
        release: The release.
        protocol: The one in force.
        models: Models that are asked for; all by default.
        with_guard: Whether a guard is calibrated too.
    """
    groups, clusters = ({name: sizes[unit] for name, sizes in release.sizes.items()} for unit in ("groups", "clusters"))
    untrained = untrained_sentence(release, protocol, models)
    return [
        sizes_sentence(groups, clusters),
        *shortage_sentences(groups, clusters, protocol.guard if with_guard else None),
        *([untrained] if untrained else []),
    ]


def _check_models(file: Path, protocol: BenchmarkProtocol) -> None:
    try:
        for model in protocol.models:
            Configuration.of(model)
    except DatasetError as error:
        raise UsageError(f"{file}: {error}") from error


def read_protocol_file(file: Path) -> BenchmarkProtocol:
    """The protocol in a file, or one by its name in `PROTOCOLS`.

    Raises:
        UsageError: There is none.
    """
    if str(file) in PROTOCOLS:
        return PROTOCOLS[str(file)]()
    if not file.exists():
        names = ", ".join(f"`{name}`" for name in PROTOCOLS)
        raise UsageError(f"{str(file)!r} is no protocol; give {names} or a file that holds one")
    try:
        return read_protocol(parse_json(read_named_file(file, spec_limits().max_document_bytes)))
    except (ValueError, RecursionError, DatasetError) as error:
        raise UsageError(f"{file}: {error}") from error


def stored_document(workspace: Workspace, path: str) -> Any | None:
    """A JSON document of the benchmark layer, waiting or published; ``None`` if there is none.

    Raises:
        DatasetError: It cannot be read.
    """
    content = workspace.read(path)
    if content is None:
        return None
    return workspace.release.parsed(path, content, "delete it and lock again")


def keep_risks(workspace: Workspace, protocol: BenchmarkProtocol, risks: Risks) -> None:
    """Let risks that were fitted under this protocol wait."""
    fits = [
        {"model": model, "tolerance_m": tolerance_m, "risk_fit": risk.model_dump(mode="json")}
        for (model, tolerance_m), risk in risks.items()
    ]
    workspace.keep(RISK, dump_json({"protocol_digest": protocol.digest, "further_risk_fits": fits}))


def waiting_risks(workspace: Workspace, protocol: BenchmarkProtocol) -> Risks:
    """The risks that wait for a ranking lock under this protocol; none where one that it declares is missing."""
    record = stored_document(workspace, RISK)
    if not isinstance(record, dict) or record.get("protocol_digest") != protocol.digest:
        return {}
    try:
        found = further_risks_of(record)
    except (DatasetError, LookupError, TypeError, ValueError):
        return {}  # they are fitted again
    guard = protocol.guard
    return found if {*found} == {(guard.model, guard.tolerance_m), *guard.further} else {}
