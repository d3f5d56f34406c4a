"""Openings of the test partition for a benchmark that is gone, in the ledger of the release that was built after it.

A benchmark is of one identity of its release and goes with it; that it opened the test partition does not. The
ledger is part of the identity, and a lock names the identity: no lock of a release can be one that its ledger holds,
and without an entry of its ledger a release is no longer the one that was locked.

Source: paper IV-C; spec/11-fidelity.md#ledger, spec/14-benchmark.md#openings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

__all__ = ["BENCHMARK_EVENTS", "PREDICTION", "RANKING", "locks_of", "with_benchmark"]

PREDICTION = "prediction_test_opened"
RANKING = "ranking_test_opened"

BENCHMARK_EVENTS = (PREDICTION, RANKING)
"""What is recorded: predictions, and later selections, held against the test partition."""


def locks_of(document: Mapping[str, Any], event: str) -> list[str]:
    """Locks under which the test partition was opened for predictions or for selections, in order.

    Args:
        document: ``ledger.json`` or ``openings.json``.
        event: One of `BENCHMARK_EVENTS`.
    """
    return [entry["lock_digest"] for entry in document["entries"] if entry["event"] == event]


def with_benchmark(
    ledger: Mapping[str, Any] | None, openings: Mapping[str, Any] | None, *, beside: Mapping[str, Any] | None = None
) -> dict[str, Any] | None:
    """The ledger with those openings of a benchmark that it does not have.

    What is there is counted, so that the same openings again add nothing, and a lock that was gone back to stays.

    Args:
        ledger: Document ``ledger.json``; None if there is none.
        openings: The benchmark's ``openings.json``, or another ledger; None if there is none.
        beside: An ``openings.json`` whose openings are on record already; None if there is none.

    Returns:
        The ledger; None where there is nothing to record.
    """
    entries = list(ledger["entries"]) if ledger else []
    known = _counted(ledger) + _counted(beside)
    seen: Counter[tuple[str, str]] = Counter()
    for entry in openings["entries"] if openings else ():
        if entry["event"] not in BENCHMARK_EVENTS:
            continue
        opening = entry["event"], entry["lock_digest"]
        seen[opening] += 1
        if seen[opening] > known[opening]:
            event, lock = opening
            entries.append({"number": len(entries) + 1, "event": event, "partition": "test", "lock_digest": lock})
    return {"entries": entries} if entries else None


def _counted(document: Mapping[str, Any] | None) -> Counter[tuple[str, str]]:
    found = [(event, lock) for event in BENCHMARK_EVENTS for lock in (locks_of(document, event) if document else ())]
    return Counter(found)
