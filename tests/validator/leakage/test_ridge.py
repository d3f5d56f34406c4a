"""Cross-fitted ridge: against a fit of every fold by normal equations, and what it expects where nothing leaks."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.ridge import Ridge
from branchdrive.leakage.table import tabulate
from branchdrive.statistics.permutation import draw, identity, labels


def test_it_is_the_score_of_fits_to_the_other_folds() -> None:
    num_groups, num_actions, penalty = 11, 3, 0.05
    table = tabulate(exchangeable(num_groups, num_actions, 2, seed=0))
    rows = draw(0, 4, num_groups, num_actions, seed=2)
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
    scores = Ridge.of(table, 5, 0.01)(labels(draw(0, 1_000, 40, 4, seed=0)))
    assert abs(scores.mean()) < 4 * scores.std() / np.sqrt(1_000)


def test_columns_that_name_the_action_are_explained() -> None:
    x = np.tile(np.eye(3), (30, 1, 1))
    x += 0.01 * np.random.default_rng(0).normal(size=x.shape)
    assert Ridge.of(tabulate(x), 5, 0.01)(labels(identity(30, 3)))[0] == pytest.approx(1.0, abs=0.05)


def test_folds_need_groups() -> None:
    with pytest.raises(ValueError, match="4 groups cannot fill 5 folds"):
        Ridge.of(tabulate(exchangeable(4, 3, 1, seed=0)), 5, 0.01)
