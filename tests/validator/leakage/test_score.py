"""Held-out scores of classifiers, and the statuses that follow from them."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import log_softmax
from scipy.stats import kstest

from branchdrive.leakage.protocol import CONTROLS, TESTS, BatteryProtocol
from branchdrive.leakage.score import Score, held_out_score, judged_battery
from branchdrive.statistics.holm import holm

Array = NDArray[np.float64]


def scored(scores: Array, seed: int = 1, num_permutations: int = 999) -> Score:
    return held_out_score(scores, seed=seed, num_permutations=num_permutations, num_resamples=500, atol=1e-9)


def random_scores(num_groups: int, num_actions: int, seed: int) -> Array:
    logits = np.random.default_rng(seed).normal(size=(num_groups, num_actions, num_actions))
    return np.asarray(log_softmax(logits, axis=2))


def test_who_knows_scores_one() -> None:
    found = scored(np.log(np.broadcast_to(np.eye(4) * 0.96 + 0.01, (8, 4, 4))))
    assert found.accuracy == 1.0
    assert found.accuracy_interval == (1.0, 1.0)
    assert found.log_likelihood == pytest.approx(np.log(0.97))
    assert (found.p_accuracy, found.p_log_likelihood, found.identical) == (0.001, 0.001, False)


@pytest.mark.parametrize("levelled", [False, True])
def test_who_tells_nothing_apart_scores_chance_and_is_found_out(levelled: bool) -> None:
    scores = random_scores(9, 5, seed=0)[:, :1]
    scores = np.broadcast_to(np.full_like(scores, -np.log(5)) if levelled else scores, (9, 5, 5))
    found = scored(scores)
    assert found.identical
    assert found.accuracy == pytest.approx(1 / 5)
    assert (found.p_accuracy, found.p_log_likelihood) == (1.0, 1.0)


def test_who_draws_permutations_decides_no_bit() -> None:
    scores, drawn = random_scores(9, 5, seed=3), []

    def elsewhere(function: Any, subject: Any, ranges: Any) -> Any:
        drawn.extend(map(len, ranges))
        copies = {i: function(pickle.loads(pickle.dumps(subject)), ranges[i]) for i in range(len(ranges))[::-1]}
        return [copies[i] for i in range(len(ranges))]

    numbers = {"seed": 4, "num_permutations": 1_234, "num_resamples": 50, "atol": 1e-9}
    assert held_out_score(scores, **numbers, draw=elsewhere) == held_out_score(scores, **numbers)
    assert drawn == [1, 500, 500, 234]


def test_rounding_does_not_tell_rows_apart() -> None:
    scores = np.array(np.broadcast_to(random_scores(9, 1, seed=0)[:, :, :1] - np.log(5), (9, 5, 5)))
    assert scored(scores + 1e-12 * random_scores(9, 5, seed=1)).identical
    assert not scored(scores + 1e-6 * random_scores(9, 5, seed=1)).identical


def test_likelihood_sees_what_accuracy_misses() -> None:
    rng = np.random.default_rng(2)
    logits = rng.normal(size=(60, 6, 6)) * 0.05
    logits[:, :, 0] += 3.0  # every row is taken for the first action
    logits[:, np.arange(6), np.arange(6)] += 0.1
    found = scored(np.asarray(log_softmax(logits, axis=2)))
    assert found.accuracy == pytest.approx(1 / 6)
    assert found.p_accuracy == 1.0
    assert found.p_log_likelihood == 0.001


def test_p_is_that_of_all_permutations() -> None:
    scores = random_scores(1, 3, seed=4)
    orders = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
    every = np.array([np.mean([scores[0, row, action] for action, row in enumerate(order)]) for order in orders])
    exact = (every >= every[0] - 1e-12).mean()
    assert scored(scores, num_permutations=9_999).p_log_likelihood == pytest.approx(exact, abs=0.02)


def test_p_of_scores_that_know_nothing_is_uniform() -> None:
    p = [scored(random_scores(12, 4, seed), seed=seed, num_permutations=199).p_log_likelihood for seed in range(300)]
    assert kstest(p, "uniform").pvalue > 0.01


def test_the_interval_is_that_of_resampled_groups() -> None:
    scores = np.log(np.broadcast_to(np.eye(2) * 0.8 + 0.1, (400, 2, 2))).copy()
    scores[:100] = scores[:100, ::-1]
    found = scored(scores)
    assert found.accuracy == 0.75
    half = 1.96 * np.sqrt(0.75 * 0.25 / 400)
    np.testing.assert_allclose(found.accuracy_interval, [0.75 - half, 0.75 + half], atol=0.01)


def test_the_same_seed_gives_the_same_score() -> None:
    scores = random_scores(10, 4, seed=5)
    assert scored(scores) == scored(scores)
    assert scored(scores) != scored(scores, seed=2)


@pytest.mark.parametrize(
    "scores", [np.zeros((0, 3, 3)), np.zeros((3, 3)), np.zeros((2, 3, 4)), np.full((2, 3, 3), -np.inf)]
)
def test_what_is_no_score_is_refused(scores: Array) -> None:
    with pytest.raises(ValueError, match="scores have shape"):
        scored(scores)


PROTOCOL = BatteryProtocol(num_permutations=9_999)


def result(name: str, p: float | None, identical: bool = False) -> dict[str, Any]:
    if p is None:
        return {"name": name, "score": None, "training": None, "reason": "because"}
    measured = {"accuracy": 0.2, "accuracy_interval": [0.1, 0.3], "log_likelihood": -1.6, "identical": identical}
    return {"name": name, "score": {**measured, "p_accuracy": p, "p_log_likelihood": p}, "training": None}


def way(p: dict[str, float | None] | None = None, identical: str = "", num_actions: int = 5) -> dict[str, Any]:
    wanted: dict[str, float | None] = {"explicit_label": 1e-4, "synthetic_offset": 1e-4, **(p or {})}
    return {
        "name": f"{num_actions}-way",
        "num_actions": num_actions,
        "num_groups": {"train": 3, "val": 1, "test": 2},
        "controls": [result(name, wanted.get(name, 0.5)) for name in CONTROLS],
        "tests": [result(name, wanted.get(name, 0.5), name == identical) for name in TESTS],
    }


def statuses(*found: dict[str, Any], protocol: BatteryProtocol = PROTOCOL) -> list[list[str]]:
    return [[test["status"] for test in way["tests"]] for way in judged_battery(found, protocol)["ways"]]


def test_nothing_found_passes_where_controls_hold() -> None:
    battery = judged_battery([way(), way(num_actions=4)], PROTOCOL)
    assert battery["trusted"]
    assert [found["chance"] for found in battery["ways"]] == [0.2, 0.25]
    assert battery["family"][:3] == [
        "5-way/availability/accuracy",
        "5-way/availability/log_likelihood",
        "5-way/discrepancy/accuracy",
    ]
    assert len(battery["family"]) == 20
    assert statuses(way(), way()) == [["pass"] * 5] * 2


def test_the_family_is_of_both_ways() -> None:
    battery = judged_battery([way({"ego": 0.003}), way({"controls": 0.0001})], PROTOCOL)
    expected = holm([0.003] * 2 + [0.0001] * 2 + [0.5] * 16)
    assert battery["ways"][0]["tests"][2]["p_adjusted"] == {"accuracy": expected[0], "log_likelihood": expected[1]}
    assert [test["status"] for test in battery["ways"][0]["tests"]] == ["pass"] * 5
    assert [test["status"] for test in battery["ways"][1]["tests"]] == ["pass"] * 3 + ["fail", "pass"]


def test_identical_scores_are_inconclusive_and_never_a_pass() -> None:
    assert statuses(way({"ego": 1.0}, identical="ego"), way())[0] == ["pass", "pass", "inconclusive", "pass", "pass"]


@pytest.mark.parametrize("p", [{"explicit_label": 0.5}, {"synthetic_offset": 0.002}, {"random_label": 0.001}])
def test_a_control_gone_astray_leaves_its_way_inconclusive(p: dict[str, float | None]) -> None:
    battery = judged_battery([way({**p, "ego": 1e-4}), way()], PROTOCOL)
    assert not battery["trusted"]
    assert [found["trusted"] for found in battery["ways"]] == [False, True]
    assert {test["status"] for test in battery["ways"][0]["tests"]} == {"inconclusive"}
    assert next(iter(p)) in battery["ways"][0]["tests"][0]["reason"]


def test_what_did_not_run_is_no_member_of_the_family() -> None:
    battery = judged_battery([way(dict.fromkeys((*CONTROLS, *TESTS))), way({"ego": None})], PROTOCOL)
    assert battery["trusted"]
    assert [found["trusted"] for found in battery["ways"]] == [None, True]
    assert len(battery["family"]) == 8
    assert [test["status"] for test in battery["ways"][0]["tests"]] == ["not_run"] * 5
    assert battery["ways"][1]["tests"][2]["status"] == "not_run"
    assert battery["ways"][1]["tests"][2]["reason"] == "because"


def test_nothing_ran_is_not_trusted() -> None:
    nothing = way(dict.fromkeys((*CONTROLS, *TESTS)))
    battery = judged_battery([nothing, nothing], PROTOCOL)
    assert (battery["trusted"], battery["family"]) == (False, [])


def test_too_few_permutations_to_fail_are_inconclusive() -> None:
    found = statuses(way(), way(), protocol=BatteryProtocol(num_permutations=99))
    assert found == [["inconclusive"] * 5] * 2


def test_judging_twice_changes_nothing() -> None:
    once = judged_battery([way({"ego": 1e-4, "controls": None}), way(identical="ego")], PROTOCOL)
    assert judged_battery(once["ways"], PROTOCOL) == once
