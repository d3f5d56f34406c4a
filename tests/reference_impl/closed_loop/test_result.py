"""Figures of a run follow from its drives, by formulas that a second program has too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from branchdrive.statistics.cluster import Clusters
from branchdrive_reference.closed_loop.correlation import correlations
from branchdrive_reference.closed_loop.outcome import driving_score
from branchdrive_reference.closed_loop.result import _distinct


@pytest.mark.parametrize(
    ("fraction", "off_road", "counts", "score"),
    [
        (1.0, 0.0, {}, 1.0),
        (0.5, 0.2, {}, 0.4),
        (1.0, 0.0, {"pedestrian_collisions": 1, "red_light_infractions": 2}, 0.5 * 0.7**2),
        (1.0, 0.0, {"vehicle_collisions": 1, "static_collisions": 1, "stop_sign_infractions": 1}, 0.6 * 0.65 * 0.8),
        (1.0, 0.0, {"red_light_infractions": None, "off_road_infractions": 3}, 1.0),
    ],
)
def test_the_score_is_that_of_its_formula(
    fraction: float, off_road: float, counts: dict[str, int | None], score: float
) -> None:
    assert driving_score(fraction, off_road, counts) == pytest.approx(score)


def test_correlations_are_those_of_means_over_groups() -> None:
    random = np.random.default_rng(3)
    offline, driven = random.random((12, 6)), random.random((12, 6))
    clusters = Clusters.of([f"c{i // 2}" for i in range(12)])
    found = correlations(offline, driven, clusters, seed=1, num_resamples=200)
    assert found is not None
    x, y = offline.mean(axis=0), driven.mean(axis=0)
    assert found["spearman"]["value"] == pytest.approx(stats.spearmanr(x, y).statistic)
    assert found["kendall"]["value"] == pytest.approx(stats.kendalltau(x, y).statistic)
    assert found["r2"]["value"] == pytest.approx(stats.linregress(x, y).rvalue ** 2)
    for figure in found.values():
        assert figure["low"] is not None and figure["high"] is not None and figure["low"] <= figure["high"]
    same = correlations(offline[::-1], driven[::-1], Clusters.of([f"c{i // 2}" for i in range(12)][::-1]), seed=1,
                        num_resamples=200)  # fmt: skip
    assert same is not None and same["kendall"] == found["kendall"]


def test_two_selectors_or_equal_figures_have_no_correlation() -> None:
    clusters = Clusters.of(["a", "b"])
    assert correlations(np.eye(2), np.eye(2), clusters, seed=1, num_resamples=10) is None
    assert correlations(np.ones((2, 4)), np.arange(8.0).reshape(2, 4), clusters, seed=1, num_resamples=10) is None


def test_selectors_that_choose_the_same_everywhere_are_one_point() -> None:
    brake, wait = ("brake_0.50",), ("nominal",)
    assert _distinct({2: [wait, wait], 3: [brake, wait], 5: [wait, wait], 6: [wait, brake]}) == [2, 3, 6]
