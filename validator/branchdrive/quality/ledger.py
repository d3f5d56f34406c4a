"""The ledgers of a release: its test-set accesses in order, and the digests of what was fixed at each.

Ledgers only grow. An access is one event under one set of digests: to look again under them gives the same results
and is no other access, under other digests it is, because what was seen may have decided what was fixed.

The ledger of the quality layer is part of the identity that a benchmark locks, so an evaluation cannot write there
without breaking its own lock. Its accesses stand in a ledger of the same form in the benchmark layer, and a build that
leaves the benchmark out merges them into that of the release. A ledger records what writers tell it and proves nothing;
rules find entries out of order, and accesses that are not those of the layer around it.

Source: paper, "Training and Test Locking" and "Collection Integrity, Replay Fidelity, and Leakage" (sealed test
evaluation); spec/11-fidelity.md#ledger, spec/14-benchmark.md#accesses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

from branchdrive.contract.mismatch import Mismatch

__all__ = [
    "BENCHMARK_ACCESSES",
    "PREDICTION_ACCESS",
    "RELEASE_ACCESS",
    "ROUND",
    "SELECTION_ACCESS",
    "Ledger",
    "accesses",
    "benchmark_mismatches",
    "digests_of",
    "merged",
    "order_mismatches",
    "release_mismatches",
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


def order_mismatches(ledger: Ledger) -> Iterator[Mismatch]:
    """Numbers that do not count up, rounds out of order, selections before predictions, and locks that repeat.

    Args:
        ledger: A document that conforms to its schema.
    """
    last: Mapping[str, Any] | None = None
    seen: set[tuple[str, ...]] = set()
    for i, entry in enumerate(ledger["entries"]):
        pointer, event = f"/entries/{i}", entry["event"]
        if entry["number"] != i + 1:
            yield Mismatch({"pointer": f"{pointer}/number"}, str(i + 1), str(entry["number"]))
        if event in ROUND:
            allowed = _next_events(last, entry)
            if event not in allowed:
                yield Mismatch({"pointer": f"{pointer}/event"}, " or ".join(allowed) or "no further entry", event)
            last = entry
            continue
        if event == SELECTION_ACCESS and not any(earlier == PREDICTION_ACCESS for earlier, *_ in seen):
            yield Mismatch({"pointer": f"{pointer}/event"}, PREDICTION_ACCESS, event)
        access = (event, *digests_of(entry))
        if access in seen:
            yield Mismatch({"pointer": f"{pointer}/lock_digest"}, "another lock than before", "the same lock")
        seen.add(access)


def _next_events(last: Mapping[str, Any] | None, entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Events of a round that may follow: the next one under equal digests, else the first of a new round."""
    if last is None or digests_of(last) != digests_of(entry):
        return ROUND[:1]
    following = ROUND.index(last["event"]) + 1
    return ROUND[following : following + 1]


def release_mismatches(ledger: Ledger, *, split_digest: str, thresholds_digest: str) -> Iterator[Mismatch]:
    """What is wrong with the ledger of a release.

    Args:
        ledger: ``quality/ledger.json``, which conforms to its schema.
        split_digest: Digest of the release's ``split.json``.
        thresholds_digest: SHA-256 of the bytes of the release's ``thresholds.json``.
    """
    yield from order_mismatches(ledger)
    digests = (split_digest, thresholds_digest)
    if not any(entry["event"] == RELEASE_ACCESS and digests_of(entry) == digests for entry in ledger["entries"]):
        expected = f"{RELEASE_ACCESS} under split {split_digest} and thresholds {thresholds_digest}"
        yield Mismatch({"pointer": "/entries"}, expected, "no such entry")


def benchmark_mismatches(
    ledger: Ledger, *, lock_digest: str, ranking_lock_digest: str | None, has_results: bool
) -> Iterator[Mismatch]:
    """What is wrong with the ledger of a benchmark with these locks.

    Args:
        ledger: ``benchmark/ledger.json``, which conforms to its schema.
        lock_digest: SHA-256 of the stored ``lock.json``.
        ranking_lock_digest: SHA-256 of the stored ``ranking_lock.json``; None where there is none.
        has_results: Whether the layer has results, which take an access of both kinds under its own locks.
    """
    yield from order_mismatches(ledger)
    entries = ledger["entries"]
    for i, entry in enumerate(entries):
        if entry["event"] not in BENCHMARK_ACCESSES:
            yield Mismatch({"pointer": f"/entries/{i}/event"}, " or ".join(BENCHMARK_ACCESSES), entry["event"])
    for event, digest in zip(BENCHMARK_ACCESSES, (lock_digest, ranking_lock_digest), strict=True):
        locks = {i: entry["lock_digest"] for i, entry in enumerate(entries) if entry["event"] == event}
        if not locks and has_results:
            yield Mismatch({"pointer": "/entries"}, f"{event}, since there are results", "no such entry")
        elif locks and digest not in locks.values():
            last = max(locks)
            expected = "no entry, since there is no lock of it" if digest is None else digest
            yield Mismatch({"pointer": f"/entries/{last}/lock_digest"}, expected, locks[last])
