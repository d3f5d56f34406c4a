"""The ledger of a benchmark: accesses under the locks of the layer, and of both kinds where there are results."""

from __future__ import annotations

from typing import Any

import pytest

from branchdrive.contract.document import schema_mismatches
from branchdrive.quality.ledger import (
    PREDICTION_ACCESS,
    SELECTION_ACCESS,
    benchmark_mismatches,
    with_benchmark_access,
    with_round,
)

A, B, C = ("a" * 64, "b" * 64, "c" * 64)


def once() -> dict[str, Any]:
    return with_benchmark_access(with_benchmark_access(None, PREDICTION_ACCESS, A), SELECTION_ACCESS, B)


def pointers(document: dict[str, Any], **changes: Any) -> list[str | int]:
    facts: dict[str, Any] = {"lock_digest": A, "ranking_lock_digest": B, "has_results": True, **changes}
    return [found.location["pointer"] for found in benchmark_mismatches(document, **facts)]


def test_ledger_of_an_evaluation_conforms_and_is_sound() -> None:
    assert schema_mismatches(once(), "ledger.schema.json") == []
    assert schema_mismatches({"entries": []}, "ledger.schema.json") == []
    assert pointers(once()) == []
    assert pointers(with_benchmark_access(once(), PREDICTION_ACCESS, C)) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda e: e[1].update(number=3), ["/entries/1/number"]),
        (lambda e: e.reverse() or [x.update(number=i + 1) for i, x in enumerate(e)], ["/entries/0/event"]),
        (lambda e: e.append({**e[1], "number": 3}), ["/entries/2/lock_digest"]),
        (lambda e: e[0].update(lock_digest=C), ["/entries/0/lock_digest"]),
        (lambda e: e.clear(), ["/entries", "/entries"]),
        (lambda e: e.pop(), ["/entries"]),
        (
            lambda e: e.append(with_round(None, split_digest=A, thresholds_digest=B)["entries"][0] | {"number": 3}),
            ["/entries/2/event"],
        ),
    ],
)
def test_accesses_that_do_not_fit_are_found(change: Any, expected: list[str]) -> None:
    document = once()
    change(document["entries"])
    assert pointers(document) == expected


def test_access_without_a_lock_of_its_kind_is_found() -> None:
    assert pointers(once(), ranking_lock_digest=None) == ["/entries/1/lock_digest"]


def test_without_results_nothing_needs_to_be_accessed() -> None:
    assert pointers({"entries": []}, has_results=False, ranking_lock_digest=None) == []
