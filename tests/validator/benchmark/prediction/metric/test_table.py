"""Statistics table: seeds, shared resamples, comparisons, and independence of the order of groups."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.statistics.samples import UNIT, outcomes, pairs, perfect, predictions, same

from branchdrive.benchmark.prediction.metric.metric import METRICS, metric_values
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.table import Contrast, Statistics, statistics
from branchdrive.statistics.bootstrap import design
from branchdrive.statistics.cluster import Clusters, intra_cluster_correlation
from branchdrive.statistics.sign_flip import CLUSTER_STREAM, draw_signs, sign_flip, studentised_p

CONTRASTS = (Contrast("good", "bad", "macro_nmae"), Contrast("good", "bad", "ade_m"))
IDS = [f"g{i:02}" for i in range(14)]


def models(truth: Outcomes) -> dict[str, dict[int, Predictions]]:
    return {
        "bad": {seed: predictions(truth, seed=seed, noise=2.0) for seed in (11, 23, 37)},
        "good": {seed: predictions(truth, seed=seed, noise=0.5) for seed in (11, 23, 37)},
        "mean": {0: Predictions.of(np.ones_like(truth.scalars), np.zeros_like(truth.paths))},
    }


def table(truth: Outcomes, ids: list[str], by_model: dict[str, Any], **changes: Any) -> Statistics:
    options = {"contrasts": CONTRASTS, "seed": 5, "num_resamples": 60, "num_flips": 200}
    clusters = changes.pop("clusters", [f"c{int(name[1:] or 0) // 2}" for name in ids])
    return statistics(ids, clusters, truth, by_model, UNIT, **{**options, **changes})


@pytest.fixture(scope="module")
def truth() -> Outcomes:
    return outcomes(14, seed=3)


@pytest.fixture(scope="module")
def found(truth: Outcomes) -> Statistics:
    return table(truth, IDS, models(truth))


def test_a_row_is_the_mean_of_its_seeds(truth: Outcomes, found: Statistics) -> None:
    given_seeds = models(truth)["good"]
    expected = metric_values(truth, list(given_seeds.values()), UNIT, np.ones((1, 14))).counted[:, 0]
    rows = [row for row in found.estimates if row.model == "good"]
    assert [row.metric for row in rows] == [metric.name for metric in METRICS]
    same([row.by_seed for row in rows], expected.T)
    same([row.value for row in rows], expected.mean(axis=0))
    same([row.seed_sd for row in rows], expected.std(axis=0, ddof=1))


def test_an_interval_is_of_the_mean_of_seeds_under_shared_resamples(truth: Outcomes, found: Statistics) -> None:
    resampling = design(pairs(14), seed=5, num_resamples=60)
    rows = [row for row in found.estimates if row.model == "good"]
    for part, ends in ((1, ("low", "high")), (3, ("cluster_low", "cluster_high"))):
        counts = resampling.split(resampling[:])[part]
        resampled = metric_values(truth, list(models(truth)["good"].values()), UNIT, counts).counted.mean(axis=0)
        expected = np.quantile(resampled, [0.025, 0.975], axis=0)
        same([[getattr(row.interval, end) for end in ends] for row in rows], expected.T)


def test_a_model_of_one_seed_has_no_deviation_over_seeds(found: Statistics) -> None:
    rows = [row for row in found.estimates if row.model == "mean"]
    assert len(rows) == len(METRICS)
    assert np.isnan([row.seed_sd for row in rows]).all()


def test_what_is_not_defined_is_nan_and_not_a_value(found: Statistics) -> None:
    row = next(row for row in found.estimates if (row.model, row.metric) == ("mean", "spearman.displacement_m"))
    assert np.isnan([row.value, row.interval.low, row.interval.bca_high, row.interval.cluster_low]).all()
    assert (row.interval.num_undefined, row.interval.cluster_num_undefined) == (60, 60)


def test_the_groups_of_a_row_are_the_least_of_its_seeds(truth: Outcomes) -> None:
    flat = predictions(truth).scalars
    flat[:3] = 1.0
    mixed = {1: predictions(truth), 2: Predictions.of(flat, truth.paths)}
    rows = table(truth, IDS, {"mixed": mixed}, contrasts=()).estimates
    alone = table(truth, IDS, {"mixed": {2: mixed[2]}}, contrasts=()).estimates
    counted = {row.metric: row.num_groups for row in rows}
    assert counted == {row.metric: row.num_groups for row in alone}
    assert counted["bank_spearman.displacement_m"] == 11


def test_a_comparison_takes_errors_averaged_over_seeds(truth: Outcomes, found: Statistics) -> None:
    sides = [
        metric_values(truth, list(models(truth)[name].values()), UNIT, np.ones((1, 14))).by_group.mean(axis=0)
        for name in ("good", "bad")
    ]
    places = [[metric.name for metric in METRICS].index(contrast.metric) for contrast in CONTRASTS]
    differences, clusters = (sides[0] - sides[1])[:, places], Clusters.of(pairs(14))
    test = sign_flip(differences, draw_signs(14, seed=5, num_flips=200))
    signs = draw_signs(7, seed=5, num_flips=200, stream=CLUSTER_STREAM)
    assert [row.p_clusters for row in found.comparisons] == sign_flip(differences, signs, clusters).p.tolist()
    same([row.correlation for row in found.comparisons], intra_cluster_correlation(differences, clusters))
    same([row.difference for row in found.comparisons], test.mean)
    assert [row.p for row in found.comparisons] == test.p.tolist()
    studentised = studentised_p(differences, design(pairs(14), seed=5, num_resamples=60)[1:61])
    assert [row.studentised_p for row in found.comparisons] == studentised.tolist()
    assert [row.name for row in found.comparisons] == ["good-bad.macro_nmae", "good-bad.ade_m"]


def test_a_difference_of_complete_banks_is_that_of_the_table() -> None:
    truth = outcomes(14, gaps=0.0)
    made = table(truth, IDS, models(truth))
    values = {(row.model, row.metric): row.value for row in made.estimates}
    for contrast, row in zip(CONTRASTS, made.comparisons, strict=True):
        same(row.difference, values["good", contrast.metric] - values["bad", contrast.metric])


def test_the_better_model_is_found(found: Statistics) -> None:
    for row in found.comparisons:
        assert row.difference < 0
        assert max(row.interval.high, row.interval.cluster_high) < 0
        assert row.p == 1 / 201
        assert row.is_smallest
        assert row.is_smallest_studentised == (row.studentised_p == 1 / 61)
        assert row.studentised_p < 0.05
        assert row.p_clusters < 0.05
        assert (row.num_groups, row.num_clusters) == (14, 7)


def test_a_model_does_not_differ_from_itself(truth: Outcomes) -> None:
    same_model = Contrast("good", "good", "fde_m")
    row = table(truth, IDS, models(truth), contrasts=[same_model]).comparisons[0]
    assert (row.difference, row.p, row.p_clusters, row.studentised_p) == (0.0, 1.0, 1.0, 1.0)
    assert (row.interval.low, row.interval.high, row.interval.cluster_low, row.interval.cluster_high) == (0.0,) * 4
    assert np.isnan(row.correlation)


@settings(max_examples=5)
@given(st.permutations(range(14)))
def test_the_order_of_groups_changes_no_bit(order: list[int]) -> None:
    truth = outcomes(14, seed=3)
    rows = np.array(order)
    moved = {model: {seed: one.take(rows) for seed, one in by_seed.items()} for model, by_seed in models(truth).items()}
    assert repr(table(truth.take(rows), [IDS[i] for i in order], moved)) == repr(table(truth, IDS, models(truth)))


def test_the_names_of_clusters_decide_nothing_but_their_order(truth: Outcomes, found: Statistics) -> None:
    renamed = table(truth, IDS, models(truth), clusters=[f"route {i // 2}" for i in range(14)])
    assert repr(renamed) == repr(found)
    other = table(truth, IDS, models(truth), clusters=[f"c{i % 7}" for i in range(14)])
    for left, right in zip(other.comparisons, found.comparisons, strict=True):
        assert (left.p, left.interval.low, left.studentised_p) == (right.p, right.interval.low, right.studentised_p)
        assert left.interval.cluster_low != right.interval.cluster_low


def test_a_single_cluster_has_no_interval_and_no_significance(truth: Outcomes) -> None:
    made = table(truth, IDS, models(truth), clusters=["one"] * 14)
    assert all(np.isnan([row.interval.cluster_low, row.interval.cluster_high]).all() for row in made.estimates)
    for row in made.comparisons:
        assert (row.p_clusters, row.is_smallest_clusters, row.num_clusters) == (1.0, False, 1)
        assert np.isnan([row.interval.cluster_low, row.interval.cluster_high, row.correlation]).all()


def test_another_model_changes_no_row_of_the_first(truth: Outcomes, found: Statistics) -> None:
    alone = table(truth, IDS, {"good": models(truth)["good"]}, contrasts=())
    for left, right in zip(alone.estimates, [row for row in found.estimates if row.model == "good"], strict=True):
        same(left.value, right.value)
        same(left.interval, right.interval)


def test_perfect_predictions_have_intervals_of_no_width(truth: Outcomes) -> None:
    rows = table(truth, IDS, {"oracle": {0: perfect(truth)}}, contrasts=()).estimates
    for row in rows:
        if row.interval.num_undefined == 0:
            same(row.interval.low, row.interval.high)


def test_a_single_group_has_values_but_no_interval_and_no_significance() -> None:
    truth = outcomes(1, gaps=0.0)
    made = table(truth, ["g"], models(truth))
    assert all(np.isfinite(row.value) for row in made.estimates if row.model == "good")
    assert all(np.isnan(row.interval[:4]).all() for row in made.estimates)
    assert [(row.p, row.p_clusters) for row in made.comparisons] == [(1.0, 1.0)] * 2


@pytest.mark.parametrize(
    ("ids", "changes", "match"),
    [
        (IDS[:-1], {}, "13 group ids"),
        ([*IDS[:-1], IDS[0]], {}, "13 of them distinct"),
        (IDS, {"contrasts": [Contrast("good", "M9", "ade_m")]}, "names 'M9'; there are bad, good, mean"),
        (IDS, {"contrasts": [Contrast("good", "bad", "rmse.min_ttc_s")]}, "names 'rmse.min_ttc_s'"),
        (IDS, {"clusters": ["c"] * 13}, "13 clusters are not those of 14 groups"),
    ],
)
def test_what_does_not_fit_is_refused(truth: Outcomes, ids: list[str], changes: dict[str, Any], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        table(truth, ids, models(truth), **changes)


def test_a_model_without_predictions_is_refused(truth: Outcomes) -> None:
    with pytest.raises(ValueError, match="model 'M1' has no prediction"):
        table(truth, IDS, {**models(truth), "M1": {}})
