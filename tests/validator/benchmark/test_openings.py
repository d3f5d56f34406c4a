"""Openings: one for each lock, in order, and a sentence for everything that is not as it should be."""

from __future__ import annotations

from typing import Any

import pytest

from branchdrive.benchmark.openings import CALIBRATION_READ, EVENTS, num_openings, opened, openings_problems, warnings
from branchdrive.contract.document import schema_mismatches
from branchdrive.quality.benchmark_openings import with_benchmark

PREDICTION, RANKING = EVENTS
A, B, C = ("a" * 64, "b" * 64, "c" * 64)


def once() -> dict[str, Any]:
    return opened(opened(None, PREDICTION, A), RANKING, B)


def problems(document: dict[str, Any], **changes: Any) -> list[str]:
    facts: dict[str, Any] = {"lock_digest": A, "ranking_lock_digest": B, "has_results": True, **changes}
    return [problem.place for problem in openings_problems(document, **facts)]


def test_openings_conform_and_are_sound() -> None:
    assert schema_mismatches(once(), "openings.schema.json") == []
    assert schema_mismatches({"entries": []}, "openings.schema.json") == []
    assert problems(once()) == []
    assert warnings(once()) == []


def test_looking_again_under_the_same_lock_opens_nothing() -> None:
    assert opened(opened(once(), PREDICTION, A), RANKING, B) == once()


def test_another_lock_is_another_opening_and_every_table_says_so() -> None:
    twice = opened(once(), PREDICTION, C)
    assert num_openings(twice, PREDICTION) == 2
    (sentence,) = warnings(twice)
    assert "opened 2 times for predictions, each time under another lock than before" in sentence
    sentence, premise = warnings(opened(once(), RANKING, C))
    assert premise == CALIBRATION_READ
    assert "opened 2 times for selections" in sentence
    assert num_openings(opened(twice, PREDICTION, A), PREDICTION) == 3


def test_openings_on_the_ledger_are_counted_unless_they_are_the_same() -> None:
    ledger = with_benchmark(None, opened(opened(None, PREDICTION, C), PREDICTION, A))
    assert num_openings(once(), PREDICTION, ledger) == 2
    assert num_openings(once(), RANKING, ledger) == 1
    (sentence,) = warnings(once(), ledger=ledger)
    assert "opened 2 times for predictions, each time under another lock than before" in sentence
    assert warnings({"entries": []}, ledger=with_benchmark(None, once())) == []


def test_selections_on_the_ledger_take_from_the_guarantees() -> None:
    ledger = with_benchmark(None, opened(opened(None, PREDICTION, C), RANKING, C))
    sentence, other, read = warnings(once(), ledger=ledger)
    assert "2 times for predictions" in sentence and "2 times for selections" in other
    assert read == CALIBRATION_READ
    assert warnings(once(), ledger=ledger, has_calibration=False) == [sentence, other]


def test_selections_come_after_predictions() -> None:
    with pytest.raises(ValueError, match="comes after"):
        opened(None, RANKING, B)
    with pytest.raises(ValueError, match="not one of"):
        opened(None, "peeked", A)


@pytest.mark.parametrize(
    ("change", "places"),
    [
        (lambda e: e[1].update(number=3), ["/entries/1/number"]),
        (lambda e: e.reverse() or [x.update(number=i + 1) for i, x in enumerate(e)], ["/entries/0/event"]),
        (lambda e: e.append({**e[1], "number": 3}), ["/entries/2/lock_digest"]),
        (lambda e: e[0].update(lock_digest=C), ["/entries/0/lock_digest"]),
        (lambda e: e.clear(), ["/entries", "/entries"]),
        (lambda e: e.pop(), ["/entries"]),
    ],
)
def test_openings_that_do_not_fit_are_found(change: Any, places: list[str]) -> None:
    document = once()
    change(document["entries"])
    assert problems(document) == places


def test_opening_without_a_lock_of_its_kind_is_found() -> None:
    assert problems(once(), ranking_lock_digest=None) == ["/entries/1/lock_digest"]


def test_without_results_nothing_needs_to_be_opened() -> None:
    assert problems({"entries": []}, has_results=False, ranking_lock_digest=None) == []


def test_changed_checkpoints_unlocked_runs_and_test_reuse_are_told() -> None:
    entry, other = ({"event": "test_opened", "split_digest": d, "thresholds_digest": d} for d in ("a", "b"))
    found = warnings(
        once(), unlocked=["Y", "X"], changed=["checkpoints/M3.safetensors"], ledger={"entries": [entry, other]}
    )
    assert len(found) == 4
    assert "opened 2 times, under different splits or thresholds" in found[0]
    assert found[1] == "The checkpoint `checkpoints/M3.safetensors` is not the one that was locked."
    assert found[2:] == [f"Predictions of {model} come from no locked checkpoint." for model in "XY"]
    assert warnings(once(), ledger={"entries": [entry]}) == []
