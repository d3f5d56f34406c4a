"""Largest standardised mean: against loops, and against all permutations of a small design."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.max_t import MaxT
from branchdrive.leakage.table import tabulate
from branchdrive.statistics.permutation import draw, labels


def test_it_is_what_its_formula_says() -> None:
    table = tabulate(exchangeable(9, 4, 2, seed=0))
    rows = draw(0, 5, 9, 4, seed=1)
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
    assert MaxT.of(steps, 3)(labels(draw(0, 4, 4, 3, seed=0))).tolist() == [0.0] * 4


def test_the_median_of_monte_carlo_is_that_of_all_permutations() -> None:
    table = tabulate(exchangeable(3, 3, 2, seed=3))
    statistic = MaxT.of(table.steps, 3)
    every = statistic(labels(np.array(list(product(permutations(range(3)), repeat=3)))))
    drawn = statistic(labels(draw(0, 4_000, 3, 3, seed=5)))
    for level in np.quantile(every, [0.25, 0.5, 0.75, 0.95]):
        assert abs(np.mean(drawn >= level - 1e-9) - np.mean(every >= level - 1e-9)) < 0.03
