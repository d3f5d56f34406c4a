"""The multiplier of a violation: known knapsacks, linear programs of cvxpy and scipy, all multipliers tried, ties."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from branchdrive_reference.benchmark.guard.knapsack import dual_multiplier

Array = NDArray[np.float64]


def dual(gains: Array, probabilities: Array, multiplier: float, alpha: float) -> float:
    """Objective of the dual program; its least is the optimum of the knapsack."""
    taken = np.maximum((gains - multiplier * probabilities).max(axis=1), 0.0)
    return float(taken.sum() + multiplier * alpha * len(gains))


def test_the_multiplier_is_the_gain_of_the_group_at_the_margin() -> None:
    # A budget of one violation among four groups: the best ratio of gain and probability is bought first.
    gains, even = np.array([[0.4], [0.3], [0.2], [0.1]]), np.full((4, 1), 0.4)
    assert dual_multiplier(gains, even, alpha=0.25) == 0.2 / 0.4
    # Where the budget is used up exactly, any multiplier from that of the next group to that of the last would do.
    assert dual_multiplier(gains, even, alpha=0.2) == 0.2 / 0.4
    assert dual_multiplier(gains, even, alpha=0.2 - 1e-8) == 0.3 / 0.4
    assert dual_multiplier(gains, even, alpha=0.4) == 0.0
    assert dual_multiplier(gains, even, alpha=0.0) == 1.0
    # In one group the second intervention is an exchange for the first: 0.2 more for 0.5 more.
    assert dual_multiplier(np.array([[0.3, 0.5]]), np.array([[0.2, 0.7]]), alpha=0.3) == pytest.approx(0.2 / 0.5)
    # An intervention under the line between its neighbours is never at the margin.
    assert dual_multiplier(np.array([[0.1, 0.5]]), np.array([[0.3, 0.5]]), alpha=0.1) == 1.0


def test_what_costs_nothing_needs_no_multiplier() -> None:
    assert dual_multiplier(np.array([[0.4, -0.1]]), np.array([[0.1, 0.1]]), alpha=0.9) == 0.0
    assert dual_multiplier(-np.ones((3, 2)), np.full((3, 2), 0.5), alpha=0.0) == 0.0
    assert dual_multiplier(np.ones((3, 2)), np.zeros((3, 2)), alpha=0.0) == 0.0
    assert dual_multiplier(np.empty((0, 12)), np.empty((0, 12)), alpha=0.05) == 0.0
    assert dual_multiplier(np.empty((2, 0)), np.empty((2, 0)), alpha=0.05) == 0.0
    # The free one is taken at any multiplier; only what the other adds has one.
    assert dual_multiplier(np.array([[0.4, 0.5]]), np.array([[0.0, 0.5]]), alpha=0.1) == pytest.approx(0.2)


@pytest.mark.parametrize("step", [-1, 0, 1])
def test_the_last_bit_of_a_probability_does_not_decide(step: int) -> None:
    # Three of ten groups use the budget up exactly; 0.1 is no binary number, and a processor may round it otherwise.
    gains = np.linspace(0.1, 1.0, 10)[:, None]
    even = np.nextafter(np.full((10, 1), 0.1), step * np.inf) if step else np.full((10, 1), 0.1)
    assert dual_multiplier(gains, even, alpha=0.03) == pytest.approx(7.0)


small = st.integers(1, 3).flatmap(
    lambda groups: st.lists(
        st.lists(st.tuples(st.integers(-3, 6), st.integers(0, 4)), min_size=2, max_size=2),
        min_size=groups,
        max_size=groups,
    )
)


@given(small, st.integers(0, 12))
def test_it_is_the_least_multiplier_at_which_the_budget_holds(table: list[list[tuple[int, int]]], budget: int) -> None:
    """Exactly: takings change only where two choices of a group cost the same, and all those multipliers are tried."""
    groups = [[(0, 0), *group] for group in table]
    multipliers = {Fraction(0)}
    for group in groups:
        multipliers |= {
            Fraction(gain - other, p - q) for (gain, p), (other, q) in product(group, group) if p > q and gain >= other
        }

    def taken(multiplier: Fraction) -> int:
        return sum(min((-(gain - multiplier * p), p) for gain, p in group)[1] for group in groups)

    expected = min(multiplier for multiplier in multipliers if taken(multiplier) <= budget)
    numbers = np.array(table, float)
    found = dual_multiplier(numbers[..., 0], numbers[..., 1] / 4, alpha=budget / 4 / len(groups))
    assert found == pytest.approx(4 * float(expected), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_dual_of_the_linear_programs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gains, probabilities = rng.normal(0, 0.2, (40, 12)), rng.random((40, 12))
    multiplier = dual_multiplier(gains, probabilities, alpha=0.05)
    rows = np.vstack([np.kron(np.eye(40), np.ones(12)), probabilities.ravel()])
    other = linprog(-gains.ravel(), rows, np.r_[np.ones(40), 0.05 * 40])
    assert dual(gains, probabilities, multiplier, 0.05) == pytest.approx(-other.fun, abs=1e-8)
    assert multiplier == pytest.approx(-other.ineqlin.marginals[-1], abs=1e-8)

    cvxpy = pytest.importorskip("cvxpy")
    takes = cvxpy.Variable((40, 12))
    budget = cvxpy.sum(cvxpy.multiply(probabilities, takes)) <= 0.05 * 40
    problem = cvxpy.Problem(
        cvxpy.Maximize(cvxpy.sum(cvxpy.multiply(gains, takes))), [takes >= 0, cvxpy.sum(takes, axis=1) <= 1, budget]
    )
    problem.solve(solver="CLARABEL")
    assert multiplier == pytest.approx(float(budget.dual_value), abs=1e-4)
    assert dual(gains, probabilities, multiplier, 0.05) == pytest.approx(problem.value, abs=1e-5)


def test_the_multiplier_falls_with_the_budget_and_scales_with_the_gains() -> None:
    rng = np.random.default_rng(5)
    gains, probabilities = rng.normal(0, 0.2, (30, 12)), rng.random((30, 12))
    multipliers = [dual_multiplier(gains, probabilities, alpha=alpha) for alpha in np.linspace(0.0, 1.0, 40)]
    assert all(later <= earlier for earlier, later in pairwise(multipliers))
    assert multipliers[-1] == 0.0 < multipliers[1]
    order = rng.permutation(30)
    for alpha, multiplier in zip(np.linspace(0.0, 1.0, 40)[1:], multipliers[1:], strict=True):
        assert dual_multiplier(2.0 * gains[order], probabilities[order], alpha=alpha) == 2.0 * multiplier


def test_what_is_no_knapsack_is_refused() -> None:
    good = np.full((2, 3), 0.5)
    for gains, probabilities, alpha in (
        (good * np.nan, good, 0.1),
        (good * np.inf, good, 0.1),
        (good, good * np.nan, 0.1),
        (good, -good, 0.1),
        (good, good + 1, 0.1),
        (good, good, -0.1),
        (good, good, np.nan),
    ):
        with pytest.raises(ValueError, match=r"^gains are finite numbers, probabilities in"):
            dual_multiplier(gains, probabilities, alpha=alpha)
    with pytest.raises(ValueError, match=r"gains \[2, 3\] and probabilities \[2, 2\]"):
        dual_multiplier(good, good[:, :2], alpha=0.1)
