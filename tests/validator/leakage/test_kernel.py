"""Kernel criterion: against the criterion with its exact kernel, and the bandwidth against all pairs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.kernel import Hsic, frequencies, median_distance
from branchdrive.leakage.table import tabulate
from branchdrive.statistics.permutation import identity, labels


def test_the_bandwidth_is_the_median_distance_within_groups() -> None:
    values = tabulate(exchangeable(11, 5, 3, seed=0)).values
    values[0, 1] = values[0, 0]
    distances = np.concatenate([pdist(group) for group in values])
    assert median_distance(values) == pytest.approx(np.median(distances[distances > 0]))


def test_the_bandwidth_is_1_where_no_rows_differ() -> None:
    assert median_distance(np.ones((3, 4, 2))) == 1.0


def test_features_approach_the_criterion_of_the_exact_kernel() -> None:
    num_groups, num_actions = 12, 4
    x = exchangeable(num_groups, num_actions, 3, seed=1)
    x[:, 2, 0] += 3.0
    table = tabulate(x)
    sigma = median_distance(table.values)
    omega = frequencies(len(table.columns), 20_000, seed=4)
    found = Hsic.of(table, omega, sigma)(labels(identity(num_groups, num_actions)))[0]

    n = num_groups * num_actions
    kernel = np.exp(-(squareform(pdist(table.values.reshape(n, -1))) ** 2) / (2 * sigma**2))
    centring = np.kron(np.eye(num_groups), np.eye(num_actions) - 1 / num_actions)
    action = np.arange(n) % num_actions
    same_action = action[:, None] == action[None, :]
    expected = np.sum((centring @ kernel @ centring)[same_action]) / n**2
    assert found == pytest.approx(expected, rel=0.02)


def test_frequencies_follow_the_seed() -> None:
    first, again, other = (frequencies(3, 5, seed=seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert not np.isclose(first, other).any()
    np.testing.assert_array_equal(frequencies(2, 5, seed=7), first[:2])
