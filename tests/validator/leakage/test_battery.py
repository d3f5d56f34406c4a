"""The paper's battery: what each classifier sees, and what it finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from tests.validator.leakage.classifiers import Regression, Undecided
from tests.validator.leakage.replays import changed, replay_inputs
from tests.validator.leakage.test_inputs import without_nominal_replay

from branchdrive.leakage.battery import ways
from branchdrive.leakage.classifier import SequenceClassifier, SequenceScores, SequenceTask, Unavailable
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.protocol import CONTROLS, SEQUENCE_TESTS, TESTS, BatteryProtocol

QUICK = BatteryProtocol(num_permutations=1_999, num_resamples=100)
CLEAN = replay_inputs(60, seed=2)


def score(
    inputs: ReplayInputs, name: str, *, way: int = 0, classifier: SequenceClassifier | None = None, seed: int = 3
) -> dict[str, Any]:
    parts = ways(inputs)[way].parts(seed=seed, protocol=QUICK, classifier=classifier or Regression())
    compute = next(part.compute for part in parts if part.name == name)
    assert compute is not None
    found: dict[str, Any] = compute()["score"]
    return found


def p_values(found: dict[str, Any]) -> tuple[float, float]:
    return found["p_accuracy"], found["p_log_likelihood"]


def reasons(inputs: ReplayInputs, way: int, classifier: SequenceClassifier | Unavailable) -> dict[str, str]:
    return {part.name: part.reason for part in ways(inputs)[way].parts(seed=0, protocol=QUICK, classifier=classifier)}


def test_it_runs_on_all_actions_and_on_interventions() -> None:
    inputs = changed(CLEAN, **without_nominal_replay(CLEAN, [0, 2, 7]))
    first, second = ways(inputs)
    assert (first.name, first.num_groups) == ("5-way", {"train": 35, "val": 12, "test": 10})
    assert (second.name, second.num_groups) == ("4-way", {"train": 36, "val": 12, "test": 12})


@pytest.mark.parametrize("way", [0, 1])
def test_controls_come_out_as_they_must(way: int) -> None:
    explicit, offset, random = (score(CLEAN, name, way=way) for name in CONTROLS)
    assert explicit["accuracy"] == 1.0
    assert offset["accuracy"] > 0.95
    assert p_values(explicit) == p_values(offset) == (0.0005, 0.0005)
    assert min(p_values(random)) > 0.001


@pytest.mark.parametrize("name", TESTS)
def test_replays_that_tell_nothing_are_at_chance(name: str) -> None:
    assert min(p_values(score(CLEAN, name))) > 0.005


@pytest.mark.parametrize(
    ("source", "place", "found"),
    [
        ("availability", np.s_[:, 2, 0], {"availability"}),
        ("discrepancy", np.s_[:, 2, 4], {"discrepancy"}),
        ("ego", np.s_[:, 2, 10:, 3], {"ego", "ego_controls"}),
        ("controls", np.s_[:, 2, 60:, 1], {"controls", "ego_controls"}),
    ],
)
def test_each_test_finds_what_leaks_in_what_it_sees(source: str, place: Any, found: set[str]) -> None:
    values = np.array(getattr(CLEAN, source))
    values[place] = 0.0 if source == "availability" else values[place] + 0.5
    leaking = changed(CLEAN, **{source: values})
    assert {name for name in TESTS if p_values(score(leaking, name))[1] < 0.005} == found


def test_a_missing_row_is_no_number_that_is_learned() -> None:
    values = np.array(CLEAN.discrepancy)
    values[:, 1] = np.nan
    values[:5, 2, 0] = np.inf
    found = score(changed(CLEAN, discrepancy=values), "discrepancy")
    assert np.isfinite(found["log_likelihood"])


@given(
    hnp.arrays(np.float64, (20, 5, 12), elements=st.sampled_from([np.nan, np.inf, 0.0, 1.0, 1e308, 5e-324, 1e-160])),
    hnp.arrays(np.float64, (20, 5, 80, 3), elements=st.sampled_from([np.nan, 0.0, 1.0, -1e308, 1e308])),
)
@settings(max_examples=15)
def test_no_number_breaks_it(discrepancy: NDArray[np.float64], controls: NDArray[np.float64]) -> None:
    inputs = changed(replay_inputs(20, seed=0), discrepancy=discrepancy, controls=controls)
    for name in (*CONTROLS, "discrepancy", "controls"):
        found = score(inputs, name, classifier=Undecided())
        assert np.isfinite([found["accuracy"], found["log_likelihood"]]).all()


def test_bit_identical_replays_leave_nothing_to_tell() -> None:
    inputs = replay_inputs(20, seed=0, noise=0.0)
    same = changed(inputs, discrepancy=np.zeros_like(inputs.discrepancy))
    for name in TESTS:
        found = score(same, name)
        assert found["identical"]
        assert found["accuracy"] == pytest.approx(1 / 5)
    assert score(same, "explicit_label")["accuracy"] == score(same, "synthetic_offset")["accuracy"] == 1.0


def test_a_classifier_that_is_undecided_is_found_out() -> None:
    assert score(CLEAN, "ego", classifier=Undecided())["identical"]


def test_renamed_groups_and_drives_do_not_matter_but_differences_between_replays_do() -> None:
    drive = np.random.default_rng(0).normal(size=(60, 1, 16, 6)) * 2.0**4
    moved = changed(CLEAN, group_ids=tuple(f"x{index:05d}" for index in range(60)), ego=CLEAN.ego + drive)
    assert score(moved, "ego")["log_likelihood"] == pytest.approx(score(CLEAN, "ego")["log_likelihood"], rel=1e-6)


def test_sequence_classifiers_see_no_test_group_while_they_learn() -> None:
    seen: list[SequenceTask] = []

    class Spy(Undecided):
        def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
            seen.append(task)
            return super().__call__(task, seed=seed)

    other = np.array(CLEAN.ego)
    other[CLEAN.in_partition("test")] += np.random.default_rng(1).normal(size=other[CLEAN.in_partition("test")].shape)
    for inputs in (CLEAN, changed(CLEAN, ego=other)):
        score(inputs, "ego", classifier=Spy())
    np.testing.assert_array_equal(seen[0].train, seen[1].train)
    np.testing.assert_array_equal(seen[0].val, seen[1].val)
    assert (seen[0].test != seen[1].test).any()
    assert seen[0].test.shape == (12, 5, 16, 6)


def test_what_cannot_run_says_why() -> None:
    assert reasons(CLEAN, 0, Unavailable("because")) == {
        name: "because" if name in SEQUENCE_TESTS else "" for name in (*CONTROLS, *TESTS)
    }
    lonely = changed(CLEAN, **without_nominal_replay(CLEAN, list(range(60))))
    reason = "no group of `train` with an independent nominal replay"
    assert set(reasons(lonely, 0, Regression()).values()) == {reason}
    assert set(reasons(lonely, 1, Regression()).values()) == {""}
    unstopped = changed(CLEAN, partitions=("train", "test") * 30)
    assert reasons(unstopped, 1, Regression()) == {
        name: "no group of `val`" if name in SEQUENCE_TESTS else "" for name in (*CONTROLS, *TESTS)
    }
