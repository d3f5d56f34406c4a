"""The ledgers of a release: its test-set accesses in order, and the digests of what was fixed at each.

Ledgers only grow. An access is one event under one set of digests: to look again under them gives the same results
and is no other access, under other digests it is, because what was seen may have decided what was fixed.

The ledger of the quality layer is part of the identity that a benchmark locks, so an evaluation cannot write there
without breaking its own lock. Its accesses stand in a ledger of the same form in the benchmark layer, and a build that
leaves the benchmark out merges them into that of the release. A ledger records what writers tell it and proves nothing.

Source: paper IV-C, V-B (sealed test evaluation); spec/11-fidelity.md#ledger.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

__all__ = [
    "BENCHMARK_ACCESSES",
    "PREDICTION_ACCESS",
    "RELEASE_ACCESS",
    "ROUND",
    "SELECTION_ACCESS",
    "Ledger",
    "accesses",
    "digests_of",
    "merged",
    "with_benchmark_access",
    "with_round",
]

Ledger: TypeAlias = Mapping[str, Any]
"""A document that conforms to ``ledger.schema.json``."""

ROUND = ("thresholds_fixed", "validation_evaluated", "test_accessed")
"""Events of a round in order: of training, validation and test groups, under one split and one set of thresholds."""

RELEASE_ACCESS = ROUND[-1]
"""Replay fidelity of the test partition was evaluated."""

BENCHMARK_ACCESSES = PREDICTION_ACCESS, SELECTION_ACCESS = (
    "test_accessed_for_predictions",
    "test_accessed_for_selections",
)
"""Outcomes of the test partition were compared with predictions, and later with selections, of a benchmark."""

_DIGESTS = ("split_digest", "thresholds_digest", "lock_digest")


def with_round(ledger: Ledger | None, *, split_digest: str, thresholds_digest: str) -> dict[str, Any]:
    """The ledger with a whole round; the same ledger where the test access under these digests is on record.

    Args:
        ledger: The ledger so far; None if there is none.
        split_digest: Digest of ``split.json``.
        thresholds_digest: SHA-256 of the bytes of ``thresholds.json``.
    """
    entries, digests = _entries(ledger), (split_digest, thresholds_digest)
    if digests not in accesses(RELEASE_ACCESS, ledger):
        rounds = [entry for entry in entries if entry["event"] in ROUND]
        num_done = ROUND.index(rounds[-1]["event"]) + 1 if rounds and digests_of(rounds[-1]) == digests else 0
        for event in ROUND[num_done:]:
            _append(entries, event, split_digest=split_digest, thresholds_digest=thresholds_digest)
    return {"entries": entries}


def with_benchmark_access(ledger: Ledger | None, event: str, lock_digest: str) -> dict[str, Any]:
    """The ledger with an access for a benchmark; the same ledger where that under this lock is on record.

    Args:
        ledger: The ledger so far; None if there is none.
        event: One of `BENCHMARK_ACCESSES`.
        lock_digest: SHA-256 of the stored lock: of ``lock.json`` for predictions, ``ranking_lock.json`` for selections.

    Raises:
        ValueError: No such event, or selections before predictions.
    """
    if event not in BENCHMARK_ACCESSES:
        raise ValueError(f"event {event!r}, not one of {list(BENCHMARK_ACCESSES)}")
    if event == SELECTION_ACCESS and not accesses(PREDICTION_ACCESS, ledger):
        raise ValueError(f"{event!r} comes after {PREDICTION_ACCESS!r}, which has not happened")
    entries = _entries(ledger)
    if (lock_digest,) not in accesses(event, ledger):
        _append(entries, event, lock_digest=lock_digest)
    return {"entries": entries}


def merged(ledger: Ledger | None, other: Ledger | None, *, beside: Ledger | None = None) -> dict[str, Any] | None:
    """The ledger, followed by the accesses of another one that it does not have.

    Args:
        ledger: The ledger that is continued; None if there is none.
        other: A ledger in order; None if there is none.
        beside: A ledger whose accesses are on record already; None if there is none.

    Returns:
        The ledger; None where nothing is on record.
    """
    found = {"entries": _entries(ledger)}
    for entry in _entries(other):
        event, digests = entry["event"], digests_of(entry)
        if event == RELEASE_ACCESS:
            found = with_round(found, split_digest=digests[0], thresholds_digest=digests[1])
        elif event in BENCHMARK_ACCESSES and digests not in accesses(event, found, beside):
            _append(found["entries"], event, lock_digest=digests[0])
    return found if found["entries"] else None


def accesses(event: str, *ledgers: Ledger | None) -> set[tuple[str, ...]]:
    """The accesses of one kind that ledgers have on record together, each by the digests that it was under."""
    return {digests_of(entry) for ledger in ledgers for entry in _entries(ledger) if entry["event"] == event}


def digests_of(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Digests under which an entry was written: of split and thresholds, or of a lock."""
    return tuple(entry[name] for name in _DIGESTS if name in entry)


def _entries(ledger: Ledger | None) -> list[dict[str, Any]]:
    return list(ledger["entries"]) if ledger else []


def _append(entries: list[dict[str, Any]], event: str, **digests: str) -> None:
    entries.append({"number": len(entries) + 1, "event": event, **digests})
