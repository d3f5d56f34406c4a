"""The ledger: every time that a partition was opened for evaluation, in order.

A round fixes thresholds on training groups, evaluates validation and only then opens the test partition, all
under one split and one document of thresholds. Building the same release again opens nothing new; other
digests after a look at the test partition are another opening, which a reader is told. Openings for a benchmark
that is gone stand between the rounds, or after them, and are no part of one.

Source: paper V-B (sealed test evaluation); spec/11-fidelity.md#ledger.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from branchdrive.contract.comparison import Problem
from branchdrive.quality.benchmark_openings import BENCHMARK_EVENTS

__all__ = ["EVENTS", "ledger_problems", "num_test_openings", "opened", "recorded"]

EVENTS: Mapping[str, str] = MappingProxyType(
    {"thresholds_fixed": "train", "validation_evaluated": "val", "test_opened": "test"}
)
"""Events of a round in order, and the partition that each is about."""

_ORDER = list(EVENTS)
_LAST = _ORDER[-1]


def opened(ledger: Mapping[str, Any] | None, *, split_digest: str, thresholds_digest: str) -> dict[str, Any]:
    """The ledger after a whole round; the same ledger where the test partition was opened under these digests before.

    Args:
        ledger: Document ``ledger.json`` so far; None if there is none.
        split_digest: Digest of ``split.json``.
        thresholds_digest: SHA-256 of the bytes of ``thresholds.json``.
    """
    after = dict(ledger or {"entries": []})
    if (split_digest, thresholds_digest) in _openings(after):
        return after
    for event in EVENTS:
        after = recorded(after, event, split_digest=split_digest, thresholds_digest=thresholds_digest)
    return after


def recorded(
    ledger: Mapping[str, Any] | None, event: str, *, split_digest: str, thresholds_digest: str
) -> dict[str, Any]:
    """The ledger after one event; the same ledger where the round of these digests has it already.

    Args:
        ledger: Document ``ledger.json`` so far; None if there is none.
        event: One of `EVENTS`.
        split_digest: Digest of ``split.json``.
        thresholds_digest: SHA-256 of the bytes of ``thresholds.json``.

    Raises:
        ValueError: No such event, or the events before it in its round have not happened.
    """
    if event not in EVENTS:
        raise ValueError(f"event {event!r}, not one of {_ORDER}")
    entries = list((ledger or {"entries": []})["entries"])
    digests = {"split_digest": split_digest, "thresholds_digest": thresholds_digest}
    last = next((entry for entry in reversed(entries) if entry["event"] in EVENTS), None)
    step = _ORDER.index(last["event"]) if last is not None and _digests(last) == digests else -1
    place = _ORDER.index(event)
    if place <= step:
        return {"entries": entries}
    if place != step + 1:
        raise ValueError(f"{event!r} comes after {_ORDER[place - 1]!r}, which has not happened under these digests")
    entries.append({"number": len(entries) + 1, "event": event, "partition": EVENTS[event], **digests})
    return {"entries": entries}


def num_test_openings(ledger: Mapping[str, Any]) -> int:
    """How often the test partition was opened: under how many pairs of split and thresholds."""
    return len(_openings(ledger))


def _openings(ledger: Mapping[str, Any]) -> set[tuple[str, str]]:
    """Digests of split and thresholds under which the test partition was opened."""
    return {(e["split_digest"], e["thresholds_digest"]) for e in ledger["entries"] if e["event"] == _LAST}


def ledger_problems(document: Mapping[str, Any], *, split_digest: str, thresholds_digest: str) -> list[Problem]:
    """What is wrong with a ledger of a release with these digests.

    Args:
        document: ``ledger.json``, which conforms to its schema.
        split_digest: Digest of the release's ``split.json``.
        thresholds_digest: SHA-256 of the bytes of the release's ``thresholds.json``.
    """
    return [*_sequence_problems(document), *_current_problems(document, split_digest, thresholds_digest)]


def _sequence_problems(document: Mapping[str, Any]) -> list[Problem]:
    """Numbers count up, rounds go in order under one pair of digests, and no round repeats the one before."""
    found: list[Problem] = []
    before: Mapping[str, Any] | None = None
    for i, entry in enumerate(document["entries"]):
        place = f"/entries/{i}"
        if entry["number"] != i + 1:
            found.append(Problem(f"{place}/number", str(i + 1), str(entry["number"])))
        if entry["event"] in BENCHMARK_EVENTS:
            continue
        if entry["partition"] != EVENTS[entry["event"]]:
            found.append(Problem(f"{place}/partition", EVENTS[entry["event"]], str(entry["partition"])))
        allowed = _next_events(before, entry)
        if entry["event"] not in allowed:
            found.append(Problem(f"{place}/event", " or ".join(allowed) or "no further entry", entry["event"]))
        before = entry
    return found


def _next_events(before: Mapping[str, Any] | None, entry: Mapping[str, Any]) -> list[str]:
    """Events that may follow: the next of the round under equal digests, else a new round."""
    if before is None or _digests(before) != _digests(entry):
        return _ORDER[:1]
    return _ORDER[_ORDER.index(before["event"]) + 1 :][:1]


def _current_problems(document: Mapping[str, Any], split_digest: str, thresholds_digest: str) -> list[Problem]:
    """The test partition was opened under the release's own digests."""
    if (split_digest, thresholds_digest) in _openings(document):
        return []
    wanted = f"{_LAST} under split {split_digest} and thresholds {thresholds_digest}"
    return [Problem("/entries", wanted, "no such entry")]


def _digests(entry: Mapping[str, Any]) -> dict[str, str]:
    return {name: entry[name] for name in ("split_digest", "thresholds_digest")}
