"""Figures of a guarded selection: hand-counted values, and ratios that are not defined."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive.benchmark.guard.figure import RATES, terms
from branchdrive.benchmark.ranking.ratio import Terms, figures

SELECTION = np.array([0, 1, 1, 2])
UNGUARDED = np.array([2, 1, 2, 2])
UTILITIES = np.array([[0.5, 0.6, 0.7], [0.5, 0.7, 0.4], [0.5, 0.4, 0.9], [0.5, 0.2, 0.6]])
SEPARATION = np.array([[4.0, 4.0, 1.0], [4.0, 5.0, 4.0], [4.0, 3.0, 4.0], [4.0, 4.0, 3.8]])
CLUSTERS = ["a", "b", "b", "c"]


def test_every_figure_is_what_counting_gives() -> None:
    found = figures(
        terms(SELECTION, UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1, rates=RATES
    )
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
    found = figures(
        terms(nominal, UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1, rates=RATES
    )
    assert (found["violation"].value, found["retained_gain"].value, found["coverage"].value) == (0, 0, 1)
    assert found["violation_of_interventions"] == (None, None, None, 0)


def test_the_unguarded_selector_retains_everything() -> None:
    found = figures(
        terms(UNGUARDED, UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1, rates=RATES
    )
    assert found["retained_gain"][:3] == (1, None, None)  # resamples agree


def test_a_selector_without_a_gain_has_no_retained_gain() -> None:
    losing = np.array([0, 2, 1, 1])
    found = figures(terms(SELECTION, losing, UTILITIES, SEPARATION, CLUSTERS, nominal=0), CLUSTERS, seed=1, rates=RATES)
    assert found["retained_gain"].value is None


@pytest.mark.parametrize("name", RATES)
def test_a_rate_of_nothing_seen_is_no_certainty(name: str) -> None:
    clusters = [str(place) for place in range(50)]
    figure = figures({name: Terms(np.zeros(50), np.ones(50))}, clusters, seed=1, rates=RATES)[name]
    assert figure == (0, 0, pytest.approx(1 - 0.025 ** (1 / 50)), 0)


def test_a_settled_figure_has_no_interval() -> None:
    part = {"violation": Terms(np.array([0.0, 1, 0, 0]), np.ones(4)), "gain": Terms(np.arange(4.0), np.ones(4))}
    found = figures(part, CLUSTERS, seed=1, rates=RATES, settled=("violation",))
    assert found["violation"] == (0.25, None, None, 0)
    assert found["gain"].low is not None


def test_broken_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="of the same groups"):
        terms(SELECTION[:3], UNGUARDED, UTILITIES, SEPARATION, CLUSTERS, nominal=0)
