"""History variables that rank or hold a target."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests.validator.statistics import random_words

from branchdrive.leakage.structural import affine_targets, neighbours_p, ranked_targets

GROUPS, ACTIONS = 40, 3


def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(GROUPS, 5)), rng.normal(size=(GROUPS, ACTIONS, 2)), np.ones((GROUPS, ACTIONS, 2), bool)


def test_unrelated_variables_tell_nothing() -> None:
    assert ranked_targets(*drawn()) == affine_targets(*drawn()) == []


@pytest.mark.parametrize(("scale", "offset"), [(1, 0), (3, 1), (-0.01, 100)])
def test_an_affine_function_is_found(scale: float, offset: float) -> None:
    variables, targets, available = drawn()
    variables[:, 4] = scale * targets[:, 1, 1] + offset
    assert [(t.variable, t.target) for t in affine_targets(variables, targets, available)] == [(4, 1)]
    assert ranked_targets(variables, targets, available) == []


@pytest.mark.parametrize(("noise", "expected"), [(1e-6, 1), (1e-3, 0)])
def test_only_rounding_is_forgiven(noise: float, expected: int) -> None:
    variables, targets, available = drawn()
    variables[:, 0] = targets[:, 0, 0] + noise * variables[:, 0]
    assert len(affine_targets(variables, targets, available)) == expected


@pytest.mark.parametrize(("num_values", "expected"), [(9, 0), (10, 1)])
def test_ten_values_are_needed(num_values: int, expected: int) -> None:
    variables, targets, available = drawn()
    variables[:, 0] = targets[:, 0, 0] = np.arange(GROUPS) % num_values
    assert len(affine_targets(variables, targets, available)) == expected


def test_groups_without_the_target_do_not_count() -> None:
    variables, targets, available = drawn()
    available[20:, 0, 0] = False
    variables[:20, 0] = targets[:20, 0, 0]
    assert len(affine_targets(variables, targets, available)) == 1


def test_a_ranking_is_found() -> None:
    variables, targets, available = drawn()
    targets[..., 0] = np.exp(variables[:, :1])
    assert [(t.variable, t.target) for t in ranked_targets(variables, targets, available)] == [(0, 0)]
    assert affine_targets(variables, targets, available) == []


def test_p_of_neighbours_is_that_of_orders_in_whole_numbers() -> None:
    homes = ["train"] * 5 + ["test", "val", "val", "train", "test", "test"]
    drawn = [random_words.order(random_words.row(0, "leakage/neighbours", b, len(homes))) for b in range(1_999)]

    def shared(order: list[int]) -> int:
        return sum(homes[a] == homes[b] for a, b in pairwise(order))

    reached = sum(shared(order) >= shared(list(range(len(homes)))) for order in drawn)
    assert neighbours_p(homes) == (1 + reached) / 2_000


def test_identities_that_run_by_partition_tell_it() -> None:
    assert neighbours_p(["train"] * 30 + ["val"] * 30) == 1 / 2_000
    assert neighbours_p(["train", "val"] * 30) > 0.5


def test_a_target_that_a_speed_holds_follows_from_the_motion() -> None:
    """In a world of linear dynamics the way under one command is an affine function of the speed at the branch."""
    variables, targets, available = drawn()
    targets[:, 2, 1] = 2.5 * variables[:, 4] + 30.0
    variables[:, 3] = 1.0 - variables[:, 4]
    held = {(leak.variable, leak.target) for leak in affine_targets(variables, targets, available)}
    assert held == {(3, 1), (4, 1)}
    assert affine_targets(variables, targets, available, speeds=[4]) == []
    assert affine_targets(variables, targets, available, speeds=[0]) != []
