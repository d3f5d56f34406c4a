"""What is wrong with a ledger: entries out of order, and accesses that are not those of the layer around it.

Source: spec/11-fidelity.md#ledger, spec/14-benchmark.md#accesses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from branchdrive.contract.mismatch import Mismatch
from branchdrive.quality.ledger import (
    BENCHMARK_ACCESSES,
    PREDICTION_ACCESS,
    RELEASE_ACCESS,
    ROUND,
    SELECTION_ACCESS,
    Ledger,
    digests_of,
)

__all__ = ["benchmark_mismatches", "order_mismatches", "release_mismatches"]


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
