"""Openings of a test partition that earlier releases of the same dataset have recorded, here and beside its raw layer.

Source: paper IV-C, V-B; spec/11-fidelity.md#ledger, spec/14-benchmark.md#openings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import LEDGER_FILE, OPENINGS_FILE
from branchdrive.errors import DatasetError
from branchdrive.quality.benchmark_openings import BENCHMARK_EVENTS, with_benchmark
from branchdrive.quality.ledger import EVENTS, recorded
from branchdrive.release.layers import load_document

__all__ = ["ledger_of", "merged_ledger", "openings_of"]

_LAST = list(EVENTS)[-1]


def ledger_of(root: Path) -> dict[str, Any] | None:
    """Ledger of the release in the folder `root`; None if there is none.

    Raises:
        DatasetError: There is one that cannot be read.
    """
    return _document(root, LEDGER_FILE)


def openings_of(root: Path) -> dict[str, Any] | None:
    """Openings that the benchmark in the folder `root` has recorded; None if there is none.

    Raises:
        DatasetError: There is a record that cannot be read.
    """
    return _document(root, OPENINGS_FILE)


def _document(root: Path, path: str) -> dict[str, Any] | None:
    if not (root / path).exists():
        return None
    layer, name = path.split("/")
    document: dict[str, Any] = load_document(root, path, LAYERS[layer].documents[name].schema)[1]
    return document


def merged_ledger(first: Mapping[str, Any] | None, second: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """One ledger of all openings of two.

    Where one continues the other it is the longer one; otherwise it is `first`, then those rounds of `second` after
    the entries that they share that `first` does not have, then those openings for a benchmark that it does not have.

    Raises:
        DatasetError: Events of `second` are out of order.
    """
    ours, theirs = (list(ledger["entries"]) if ledger else [] for ledger in (first, second))
    shared = 0
    while shared < min(len(ours), len(theirs)) and ours[shared] == theirs[shared]:
        shared += 1
    if shared == len(ours):
        return {"entries": theirs} if theirs else None
    merged: dict[str, Any] = {"entries": ours}
    known = {_digests(entry) for entry in ours if entry["event"] == _LAST}
    for entry in theirs[shared:]:
        if entry["event"] not in BENCHMARK_EVENTS and (digests := _digests(entry)) not in known:
            try:
                merged = recorded(merged, entry["event"], split_digest=digests[0], thresholds_digest=digests[1])
            except ValueError as error:
                raise DatasetError(f"{LEDGER_FILE!r} of the release: {error}; restore the file") from error
    return with_benchmark(merged, second)


def _digests(entry: Mapping[str, Any]) -> tuple[str, str]:
    return entry["split_digest"], entry["thresholds_digest"]
