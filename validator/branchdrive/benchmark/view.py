"""The benchmark layer as its rules see it: documents, locks, predictions and what they are judged on.

Everything is read once for a dataset: `ReleaseView.cached` keeps what a function here gives.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.baseline.context import Contexts, contexts_of
from branchdrive.benchmark.data import TABLES, BenchmarkData
from branchdrive.benchmark.prediction_check import prediction_mismatches
from branchdrive.benchmark.prediction_rows import TABLES as PREDICTED
from branchdrive.benchmark.prediction_set import PredictionSet
from branchdrive.benchmark.protocol import BenchmarkProtocol, read_protocol
from branchdrive.contract.layout import BENCHMARK, LOCK_FILE, PROTOCOL_FILE, RANKING_LOCK_FILE
from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import document_check, text_mismatches
from branchdrive.layers.view import ReleaseView

__all__ = [
    "CHECKPOINTS", "data_of", "digest_of", "layer_files", "lock_of", "lock_of_kind", "mismatches_of", "other_kind",
    "predictions_of", "protocol_of", "ranking_lock_of", "seen_of",
]  # fmt: skip

_KINDS = {LOCK_FILE: "prediction", RANKING_LOCK_FILE: "ranking"}
CHECKPOINTS = "checkpoints/"


def protocol_of(view: ReleaseView) -> BenchmarkProtocol:
    """The protocol of the layer.

    Raises:
        PreconditionError: It cannot be read.
    """
    try:
        return read_protocol(view.document(PROTOCOL_FILE))
    except DatasetError as error:
        raise PreconditionError(f"{PROTOCOL_FILE}: {error}") from error


def data_of(view: ReleaseView) -> BenchmarkData:
    """What the benchmark is judged on.

    Raises:
        PreconditionError: The model layer cannot be packed.
    """
    try:
        return BenchmarkData.of({name: view.frame(name) for name in TABLES}, view.descriptor.action_bank)
    except DatasetError as error:
        raise PreconditionError(f"the model layer cannot be packed: {error}") from error


def seen_of(view: ReleaseView) -> Contexts | None:
    """What the declared baselines see; ``None`` where none is declared.

    Raises:
        PreconditionError: The model layer cannot be packed.
    """
    baselines = view.cached(protocol_of).baselines
    if not baselines:
        return None
    try:
        return contexts_of(view.frame, view.cached(data_of), baselines)
    except DatasetError as error:
        raise PreconditionError(f"the model layer cannot be packed: {error}") from error


def lock_of(view: ReleaseView) -> Mapping[str, Any]:
    """The prediction lock.

    Raises:
        PreconditionError: It is a lock of another kind.
    """
    return lock_of_kind(view, LOCK_FILE)


def ranking_lock_of(view: ReleaseView) -> Mapping[str, Any] | None:
    """The ranking lock; ``None`` where the layer has none and claims nothing."""
    return lock_of_kind(view, RANKING_LOCK_FILE) if RANKING_LOCK_FILE in view.files else None


def lock_of_kind(view: ReleaseView, path: str) -> Mapping[str, Any]:
    """A lock, if it is of the kind that its place takes.

    Raises:
        PreconditionError: It is not.
    """
    if other_kind(view, path) is not None:
        raise PreconditionError(f"{path} is a lock of another kind")
    document: Mapping[str, Any] = view.document(path)
    return document


def other_kind(view: ReleaseView, path: str) -> Check | None:
    """What is wrong with a lock of another kind than its place takes; ``None`` for the right one."""
    found = view.document(path)["kind"]
    check = document_check(path, 1, text_mismatches("/kind", _KINDS[path], found))
    return check if len(check.bad) else None


def digest_of(view: ReleaseView, path: str) -> str:
    """SHA-256 of a document's stored bytes."""
    view.document(path)
    return hashlib.sha256(view.contents[path]).hexdigest()


def _frames(view: ReleaseView) -> dict[str, Any]:
    return {name: view.frame(name) for name in PREDICTED}


def mismatches_of(view: ReleaseView) -> list[Mismatch]:
    """What is wrong with predictions."""
    return list(prediction_mismatches(_frames(view), view.cached(data_of), view.cached(protocol_of)))


def predictions_of(view: ReleaseView) -> PredictionSet:
    """The predictions.

    Raises:
        PreconditionError: They are not complete.
    """
    try:
        return PredictionSet.from_frames(_frames(view), view.cached(data_of))
    except DatasetError as error:
        raise PreconditionError(f"predictions are not complete: {error}") from error


def layer_files(view: ReleaseView) -> dict[str, str]:
    """Digests of the checkpoints that are there, by their name in the lock."""
    prefix = f"{BENCHMARK}/"
    return {path.removeprefix(prefix): d for path, d in view.digests.items() if path.startswith(prefix)}
