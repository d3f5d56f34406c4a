"""The paper's guard: its rank, its coverage figures, its choice, and where it is vacuous."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.guard.path import accepted, fit_margin, margin_report, margin_selection

TRUTH = np.full((88, 13), 20.0)


def overpredicted() -> np.ndarray:
    """Group ``g`` overpredicts one intervention by ``g + 1`` metres, in a shuffled order."""
    predicted = TRUTH.copy()
    size = np.random.default_rng(0).permutation(88)
    predicted[np.arange(88), 1 + size % 12] += size + 1.0
    return predicted


def test_the_margin_is_the_84th_of_88() -> None:
    margin = fit_margin(overpredicted(), TRUTH, nominal=0)
    assert (margin.rank, margin.num_groups, margin.margin_m) == (84, 88, 84.0)


def test_coverage_is_what_the_paper_prints() -> None:
    predicted = overpredicted()
    margin = fit_margin(predicted, TRUTH, nominal=0)
    report = margin_report(predicted, TRUTH, predicted, TRUTH, margin, nominal=0, action_prior=1)
    assert report.covered_groups == 84 / 88
    assert report.covered_candidates == 1052 / 1056


@pytest.mark.parametrize(("num_groups", "rank"), [(1, 1), (19, 19), (20, 19), (60, 57), (87, 83), (100, 95)])
def test_the_rank_is_not_the_conformal_one(num_groups: int, rank: int) -> None:
    assert fit_margin(TRUTH[:1].repeat(num_groups, 0), TRUTH[:1].repeat(num_groups, 0), nominal=0).rank == rank


def test_the_nominal_candidate_has_no_part_in_the_margin() -> None:
    predicted = TRUTH.copy()
    predicted[:, 4] += 50
    assert fit_margin(predicted, TRUTH, nominal=4).margin_m == 0


def test_an_intervention_is_accepted_at_the_boundary_and_the_best_of_them_is_taken() -> None:
    margin = fit_margin(np.array([[5.0, 8.0]]), np.array([[5.0, 6.0]]), nominal=0)
    assert margin.margin_m == 2
    predicted = np.array([[4.0, 6.0, 5.9], [4.0, 6.0, 7.0], [4.0, 6.0, 7.0]])
    assert accepted(predicted, margin, nominal=0).tolist() == [
        [False, True, False],
        [False, True, True],
        [False, True, True],
    ]
    utilities = np.array([[0.5, 0.6, 0.9], [0.5, 0.6, 0.9], [0.95, 0.6, 0.9]])
    assert margin_selection(predicted, utilities, margin, nominal=0).tolist() == [1, 2, 0]
    executed = np.array([[0.5, 0.25, 0.0], [0.5, 0.25, 1.0], [0.75, 0.25, 1.0]])
    report = margin_report(predicted, predicted, utilities, executed, margin, nominal=0, action_prior=1)
    assert (report.acceptance, report.num_actions, report.vacuous) == (5 / 6, 3, False)
    assert report.value == pytest.approx((0.25 + 1.0 + 0.75) / 3, abs=1e-15)
    assert report.nominal_value == pytest.approx(1.75 / 3, abs=1e-15)
    assert report.action_prior_value == 0.25


def test_a_guard_that_accepts_nothing_is_vacuous() -> None:
    predicted = overpredicted()
    margin = fit_margin(predicted, TRUTH, nominal=0)
    calm = TRUTH + np.random.default_rng(1).normal(size=TRUTH.shape)
    predicted_utilities = np.random.default_rng(2).random(TRUTH.shape)
    report = margin_report(calm, TRUTH, predicted_utilities, predicted_utilities, margin, nominal=0, action_prior=3)
    assert (report.acceptance, report.num_actions, report.vacuous) == (0, 1, True)
    assert report.value == report.nominal_value


def test_ties_of_utility_go_to_the_first_candidate() -> None:
    margin = fit_margin(TRUTH, TRUTH, nominal=0)
    assert margin_selection(TRUTH[:1], np.full((1, 13), 0.5), margin, nominal=0).tolist() == [0]
    assert margin_selection(TRUTH[:1], np.full((1, 13), 0.5), margin, nominal=3).tolist() == [0]


@settings(max_examples=20)
@given(st.permutations(range(40)), st.permutations(range(13)))
def test_orders_of_groups_and_candidates_do_not_matter(groups: list[int], candidates: list[int]) -> None:
    found = banks(40, seed=4)
    predicted, truth = found.scalars.mean(axis=0)[..., 1], found.outcomes.values[..., 1]
    utilities = np.random.default_rng(5).random(truth.shape)
    margin = fit_margin(predicted, truth, nominal=0)
    here = margin_selection(predicted, utilities, margin, nominal=0)
    predicted, truth, utilities = (values[groups][:, candidates] for values in (predicted, truth, utilities))
    nominal = candidates.index(0)
    assert fit_margin(predicted, truth, nominal=nominal) == margin
    there = margin_selection(predicted, utilities, margin, nominal=nominal)
    assert np.array(candidates)[there].tolist() == here[groups].tolist()


@pytest.mark.parametrize(
    ("predicted", "truth", "message"),
    [
        (np.ones((2, 3)), np.ones((2, 2)), "do not match"),
        (np.ones((0, 3)), np.ones((0, 3)), "at least one group"),
        (np.ones((1, 2)), np.array([[1.0, np.nan]]), "leave its group out of the guard"),
    ],
)
def test_broken_arguments_are_refused(predicted: np.ndarray, truth: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_margin(predicted, truth, nominal=0)


def test_a_coverage_of_nothing_has_no_rank() -> None:
    with pytest.raises(ValueError, match="has no rank among 88 groups"):
        fit_margin(TRUTH, TRUTH, nominal=0, coverage=0.0)
