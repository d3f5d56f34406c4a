"""Ledgers: rounds in order, nothing new under equal digests, and every other look at the test partition counted."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.document import schema_mismatches
from branchdrive.quality.ledger import (
    PREDICTION_ACCESS,
    RELEASE_ACCESS,
    ROUND,
    SELECTION_ACCESS,
    accesses,
    merged,
    order_mismatches,
    release_mismatches,
    with_benchmark_access,
    with_round,
)

A, B = ({"split_digest": split * 64, "thresholds_digest": fitted * 64} for split, fitted in ("ab", "cd"))


def ledger(steps: str) -> dict[str, Any] | None:
    """A ledger of steps, each a letter that stands for its digests: capital for a round, small for predictions."""
    found = None
    for step in steps:
        digest = step.lower() * 64
        if step.isupper():
            found = with_round(found, split_digest=digest, thresholds_digest=digest)
        else:
            found = with_benchmark_access(found, PREDICTION_ACCESS, digest)
    return found


def begun(**digests: str) -> dict[str, Any]:
    return {"entries": with_round(None, **digests)["entries"][:1]}


def numbered(*entries: dict[str, Any]) -> dict[str, Any]:
    return {"entries": [entry | {"number": i} for i, entry in enumerate(entries, start=1)]}


def test_a_first_round_fixes_validates_and_accesses() -> None:
    once = with_round(None, **A)
    assert once["entries"] == [{"number": i, "event": event, **A} for i, event in enumerate(ROUND, start=1)]
    assert len(accesses(RELEASE_ACCESS, once)) == 1
    assert list(release_mismatches(once, **A)) == []


def test_a_round_that_was_interrupted_goes_on() -> None:
    assert accesses(RELEASE_ACCESS, begun(**A)) == set()
    assert with_round(begun(**A), **A) == with_round(None, **A)


def test_a_round_that_was_broken_off_stays_in_the_ledger() -> None:
    found = with_round(begun(**A), **B)
    assert [entry["event"] for entry in found["entries"]] == [ROUND[0], *ROUND]
    assert list(release_mismatches(found, **B)) == []


@given(st.lists(st.sampled_from([A, B]), min_size=1, max_size=8))
def test_accesses_are_the_pairs_of_digests(rounds: list[dict[str, str]]) -> None:
    found: dict[str, Any] | None = None
    for digests in rounds:
        before, found = found, with_round(found, **digests)
        assert found["entries"][: len(before["entries"]) if before else 0] == (before["entries"] if before else [])
        assert with_round(found, **digests) == found
    assert found is not None
    assert accesses(RELEASE_ACCESS, found) == {tuple(digests.values()) for digests in rounds}
    assert all(list(release_mismatches(found, **digests)) == [] for digests in rounds)


def test_accesses_for_a_benchmark_are_no_part_of_a_round() -> None:
    between = with_round(with_benchmark_access(begun(**A), PREDICTION_ACCESS, "e" * 64), **A)
    found = with_benchmark_access(between, SELECTION_ACCESS, "f" * 64)
    assert [entry["event"] for entry in found["entries"]] == [
        ROUND[0], PREDICTION_ACCESS, *ROUND[1:], SELECTION_ACCESS,
    ]  # fmt: skip
    assert schema_mismatches(found, "ledger.schema.json") == []
    assert list(release_mismatches(found, **A)) == []
    assert with_round(found, **A) == found


def test_another_lock_is_another_access_and_a_lock_of_before_is_none() -> None:
    assert ledger("efe") == ledger("ef")
    assert accesses(PREDICTION_ACCESS, ledger("ef"), ledger("fg")) == {(name * 64,) for name in "efg"}


def test_selections_come_after_predictions() -> None:
    with pytest.raises(ValueError, match="comes after 'test_accessed_for_predictions'"):
        with_benchmark_access(ledger("A"), SELECTION_ACCESS, "e" * 64)
    with pytest.raises(ValueError, match="'peeked', not one of"):
        with_benchmark_access(None, "peeked", "e" * 64)


@pytest.mark.parametrize(
    ("first", "second", "beside", "both"),
    [
        ("", "", "", ""),
        ("A", "", "", "A"),
        ("", "A", "", "A"),
        ("A", "AB", "", "AB"),
        ("AB", "A", "", "AB"),
        ("AB", "AC", "", "ABC"),
        ("AB", "CB", "", "ABC"),
        ("AB", "ACBD", "", "ABCD"),
        ("Ae", "Ae", "", "Ae"),
        ("A", "Ae", "", "Ae"),
        ("Ae", "ABf", "", "AeBf"),
        ("A", "ef", "", "Aef"),
        ("A", "ef", "e", "Af"),
        ("e", "e", "e", "e"),
    ],
)
def test_two_ledgers_are_one(first: str, second: str, beside: str, both: str) -> None:
    assert merged(ledger(first), ledger(second), beside=ledger(beside)) == ledger(both)


def test_a_ledger_of_other_digests_is_stale() -> None:
    (found,) = release_mismatches(with_round(None, **A), **B)
    assert found.location == {"pointer": "/entries"}
    assert all(digest in found.expected for digest in B.values())


def test_a_ledger_without_a_test_access_is_not_finished() -> None:
    for unfinished in (begun(**A), {"entries": []}):
        (found,) = release_mismatches(unfinished, **A)
        assert (found.location, found.found) == ({"pointer": "/entries"}, "no such entry")


FIXED, VALIDATED, ACCESSED = with_round(None, **A)["entries"]
PREDICTED, SELECTED = with_benchmark_access(ledger("e"), SELECTION_ACCESS, "f" * 64)["entries"]
LIES: dict[str, tuple[dict[str, Any], str]] = {
    "a number": ({"entries": [FIXED, VALIDATED | {"number": 5}, ACCESSED]}, "/entries/1/number"),
    "thresholds that changed after validation": (numbered(FIXED, VALIDATED, ACCESSED | B), "/entries/2/event"),
    "a first step that was erased": (numbered(VALIDATED, ACCESSED), "/entries/0/event"),
    "a round twice": (numbered(*[FIXED, VALIDATED, ACCESSED] * 2), "/entries/3/event"),
    "selections without predictions": (numbered(FIXED, SELECTED), "/entries/1/event"),
    "a lock twice": (numbered(PREDICTED, SELECTED, PREDICTED), "/entries/2/lock_digest"),
}


@pytest.mark.parametrize("case", LIES)
def test_a_ledger_that_was_tampered_with_is_found(case: str) -> None:
    document, pointer = LIES[case]
    assert [found.location["pointer"] for found in order_mismatches(document)][:1] == [pointer]
