"""Measures by group: nominal, oracle, random and known selectors, ranges of nothing, seeds."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive.benchmark.ranking.measure import by_score, fixed, mean_measures, measures, uniform, without_range

UTILITIES = np.array([[0.4, 0.9, 0.1], [0.4, 0.4, 0.4], [0.4, 0.2, 0.6]])


def test_nominal_differs_from_itself_by_nothing() -> None:
    found = measures(fixed(0, 3, 3), UTILITIES, nominal=0)
    assert found.value.tolist() == [0.4, 0.4, 0.4]
    assert found.difference.tolist() == [0, 0, 0]
    assert found.regret == pytest.approx([0.5 / 0.8, 0, 0.5])
    assert found.top_1.tolist() == [0, 1, 0]


def test_the_oracle_regrets_nothing() -> None:
    found = measures(by_score(UTILITIES), UTILITIES, nominal=0)
    assert found.value.tolist() == [0.9, 0.4, 0.6]
    assert found.regret.tolist() == [0, 0, 0]
    assert found.top_1.tolist() == [1, 1, 1]
    assert found.ndcg == pytest.approx([1, 1, 1])
    assert found.concordance[[0, 2]].tolist() == [1, 1]
    assert np.isnan(found.concordance[1])


def test_random_is_its_expectation() -> None:
    found = measures(uniform(3, 3), UTILITIES, nominal=0)
    each = [measures(fixed(place, 3, 3), UTILITIES, nominal=0) for place in range(3)]
    for name in ("value", "difference", "regret", "top_1"):
        assert getattr(found, name) == pytest.approx(np.mean([getattr(one, name) for one in each], axis=0))
    assert found.concordance[[0, 2]].tolist() == [0.5, 0.5]


def test_a_choice_as_good_as_the_best_is_top_1() -> None:
    found = measures(fixed(1, 1, 3), np.array([[0.2, 0.7, 0.7 + 5e-10]]), nominal=0)
    assert found.top_1.tolist() == [1]


def test_a_range_of_nothing_has_no_regret_and_is_counted() -> None:
    utilities = np.array([[0.5, 0.5 + 9e-7], [0.5, 0.5 + 1e-5]])
    assert measures(fixed(0, 2, 2), utilities, nominal=0).regret == pytest.approx([0, 1])
    assert without_range(utilities) == 1


def test_rows_of_a_learned_selector_are_means_over_seeds() -> None:
    one, other = (measures(fixed(place, 3, 3), UTILITIES, nominal=0) for place in (0, 1))
    found = mean_measures([one, other])
    assert found.value == pytest.approx([0.65, 0.4, 0.3])
    assert np.isnan(found.concordance).tolist() == [False, True, False]


def test_broken_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="do not match"):
        measures(fixed(0, 2, 3), UTILITIES, nominal=0)
    with pytest.raises(ValueError, match="leave its group out of the ranking"):
        measures(fixed(0, 1, 2), np.array([[0.1, np.nan]]), nominal=0)
