"""Locks and checkpoints of the benchmark layer as its rules see them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from branchdrive.contract.layout import BENCHMARK, LOCK_FILE, RANKING_LOCK_FILE
from branchdrive.contract.mismatch import Check, PreconditionError
from branchdrive.layers.compare import document_check, text_mismatches
from branchdrive.layers.view import ReleaseView

__all__ = [
    "CHECKPOINTS", "digest_of", "layer_files", "lock_of", "lock_of_kind", "other_kind", "ranking_lock_of",
]  # fmt: skip

_KINDS = {LOCK_FILE: "prediction", RANKING_LOCK_FILE: "ranking"}
CHECKPOINTS = "checkpoints/"


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


def layer_files(view: ReleaseView) -> dict[str, str]:
    """Digests of the checkpoints that are there, by their name in the lock."""
    prefix = f"{BENCHMARK}/"
    return {path.removeprefix(prefix): d for path, d in view.digests.items() if path.startswith(prefix)}
