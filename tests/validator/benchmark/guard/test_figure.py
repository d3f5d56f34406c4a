"""Figures: hand-counted values, intervals over clusters, and ratios that are not defined."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from branchdrive.benchmark.guard.figure import RATES, Terms, figures, terms
from branchdrive.statistics.random_words import below, words

SELECTION = np.array([0, 1, 1, 2])
UNGUARDED = np.array([2, 1, 2, 2])
UTILITIES = np.array([[0.5, 0.6, 0.7], [0.5, 0.7, 0.4], [0.5, 0.4, 0.9], [0.5, 0.2, 0.6]])
SEPARATION = np.array([[4.0, 4.0, 1.0], [4.0, 5.0, 4.0], [4.0, 3.0, 4.0], [4.0, 4.0, 3.8]])
CLUSTERS = ["a", "b", "b", "c"]


def test_every_figure_is_what_counting_gives() -> None:
    found = figures(terms(SELECTION, UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1)
    wanted = {
        "coverage": 3 / 4,
        "violation": 1 / 4,
        "violation_of_clusters": 0.5 / 3,
        "violation_of_interventions": 1 / 3,
        "intervention": 3 / 4,
        "gain": (0 + 0.2 - 0.1 + 0.1) / 4,
        "retained_gain": (0 + 0.2 - 0.1 + 0.1) / (0.2 + 0.2 + 0.4 + 0.1),
        "separation_difference_m": (0 + 1 - 1 - 0.2) / 4,
    }
    assert {name: figure.value for name, figure in found.items()} == pytest.approx(wanted)


def test_nominal_violates_nothing_and_retains_nothing() -> None:
    nominal = np.zeros(4, int)
    found = figures(terms(nominal, UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1)
    assert (found["violation"].value, found["retained_gain"].value, found["coverage"].value) == (0, 0, 1)
    assert found["violation_of_interventions"] == (None, None, None, 0)


def test_the_unguarded_selector_retains_everything() -> None:
    found = figures(terms(UNGUARDED, UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1)
    assert found["retained_gain"][:3] == (1, None, None)  # resamples agree


def test_a_selector_without_a_gain_has_no_retained_gain() -> None:
    losing = np.array([0, 2, 1, 1])
    found = figures(terms(SELECTION, losing, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1)
    assert found["retained_gain"].value is None


def test_an_interval_is_that_of_the_normal_law_for_many_clusters() -> None:
    rng = np.random.default_rng(0)
    clusters = [str(place // 2) for place in range(800)]
    values = np.repeat(rng.normal(size=400), 2)
    figure = figures({"gain": Terms(values, np.ones(800))}, clusters, seed=1)["gain"]
    error = values[::2].std() / np.sqrt(400)
    assert figure.value == pytest.approx(values.mean())
    assert figure.low == pytest.approx(values.mean() - 1.96 * error, abs=0.15 * error)
    assert figure.high == pytest.approx(values.mean() + 1.96 * error, abs=0.15 * error)


def test_resamples_without_a_denominator_are_counted() -> None:
    clusters = ["a", "b", "c", "d"]
    figure = figures({"x": Terms(np.array([1.0, 0, 0, 0]), np.array([1.0, 0, 0, 0]))}, clusters, seed=2)["x"]
    assert figure[:3] == (1, None, None)
    assert figure.num_undefined / 2000 == pytest.approx((3 / 4) ** 4, abs=0.04)


@settings(max_examples=20)
@given(st.permutations(range(30)), st.integers(0, 3))
def test_the_order_of_groups_does_not_matter(order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    clusters = [str(place) for place in rng.integers(0, 12, 30)]
    part = Terms(rng.integers(0, 2, 30).astype(float), np.ones(30))
    here = figures({"x": part}, clusters, seed=seed)
    moved = {"x": Terms(part.numerator[order], part.denominator[order])}
    assert figures(moved, [clusters[place] for place in order], seed=seed) == here


@pytest.mark.parametrize("name", RATES)
def test_a_rate_of_nothing_seen_is_no_certainty(name: str) -> None:
    clusters = [str(place) for place in range(50)]
    figure = figures({name: Terms(np.zeros(50), np.ones(50))}, clusters, seed=1)[name]
    assert figure == (0, 0, pytest.approx(1 - 0.025 ** (1 / 50)), 0)


def test_a_settled_figure_has_no_interval() -> None:
    part = {"violation": Terms(np.array([0.0, 1, 0, 0]), np.ones(4)), "gain": Terms(np.arange(4.0), np.ones(4))}
    found = figures(part, CLUSTERS, seed=1, settled=("violation",))
    assert found["violation"] == (0.25, None, None, 0)
    assert found["gain"].low is not None


def test_resamples_are_words_of_a_named_stream() -> None:
    """Cluster `c` of resample `b` counts the words of the stream that fall on it, whatever numpy draws from them."""
    drawn = below(words(7, "guard/figures", 500, 3), 3)
    sums, sizes = np.array([4.0, 2.0, 1.0]), np.array([1, 2, 1])
    gains = Terms(np.array([4.0, 1, 1, 1]), np.ones(4))
    ratios = [sums[row].sum() / sizes[row].sum() for row in drawn]
    figure = figures({"gain": gains}, CLUSTERS, seed=7, num_resamples=500)["gain"]
    assert (figure.low, figure.high) == pytest.approx(tuple(np.quantile(ratios, (0.025, 0.975))))


def test_broken_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="of the same groups"):
        terms(SELECTION[:3], UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0)
    with pytest.raises(ValueError, match="at least one group"):
        figures({}, [], seed=1)
    with pytest.raises(ValueError, match="`seed` is -1"):
        figures({}, ["a"], seed=-1)
