"""Openings: every time that outcomes of the test partition were looked at, under which lock; and what tables say of it.

Looking again under the same lock gives the same results and is no other opening. Another lock after a look is: what
was seen may have decided what was locked. The document records what writers tell it; it cannot prove. Openings for
benchmarks of the same dataset that are gone are on the release's ledger.

Source: paper IV-C; spec/14-benchmark.md#openings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from branchdrive.contract.comparison import Problem
from branchdrive.quality.benchmark_openings import BENCHMARK_EVENTS as EVENTS
from branchdrive.quality.benchmark_openings import PREDICTION, RANKING, locks_of
from branchdrive.quality.ledger import num_test_openings
from branchdrive.quality.text import opening_sentence

__all__ = ["CALIBRATION_READ", "EVENTS", "is_opened", "num_openings", "opened", "openings_problems", "warnings"]

CALIBRATION_READ = (
    "Calibration outcomes were read under an earlier ranking lock: the premise of the guarantees, that everything else "
    "was fixed before calibration outcomes were read, no longer holds."
)
"""What takes from the guarantees of guards where selections were opened more than once."""

_SUBJECTS = {PREDICTION: "predictions", RANKING: "selections"}


def opened(document: Mapping[str, Any] | None, event: str, lock_digest: str) -> dict[str, Any]:
    """The openings after one event; the same where the last opening of its kind was under this lock.

    Args:
        document: ``openings.json`` so far; None if there is none.
        event: One of `EVENTS`.
        lock_digest: SHA-256 of the stored lock: of ``lock.json`` for predictions, ``ranking_lock.json`` for selections.

    Raises:
        ValueError: No such event, or selections before predictions.
    """
    if event not in EVENTS:
        raise ValueError(f"event {event!r}, not one of {list(EVENTS)}")
    entries = list((document or {"entries": []})["entries"])
    if event == RANKING and not _of(entries, PREDICTION):
        raise ValueError(f"{event!r} comes after {PREDICTION!r}, which has not happened")
    if not is_opened({"entries": entries}, event, lock_digest):
        entries.append({"number": len(entries) + 1, "event": event, "lock_digest": lock_digest})
    return {"entries": entries}


def num_openings(document: Mapping[str, Any], event: str, ledger: Mapping[str, Any] | None = None) -> int:
    """How often the test partition was opened for predictions or for selections, by this benchmark and before it.

    Args:
        document: ``openings.json``.
        event: One of `EVENTS`.
        ledger: The release's ``quality/ledger.json``, of which locks that `document` has not are counted; None
            leaves them out.
    """
    locks = locks_of(document, event)
    return len(locks) + sum(lock not in locks for lock in (locks_of(ledger, event) if ledger is not None else ()))


def is_opened(document: Mapping[str, Any], event: str, lock_digest: str) -> bool:
    """Whether the last opening of one of `EVENTS` was under this lock."""
    return locks_of(document, event)[-1:] == [lock_digest]


def openings_problems(
    document: Mapping[str, Any], *, lock_digest: str, ranking_lock_digest: str | None, has_results: bool
) -> list[Problem]:
    """What is wrong with the openings of a layer with these locks.

    Args:
        document: ``openings.json``, which conforms to its schema.
        lock_digest: SHA-256 of the stored ``lock.json``.
        ranking_lock_digest: SHA-256 of the stored ``ranking_lock.json``; None where there is none.
        has_results: Whether the layer has results, which take an opening of both kinds under its own locks.
    """
    entries = document["entries"]
    found = [
        Problem(f"/entries/{i}/number", str(i + 1), str(entry["number"]))
        for i, entry in enumerate(entries)
        if entry["number"] != i + 1
    ]
    for i, entry in enumerate(entries):
        before = entries[:i]
        same = _of(before, entry["event"])
        if entry["event"] == RANKING and not _of(before, PREDICTION):
            found.append(Problem(f"/entries/{i}/event", PREDICTION, RANKING))
        if same and same[-1]["lock_digest"] == entry["lock_digest"]:
            found.append(Problem(f"/entries/{i}/lock_digest", "another lock than before", "the same lock"))
    for event, digest in ((PREDICTION, lock_digest), (RANKING, ranking_lock_digest)):
        last = next((i for i in reversed(range(len(entries))) if entries[i]["event"] == event), None)
        if last is None:
            if has_results:
                found.append(Problem("/entries", f"{event}, since there are results", "no such entry"))
        elif entries[last]["lock_digest"] != digest:
            expected = "no entry, since there is no lock of it" if digest is None else digest
            found.append(Problem(f"/entries/{last}/lock_digest", expected, entries[last]["lock_digest"]))
    return found


def warnings(
    document: Mapping[str, Any],
    *,
    unlocked: Sequence[str] = (),
    changed: Sequence[str] = (),
    ledger: Mapping[str, Any] | None = None,
    has_calibration: bool = True,
) -> list[str]:
    """Sentences that every table of results carries; none where all is as it should be.

    Args:
        document: ``openings.json``.
        unlocked: Models whose predictions come from no locked checkpoint.
        changed: Files of checkpoints that are not those that were locked.
        ledger: The release's ``quality/ledger.json``; None leaves its openings out.
        has_calibration: Whether there are calibration groups, whose outcomes are read where selections are opened.
    """
    found: list[str] = []
    for event, subject in _SUBJECTS.items():
        count = num_openings(document, event, ledger)
        if count > 1:
            found.append(
                f"The test partition was opened {count} times for {subject}, each time under another lock than before: "
                "it is no longer an untouched test set, and results on it are optimistic."
            )
    if has_calibration and num_openings(document, RANKING, ledger) > 1:
        found.append(CALIBRATION_READ)
    if ledger is not None and num_test_openings(ledger) > 1:
        found.append(opening_sentence(ledger))
    found += [f"The checkpoint `{file}` is not the one that was locked." for file in sorted(changed)]
    found += [f"Predictions of {model} come from no locked checkpoint." for model in sorted(unlocked)]
    return found


def _of(entries: Sequence[Mapping[str, Any]], event: str) -> list[Mapping[str, Any]]:
    return [entry for entry in entries if entry["event"] == event]
