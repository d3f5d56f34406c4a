"""The prediction lock: what is fixed before outcomes of the test partition are looked at."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

from branchdrive.contract.document import dump_json, parse_json, schema_violations
from branchdrive.contract.layer import LAYERS
from branchdrive.dataset.layout import layer_of
from branchdrive.dataset.manifest import Manifest
from branchdrive.derive.benchmark.lock import LockedCheckpoint, LockFacts, lock_document, lock_problems
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol, default_protocol, protocol_digest, read_protocol
from branchdrive.errors import DatasetError, UsageError
from branchdrive_reference.benchmark.release import LAYER, Release
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.benchmark.workspace import LOCK, PROTOCOL, Workspace
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint
from branchdrive_reference.learning.configuration import MODEL_VERSION

__all__ = ["choose_protocol", "lock_facts", "make_lock", "read_lock", "stored_document"]

PACKAGE = "branchdrive-reference"


def choose_protocol(workspace: Workspace, file: Path | None) -> BenchmarkProtocol:
    """The protocol in `file`, else the one that waits or is published, else the default one; it waits from now on.

    Raises:
        UsageError: The file holds no protocol.
        DatasetError: The stored one cannot be read.
    """
    if file is not None:
        try:
            protocol = read_protocol(parse_json(file.read_bytes()))
        except (ValueError, RecursionError, DatasetError) as error:
            raise UsageError(f"{file}: {error}") from error
    else:
        stored = stored_document(workspace, PROTOCOL)
        protocol = default_protocol() if stored is None else read_protocol(stored)
    if workspace.read(PROTOCOL) != dump_json(protocol.document):
        workspace.keep(PROTOCOL, dump_json(protocol.document))
    return protocol


def stored_document(workspace: Workspace, path: str) -> Any | None:
    """A JSON document of the benchmark layer, waiting or published; ``None`` if there is none.

    Raises:
        DatasetError: It cannot be read.
    """
    content = workspace.read(path)
    if content is None:
        return None
    try:
        document = parse_json(content)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{workspace.release.root}: {path!r} {error}; delete it and lock anew") from error
    declared = LAYERS[LAYER].documents.get(path.removeprefix(f"{LAYER}/"))
    for violation in schema_violations(document, declared.schema) if declared is not None else ():
        raise DatasetError(
            f"{workspace.release.root}: {path!r} at {violation.pointer or '/'}: expected {violation.expected}; "
            "delete it and lock anew"
        )
    return document


def lock_facts(release: Release, protocol: BenchmarkProtocol) -> LockFacts:
    """What a lock of this release says of it; the identity is that of the release without its raw layer."""
    derived = {
        path: digest for path, digest in release.manifest.files.items() if layer_of(path) not in ("raw", "media")
    }
    return LockFacts(
        protocol_digest(protocol),
        Manifest.of(derived).identity,
        release.layer.scalings().scalars.split_digest,
        release.manifest.files["model/normalisation.json"],
        release.manifest.files["model/features.json"],
        release.layer.candidate_order,
    )


def make_lock(workspace: Workspace, protocol: BenchmarkProtocol) -> dict[str, Any]:
    """Lock the checkpoints of all declared models; the same lock where everything is as it was.

    Raises:
        UsageError: A checkpoint is missing, or was trained on another configuration, release or version.
        DatasetError: A checkpoint cannot be read.
    """
    release, locked = workspace.release, []
    for task in model_tasks(protocol):
        path = task.path(workspace.checkpoints)
        if not path.is_file():
            raise UsageError(f"{release.root}: {task.name} has no checkpoint; run `branchdrive train` first")
        checkpoint = read_checkpoint(path)
        _check(checkpoint, task.configuration.digest, release)
        origin = checkpoint.provenance
        locked.append(
            LockedCheckpoint(
                origin.model, origin.seed, f"checkpoints/{path.name}", checkpoint.sha256, origin.training_groups_digest
            )
        )
    code = f"{version('branchdrive')}+models.{MODEL_VERSION}"
    document = lock_document(protocol, lock_facts(release, protocol), locked, package=PACKAGE, version=code)
    if workspace.read(LOCK) != dump_json(document):
        workspace.keep(LOCK, dump_json(document))
    return document


def read_lock(workspace: Workspace, protocol: BenchmarkProtocol) -> dict[str, Any]:
    """The lock of this release and protocol.

    Raises:
        UsageError: There is none, or it is of another release or protocol.
    """
    document = stored_document(workspace, LOCK)
    if document is None:
        raise UsageError(f"{workspace.release.root}: nothing is locked; run `branchdrive lock` first")
    for problem in lock_problems(document, lock_facts(workspace.release, protocol)):
        raise UsageError(
            f"{workspace.release.root}: the lock at {problem.place} is of {problem.found}, expected "
            f"{problem.expected}; run `branchdrive lock` and `branchdrive predict` again"
        )
    found: dict[str, Any] = document
    return found


def changed_checkpoints(workspace: Workspace, lock: dict[str, Any]) -> list[str]:
    """Files of the lock whose checkpoint is missing or another one."""
    changed = []
    for entry in lock["checkpoints"]:
        path = workspace.area / entry["file"]
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != entry["sha256"]:
            changed.append(entry["file"])
    return changed


def _check(checkpoint: Checkpoint, config_digest: str, release: Release) -> None:
    from branchdrive_reference.learning.prediction import check_release

    check_release(checkpoint, release.layer)
    if checkpoint.provenance.config_digest != config_digest:
        raise UsageError(
            f"{release.root}: {checkpoint!r} was trained under another configuration than the protocol declares; "
            "run `branchdrive train` again"
        )
