"""The price of a violation: known knapsacks, scipy's linear programs, and the one-dimensional dual."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize_scalar

pytest.importorskip("cvxpy")
module = pytest.importorskip("branchdrive_reference.guard.knapsack")


def test_the_price_is_the_gain_of_the_group_at_the_margin() -> None:
    # A budget of one violation among four groups: the best ratio of gain and probability is bought first.
    gains = np.array([[0.4], [0.3], [0.2], [0.1]])
    found = module.knapsack(gains, np.full((4, 1), 0.4), alpha=0.25)
    assert found.dual_price == pytest.approx(0.2 / 0.4, abs=1e-6)
    assert found.gain == pytest.approx((0.4 + 0.3 + 0.5 * 0.2) / 4, abs=1e-6)


def test_a_budget_that_is_not_used_up_costs_nothing() -> None:
    found = module.knapsack(np.array([[0.4, -0.1]]), np.array([[0.1, 0.1]]), alpha=0.9)
    assert found.dual_price == pytest.approx(0, abs=1e-6)
    assert found.gain == pytest.approx(0.4, abs=1e-6)


def test_nothing_to_gain_is_left() -> None:
    assert module.knapsack(-np.ones((3, 2)), np.full((3, 2), 0.5), alpha=0.1).gain == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_optimum_of_scipy_and_of_its_dual(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gains, probabilities = rng.normal(0, 0.2, (40, 12)), rng.random((40, 12))
    found = module.knapsack(gains, probabilities, alpha=0.05)
    rows = np.kron(np.eye(40), np.ones(12))
    other = linprog(-gains.ravel(), np.vstack([rows, probabilities.ravel()]), np.r_[np.ones(40), 0.05 * 40])
    assert found.gain == pytest.approx(-other.fun / 40, abs=1e-6)

    def dual(price: float) -> float:
        return float(np.maximum((gains - price * probabilities).max(axis=1), 0).sum() + price * 0.05 * 40)

    assert dual(found.dual_price) == pytest.approx(found.gain * 40, abs=1e-4)
    assert minimize_scalar(dual, bounds=(0, 20), method="bounded").fun == pytest.approx(found.gain * 40, abs=1e-3)
