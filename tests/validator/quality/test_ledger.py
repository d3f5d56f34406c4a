"""The ledger: rounds in order, nothing new under equal digests, and every other look at the test partition counted."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.document import schema_mismatches
from branchdrive.quality.benchmark_openings import BENCHMARK_EVENTS, locks_of, with_benchmark
from branchdrive.quality.ledger import EVENTS, ledger_problems, num_test_openings, opened, recorded

A, B = ({"split_digest": split * 64, "thresholds_digest": fitted * 64} for split, fitted in ("ab", "cd"))


def edited(ledger: dict[str, Any], i: int, **fields: Any) -> dict[str, Any]:
    entries = [dict(entry) for entry in ledger["entries"]]
    entries[i] |= fields
    return {"entries": entries}


def test_a_first_round_fixes_validates_and_opens() -> None:
    ledger = opened(None, **A)
    assert ledger["entries"] == [
        {"number": 1, "event": "thresholds_fixed", "partition": "train", **A},
        {"number": 2, "event": "validation_evaluated", "partition": "val", **A},
        {"number": 3, "event": "test_opened", "partition": "test", **A},
    ]
    assert num_test_openings(ledger) == 1
    assert ledger_problems(ledger, **A) == []


def test_the_same_release_opens_nothing_new() -> None:
    once = opened(None, **A)
    assert opened(once, **A) == once


def test_other_digests_are_another_opening() -> None:
    first = opened(None, **A)
    second = opened(first, **B)
    assert second["entries"][:3] == first["entries"]
    assert num_test_openings(second) == 2
    assert ledger_problems(second, **B) == []
    assert len(first["entries"]) == 3


def test_going_back_to_digests_of_before_opens_nothing_more() -> None:
    both = opened(opened(None, **A), **B)
    assert opened(both, **A) == both
    assert num_test_openings(both) == 2
    assert ledger_problems(both, **A) == ledger_problems(both, **B) == []


def test_a_round_that_was_interrupted_goes_on() -> None:
    begun = recorded(None, "thresholds_fixed", **A)
    assert num_test_openings(begun) == 0
    assert opened(begun, **A) == opened(None, **A)


def test_a_round_that_was_broken_off_stays_in_the_ledger() -> None:
    ledger = opened(recorded(None, "thresholds_fixed", **A), **B)
    assert [entry["event"] for entry in ledger["entries"]] == ["thresholds_fixed", *EVENTS]
    assert ledger_problems(ledger, **B) == []


@pytest.mark.parametrize("event", ["validation_evaluated", "test_opened"])
def test_no_step_of_a_round_is_skipped(event: str) -> None:
    with pytest.raises(ValueError, match="has not happened under these digests"):
        recorded(None, event, **A)
    with pytest.raises(ValueError, match="has not happened under these digests"):
        recorded(opened(None, **A), event, **B)


def test_unknown_events_are_refused() -> None:
    with pytest.raises(ValueError, match="'calibration_opened', not one of"):
        recorded(None, "calibration_opened", **A)


@given(st.lists(st.sampled_from([A, B]), min_size=1, max_size=8))
def test_openings_are_the_pairs_of_digests(rounds: list[dict[str, str]]) -> None:
    ledger: dict[str, Any] | None = None
    for digests in rounds:
        ledger = opened(ledger, **digests)
    assert ledger is not None
    assert num_test_openings(ledger) == len({tuple(digests.values()) for digests in rounds})
    assert ledger_problems(ledger, **rounds[-1]) == []


def benchmark(*locks: str) -> dict[str, Any]:
    """Openings for predictions under locks that are named by a letter each."""
    return {"entries": [{"event": BENCHMARK_EVENTS[0], "lock_digest": lock * 64} for lock in locks]}


def test_openings_for_a_benchmark_are_no_part_of_a_round() -> None:
    begun = with_benchmark(recorded(None, "thresholds_fixed", **A), benchmark("e"))
    ledger = with_benchmark(opened(begun, **A), benchmark("f"))
    assert ledger is not None
    assert [entry["event"] for entry in ledger["entries"]] == [
        "thresholds_fixed", BENCHMARK_EVENTS[0], "validation_evaluated", "test_opened", BENCHMARK_EVENTS[0],
    ]  # fmt: skip
    assert schema_mismatches(ledger, "ledger.schema.json") == []
    assert ledger_problems(ledger, **A) == []
    assert num_test_openings(ledger) == 1
    assert opened(ledger, **A) == ledger
    assert [p.place for p in ledger_problems(edited(ledger, 1, number=7), **A)] == ["/entries/1/number"]


@pytest.mark.parametrize(
    ("known", "beside", "more", "after"),
    [
        ("", "", "", ""),
        ("", "", "efe", "efe"),
        ("efe", "", "efe", "efe"),
        ("ef", "", "efe", "efe"),
        ("e", "", "f", "ef"),
        ("", "e", "ef", "f"),
        ("e", "e", "ee", "e"),
    ],
)
def test_an_opening_for_a_benchmark_is_recorded_once(known: str, beside: str, more: str, after: str) -> None:
    ledger = with_benchmark(None, benchmark(*known))
    found = with_benchmark(ledger, benchmark(*more), beside=benchmark(*beside))
    assert ([] if found is None else locks_of(found, BENCHMARK_EVENTS[0])) == [letter * 64 for letter in after]
    assert found is None or [entry["number"] for entry in found["entries"]] == list(range(1, len(after) + 1))


def test_a_ledger_of_other_digests_is_stale() -> None:
    (problem,) = ledger_problems(opened(None, **A), **B)
    assert problem.place == "/entries"
    assert all(digest in problem.expected for digest in B.values())


def test_a_ledger_without_a_test_opening_is_not_finished() -> None:
    begun = recorded(None, "thresholds_fixed", **A)
    for unfinished in (begun, {"entries": []}):
        assert [(p.place, p.found) for p in ledger_problems(unfinished, **A)] == [("/entries", "no such entry")]


LIES: dict[str, tuple[dict[str, Any], str]] = {
    "a number": (edited(opened(None, **A), 1, number=5), "/entries/1/number"),
    "a partition": (edited(opened(None, **A), 0, partition="val"), "/entries/0/partition"),
    "thresholds that changed after validation": (edited(opened(None, **B), 2, **A), "/entries/2/event"),
    "a first opening that was erased": (
        {"entries": [dict(entry, number=i + 1) for i, entry in enumerate(opened(None, **A)["entries"][1:])]},
        "/entries/0/event",
    ),
    "a round twice": (
        {"entries": [dict(entry, number=i + 1) for i, entry in enumerate(opened(None, **A)["entries"] * 2)]},
        "/entries/3/event",
    ),
}


@pytest.mark.parametrize("case", LIES)
def test_a_ledger_that_was_tampered_with_is_found(case: str) -> None:
    ledger, place = LIES[case]
    assert [problem.place for problem in ledger_problems(ledger, **A)] == [place]
