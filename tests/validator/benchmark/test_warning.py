"""What tables of results warn of: a sentence for everything that is not as it should be."""

from __future__ import annotations

from typing import Any

from branchdrive.benchmark.warning import CALIBRATION_READ, warnings
from branchdrive.quality.ledger import PREDICTION_ACCESS, SELECTION_ACCESS, with_benchmark_access, with_round

A, B, C = ("a" * 64, "b" * 64, "c" * 64)


def evaluated(prediction_lock: str = A, ranking_lock: str = B) -> dict[str, Any]:
    predicted = with_benchmark_access(None, PREDICTION_ACCESS, prediction_lock)
    return with_benchmark_access(predicted, SELECTION_ACCESS, ranking_lock)


def test_one_access_of_each_kind_warns_of_nothing() -> None:
    assert warnings(evaluated()) == []
    assert warnings({"entries": []}, of_release=evaluated()) == []
    assert warnings(evaluated(), of_release=with_round(None, split_digest=A, thresholds_digest=A)) == []


def test_another_lock_is_another_access_and_every_table_says_so() -> None:
    (sentence,) = warnings(with_benchmark_access(evaluated(), PREDICTION_ACCESS, C))
    assert "accessed 2 times for predictions, each time under another lock" in sentence
    sentence, premise = warnings(with_benchmark_access(evaluated(), SELECTION_ACCESS, C))
    assert premise == CALIBRATION_READ
    assert "accessed 2 times for selections" in sentence


def test_accesses_of_the_release_are_counted_unless_they_are_the_same() -> None:
    of_release = with_benchmark_access(with_benchmark_access(None, PREDICTION_ACCESS, C), PREDICTION_ACCESS, A)
    (sentence,) = warnings(evaluated(), of_release=of_release)
    assert "accessed 2 times for predictions" in sentence


def test_selections_of_an_earlier_benchmark_take_from_the_guarantees() -> None:
    of_release = evaluated(C, C)
    sentence, other, read = warnings(evaluated(), of_release=of_release)
    assert "2 times for predictions" in sentence and "2 times for selections" in other
    assert read == CALIBRATION_READ
    assert warnings(evaluated(), of_release=of_release, has_calibration=False) == [sentence, other]


def test_changed_checkpoints_unlocked_runs_and_test_reuse_are_told() -> None:
    of_release = with_round(with_round(None, split_digest=A, thresholds_digest=A), split_digest=B, thresholds_digest=B)
    found = warnings(evaluated(), unlocked=["Y", "X"], changed=["checkpoints/M3.safetensors"], of_release=of_release)
    assert len(found) == 4
    assert "accessed 2 times, under different splits or thresholds" in found[0]
    assert found[1] == "The checkpoint `checkpoints/M3.safetensors` is not the one that was locked."
    assert found[2:] == [f"Predictions of {model} come from no locked checkpoint." for model in "XY"]
