"""Variables and categories that tell an outcome."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from branchdrive.leakage.outcome import num_alone, outcome_codes, revealed_outcomes


def outcomes(num_groups: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    return rng.normal(size=(num_groups, 4, 1)) ** 2 + 0.1, np.ones((num_groups, 4, 1), np.bool_)


@pytest.mark.parametrize(
    ("hidden", "how"),
    [
        (lambda y: y[:, 2] + 1e-3 * np.sin(np.arange(len(y))), "the value, at action 2,"),
        (lambda y: np.round(y[:, 1], 2), "the value, at action 1,"),
        (lambda y: -(y[:, 3] ** 2), "the value, at action 3,"),
        (lambda y: y.min(axis=1), "the least value"),
        (lambda y: y.mean(axis=1), "the mean value"),
        (lambda y: np.exp(y.max(axis=1)), "the largest value"),
        (lambda y: y.argmax(axis=1), "the place of the largest value"),
        (lambda y: 10.0 - y.argmin(axis=1), "the place of the least value"),
    ],
)
def test_a_variable_that_tells_an_outcome_is_found(hidden: Callable[[np.ndarray], np.ndarray], how: str) -> None:
    targets, available = outcomes()
    others = np.random.default_rng(12).normal(size=(60, 5))
    variables = np.concatenate([others, np.asarray(hidden(targets[..., 0]), float)[:, None]], axis=1)
    (found,) = revealed_outcomes(variables, list("abcdef"), targets, available)
    assert (found.variable, found.target) == (5, 0)
    assert found.how.endswith(how)


def test_a_speed_may_follow_an_outcome() -> None:
    targets, available = outcomes()
    noisy = targets[:, 0] + 0.2 * np.random.default_rng(13).normal(size=(60, 1))
    assert revealed_outcomes(noisy, ["a"], targets, available) == []


def test_outcomes_of_few_groups_or_of_few_places_are_not_examined() -> None:
    targets, available = outcomes(11)
    assert revealed_outcomes(targets[:, 0], ["a"], targets, available) == []
    targets, available = outcomes()
    targets[:, 2] += 100.0
    assert revealed_outcomes(targets[..., 0].argmax(axis=1)[:, None] * 1.0, ["a"], targets, available) == []


def test_an_outcome_that_follows_from_the_motion_is_no_secret() -> None:
    targets, available = outcomes()
    copies = np.repeat(targets[:, 0], 3, axis=1)
    for columns, hidden in (
        (["a", "b", "state speed_mps"], []),
        (["a", "b", "c"], []),
        (["a", "a", "b"], [0, 1, 2]),
    ):
        assert [leak.variable for leak in revealed_outcomes(copies, columns, targets, available)] == hidden


def test_noise_may_order_equal_outcomes_as_it_likes() -> None:
    targets, available = outcomes()
    targets[::3, 1] = 0.0
    noisy = targets[:, 1] + 1e-4 * np.random.default_rng(14).normal(size=(60, 1))
    (leak,) = revealed_outcomes(noisy, ["a"], targets, available)
    assert leak.how.endswith("the value, at action 1,")


def test_outcomes_follow_from_the_given_motion_alone() -> None:
    targets, available = outcomes()
    copies = np.repeat(targets[:, 0], 3, axis=1)
    none, speed = (np.zeros((60, 0)), []), (targets[:, 0], ["state speed_mps"])
    assert len(revealed_outcomes(copies, ["a", "b", "c"], targets, available, motion=none)) == 3
    assert revealed_outcomes(copies, ["a", "b", "c"], targets, available, motion=speed) == []


def test_counts_tell_as_much_as_their_ties_let_them() -> None:
    targets, available = outcomes()
    count = np.argsort(np.argsort(targets[:, 1, 0]))[:, None] * 12.0 // 60
    assert revealed_outcomes(count, ["a"], targets, available) == []
    (leak,) = revealed_outcomes(count, ["a"], targets, available, max_correlation=0.98)
    assert leak.how.endswith("the value, at action 1,")


def test_what_is_not_there_is_below_every_number() -> None:
    targets, available = outcomes()
    hidden = np.where(targets[:, 2] > targets[:, 2].min(), targets[:, 2], -np.inf)
    assert len(revealed_outcomes(hidden, ["a"], targets, available)) == 1


def places() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets of 30 groups in which every action is the best in ten, and its number ``[groups]``."""
    best = np.arange(30) % 3
    targets = np.random.default_rng(15).uniform(size=(30, 3, 1))
    targets[np.arange(30), best, 0] += 2.0
    return best, targets, np.ones((30, 3, 1), np.bool_)


@pytest.mark.parametrize("num_kinds", [3, 15])
def test_categories_that_share_their_best_action_are_a_code(num_kinds: int) -> None:
    best, targets, available = places()
    ((target, how),) = outcome_codes([f"kind {n % num_kinds}" for n in range(30)], targets, available)
    assert (target, how[:10], best[num_kinds]) == (0, f"{num_kinds} values, "[:10], 0)
    assert how.endswith("in 30 of 30 groups, to the place of the largest value")


@pytest.mark.parametrize(
    "categories",
    [
        [f"kind {n % 4}" for n in range(30)],
        [f"kind {n}" for n in range(30)],
        ["kind"] * 30,
        [f"kind {min(n // 2, 9)}" for n in range(30)],
    ],
)
def test_categories_of_several_answers_or_of_one_group_are_none(categories: list[str]) -> None:
    assert outcome_codes(categories, *places()[1:]) == []


def test_categories_of_few_groups_are_not_examined() -> None:
    _, targets, available = places()
    categories = [f"kind {n % 3}" if n < 11 else f"alone {n}" for n in range(30)]
    assert outcome_codes(categories, targets, available) == []
    categories[11] = "kind 2"
    assert len(outcome_codes(categories, targets, available)) == 1


def test_groups_alone_are_those_of_a_category_of_their_own() -> None:
    assert num_alone(["a", "b", "a", "c"]) == 2
