"""Statistics of a table: against loops, exact kernels, fits to other folds and all permutations of a small design."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.statistic import Hsic, MaxT, Ridge, frequencies, median_distance
from branchdrive.leakage.table import tabulate
from branchdrive.statistics.permutation import identity, labels
from branchdrive.statistics.random_words import group_orders


def test_it_is_what_its_formula_says() -> None:
    table = tabulate(exchangeable(9, 4, 2, seed=0))
    rows = group_orders(1, "leakage/permutations", 5, 9, 4)
    z = table.values
    found = MaxT.of(table.steps, 4)(labels(rows))
    for b in range(5):
        largest = 0.0
        for action in range(4):
            for column in range(z.shape[2]):
                centred = [z[g, :, column] - z[g, :, column].mean() for g in range(9)]
                total = sum(centred[g][rows[b, g, action]] for g in range(9))
                variance = sum(np.mean(part**2) for part in centred)
                largest = max(largest, abs(total) / np.sqrt(variance))
        np.testing.assert_allclose(found[b], largest, rtol=1e-9)


def test_over_all_permutations_a_score_has_mean_0_and_variance_1() -> None:
    table = tabulate(exchangeable(3, 3, 2, seed=2))
    every = np.array(list(product(permutations(range(3)), repeat=3)))
    for steps in (table.steps, table.ranks):
        scores = MaxT.of(steps, 3).scores(labels(every))
        assert len(scores) == 216
        np.testing.assert_allclose(scores.mean(axis=0), 0, atol=1e-9)
        np.testing.assert_allclose(scores.var(axis=0), 1, rtol=1e-9)


def test_a_column_that_does_not_vary_scores_0() -> None:
    steps = np.ones((12, 1), np.float32)
    assert MaxT.of(steps, 3)(labels(group_orders(0, "leakage/permutations", 4, 4, 3))).tolist() == [0.0] * 4


def test_the_median_of_monte_carlo_is_that_of_all_permutations() -> None:
    table = tabulate(exchangeable(3, 3, 2, seed=3))
    statistic = MaxT.of(table.steps, 3)
    every = statistic(labels(np.array(list(product(permutations(range(3)), repeat=3)))))
    drawn = statistic(labels(group_orders(5, "leakage/permutations", 4_000, 3, 3)))
    for level in np.quantile(every, [0.25, 0.5, 0.75, 0.95]):
        assert abs(np.mean(drawn >= level - 1e-9) - np.mean(every >= level - 1e-9)) < 0.03


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


def test_it_is_the_score_of_fits_to_the_other_folds() -> None:
    num_groups, num_actions, penalty = 11, 3, 0.05
    table = tabulate(exchangeable(num_groups, num_actions, 2, seed=0))
    rows = group_orders(2, "leakage/permutations", 4, num_groups, num_actions)
    z = table.values - table.values.mean(axis=1, keepdims=True)
    one_hot = np.eye(num_actions) - 1 / num_actions
    folds = np.array_split(np.arange(num_groups), 4)
    found = Ridge.of(table, 4, penalty)(labels(rows))
    for b in range(4):
        permuted = np.take_along_axis(z, rows[b][:, :, None], axis=1)
        explained = 0.0
        for fold in folds:
            others = np.setdiff1d(np.arange(num_groups), fold)
            design = permuted[others].reshape(-1, z.shape[2])
            gram = design.T @ design
            gram += penalty * np.trace(gram) / len(gram) * np.eye(len(gram))
            weights = np.linalg.solve(gram, design.T @ np.tile(one_hot, (len(others), 1)))
            explained += np.sum((permuted[fold] @ weights) * one_hot)
        np.testing.assert_allclose(found[b], explained / (num_groups * (num_actions - 1)), rtol=1e-6)


def test_the_score_of_labels_without_a_leak_is_0_on_average() -> None:
    table = tabulate(exchangeable(40, 4, 3, seed=1))
    scores = Ridge.of(table, 5, 0.01)(labels(group_orders(0, "leakage/permutations", 1_000, 40, 4)))
    assert abs(scores.mean()) < 4 * scores.std() / np.sqrt(1_000)


def test_columns_that_name_the_action_are_explained() -> None:
    x = np.tile(np.eye(3), (30, 1, 1))
    x += 0.01 * np.random.default_rng(0).normal(size=x.shape)
    assert Ridge.of(tabulate(x), 5, 0.01)(labels(identity(30, 3)))[0] == pytest.approx(1.0, abs=0.05)


def test_folds_need_groups() -> None:
    with pytest.raises(ValueError, match="4 groups cannot fill 5 folds"):
        Ridge.of(tabulate(exchangeable(4, 3, 1, seed=0)), 5, 0.01)
