"""Intervals of ratios: of resamples, and of rates, exact where groups are independent, and their coverage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binomtest, t
from tests.each import each

from branchdrive.benchmark.ranking.ratio import Terms, figures, rate_interval
from branchdrive.statistics.random_words import below, words

SIZES = np.repeat([1, 2, 3, 4, 5, 6, 7], [28, 11, 7, 4, 1, 1, 1])
PLACES = np.repeat(np.arange(len(SIZES)), SIZES)


def exact(events: int, size: int) -> tuple[float, float]:
    """The interval of Clopper and Pearson."""
    found = binomtest(events, size).proportion_ci(method="exact")
    return float(found.low), float(found.high)


def interval(events: NDArray[np.generic], places: NDArray[np.intp]) -> tuple[float, float]:
    return rate_interval(events.astype(float), np.ones(len(events)), places)


@given(st.integers(0, 40))
def test_groups_by_themselves_have_the_exact_interval(events: int) -> None:
    """Their variance is a little more than the binomial one, by the factor n / (n - 1)."""
    low, high = interval(np.arange(40) < events, np.arange(40))
    wanted = exact(events, 40)
    if events in (0, 40):
        assert (low, high) == pytest.approx(wanted)
    else:
        assert low <= wanted[0] < wanted[1] <= high
        assert (low, high) == pytest.approx(wanted, abs=0.006)


@pytest.mark.parametrize("events", [0, 30])
def test_where_nothing_varies_groups_of_a_cluster_are_copies(events: int) -> None:
    """Ten clusters of three say as much as ten groups; 0 of 30 is no certainty."""
    found = interval(np.arange(30) < events, np.arange(30) // 3)
    assert found == pytest.approx(exact(events // 3, 10))


def test_clusters_of_unequal_size_count_less() -> None:
    low, high = interval(np.zeros(105), PLACES)
    effective = 105**2 / (SIZES**2).sum()
    assert effective < 53
    assert (low, high) == (0, pytest.approx(1 - 0.025 ** (1 / effective)))


def test_copies_within_clusters_count_once() -> None:
    """Fifty clusters of four equal groups, of which five have the event: the interval of 5 of 50, but for Student."""
    found = interval(np.arange(200) < 20, np.arange(200) // 4)
    size = 49 * (t.ppf(0.975, 199) / t.ppf(0.975, 49)) ** 2
    assert size < 50
    wanted = exact(5, 50)
    assert found[0] <= wanted[0] < wanted[1] <= found[1]
    assert found == pytest.approx(wanted, abs=0.01)


def test_weights_of_zero_take_no_part() -> None:
    events, weights = np.array([1.0, 0, 0, 0, 0]), np.array([1.0, 1, 1, 0, 0])
    places = np.array([0, 1, 2, 2, 3])
    assert rate_interval(events, weights, places) == rate_interval(events[:3], weights[:3], places[:3])
    with pytest.raises(ValueError, match="a group with a weight"):
        rate_interval(np.zeros(2), np.zeros(2), np.arange(2))


def test_one_cluster_says_next_to_nothing() -> None:
    low, high = interval(np.array([1, 0, 0]), np.zeros(3, np.intp))
    assert low < 0.05
    assert high > 0.9


@given(st.lists(st.booleans(), min_size=30, max_size=30))
def test_no_event_and_event_mirror_each_other(events: list[bool]) -> None:
    places = np.arange(30) // 2
    low, high = interval(np.array(events), places)
    assert interval(~np.array(events), places) == pytest.approx((1 - high, 1 - low))
    assert 0 <= low < high <= 1
    assert low <= np.mean(events) <= high


@each("by_cluster", [False, True])
@each(("rate", "correlation"), [(0.01, 0.0), (0.01, 0.8), (0.05, 0.4), (0.2, 0.8)])
def test_an_interval_covers_what_it_says(rate: float, correlation: float, by_cluster: bool) -> None:
    """A bootstrap covers 0.44 to 0.66 at a rate of 0.01."""
    rng = np.random.default_rng(4)
    weights = 1 / SIZES[PLACES] if by_cluster else np.ones(len(PLACES))
    covered, num_draws = 0, 300
    for _ in range(num_draws):
        risks = np.full(len(SIZES), rate)
        if correlation:
            concentration = (1 - correlation) / correlation
            risks = rng.beta(rate * concentration, (1 - rate) * concentration, len(SIZES))
        events = rng.random(len(PLACES)) < risks[PLACES]
        low, high = rate_interval(events * weights, weights, PLACES)
        covered += low <= rate <= high
    assert covered / num_draws > 0.92


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


def test_resamples_are_words_of_a_named_stream() -> None:
    """Cluster `c` of resample `b` counts the words of the stream that fall on it, whatever numpy draws from them."""
    drawn = below(words(7, "guard/figures", 500, 3), 3)
    sums, sizes = np.array([4.0, 2.0, 1.0]), np.array([1, 2, 1])
    gains = Terms(np.array([4.0, 1, 1, 1]), np.ones(4))
    ratios = [sums[row].sum() / sizes[row].sum() for row in drawn]
    figure = figures({"gain": gains}, ["a", "b", "b", "c"], seed=7, num_resamples=500)["gain"]
    assert (figure.low, figure.high) == pytest.approx(tuple(np.quantile(ratios, (0.025, 0.975))))


def test_figures_of_no_group_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one group"):
        figures({}, [], seed=1)
    with pytest.raises(ValueError, match="`seed` is -1"):
        figures({}, ["a"], seed=-1)
