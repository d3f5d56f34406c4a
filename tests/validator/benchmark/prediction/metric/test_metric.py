"""Metrics against scikit-learn and scipy, and what must not change them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import spearmanr
from sklearn.metrics import mean_absolute_error, root_mean_squared_error
from tests.validator.statistics.samples import UNIT, outcomes, perfect, predictions, same

from branchdrive.benchmark.prediction.metric.metric import METRICS, PAIRED_METRICS, metric_values
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.scale import Scale
from branchdrive.driving.target import TARGETS

NAMES = [metric.name for metric in METRICS]
SCALE = Scale(np.array([1.0, 2.0, 0.5, 4.0, 3.0, 0.25]), np.array([2.0, 1.0, 0.25, 8.0, 5.0, 1.0]))


def values(truth: Outcomes, predicted: Predictions, scale: Scale = UNIT) -> dict[str, float]:
    counted = metric_values(truth, [predicted], scale, np.ones((1, truth.num_groups))).counted
    return dict(zip(NAMES, counted[0, 0].tolist(), strict=True))


def by_group(truth: Outcomes, predicted: Predictions, scale: Scale = UNIT) -> dict[str, np.ndarray]:
    found = metric_values(truth, [predicted], scale, np.ones((1, truth.num_groups))).by_group[0]
    return dict(zip(NAMES, found.T, strict=True))


def without(truth: Outcomes, target: int) -> Outcomes:
    available = truth.available.copy()
    available[..., target] = False
    return Outcomes(np.where(available, truth.scalars, 0.0), available, truth.paths, truth.complete)


def test_metrics_are_those_of_scikit_learn_and_scipy() -> None:
    truth = outcomes(12, gaps=0.3)
    predicted = predictions(truth)
    found = values(truth, predicted, SCALE)
    for t, target in enumerate(TARGETS):
        mask = truth.available[..., t]
        y, y_hat = truth.scalars[..., t][mask], predicted.scalars[..., t][mask]
        assert found[f"rmse.{target.name}"] == pytest.approx(root_mean_squared_error(y, y_hat))
        assert found[f"spearman.{target.name}"] == pytest.approx(spearmanr(y, y_hat).statistic)
        # The mean of group means: every group weighs the same, however many candidates it has.
        weight = np.broadcast_to(1 / np.maximum(mask.sum(axis=1, keepdims=True), 1), mask.shape)[mask]
        mae = mean_absolute_error(y, y_hat, sample_weight=weight)
        assert found[f"mae.{target.name}"] == pytest.approx(mae)
        assert found[f"nmae.{target.name}"] == pytest.approx(mae / SCALE.iqr[t])
        assert found[f"nmae_sd.{target.name}"] == pytest.approx(mae / SCALE.sd[t])
    for macro, kind in (("macro_nmae", "nmae"), ("macro_nmae_sd", "nmae_sd")):
        assert found[macro] == pytest.approx(np.mean([found[f"{kind}.{target.name}"] for target in TARGETS]))


def test_perfect_predictions_are_perfect() -> None:
    truth = outcomes(gaps=0.3)
    found = values(truth, perfect(truth))
    for metric in METRICS:
        assert found[metric.name] == pytest.approx(metric.best, abs=1e-12)


def test_a_metric_is_the_mean_of_its_values_by_group() -> None:
    truth = outcomes(gaps=0.6)
    predicted = predictions(truth)
    found, groups = values(truth, predicted, SCALE), by_group(truth, predicted, SCALE)
    for name in PAIRED_METRICS:
        if not name.startswith("macro"):
            same(found[name], np.nanmean(groups[name]))
    assert all(np.isnan(groups[name]).all() for name in NAMES if name not in PAIRED_METRICS)


def test_the_paired_macro_is_the_mean_over_the_targets_of_the_group() -> None:
    truth = without(outcomes(5, gaps=0.0), 0)
    predicted = predictions(truth)
    groups = by_group(truth, predicted, SCALE)
    expected = np.mean([groups[f"nmae.{target.name}"] for target in TARGETS[1:]], axis=0)
    same(groups["macro_nmae"], expected)


def test_with_all_outcomes_both_macros_agree() -> None:
    truth = outcomes(gaps=0.0)
    predicted = predictions(truth)
    same(values(truth, predicted, SCALE)["macro_nmae"], by_group(truth, predicted, SCALE)["macro_nmae"].mean())


def test_a_target_that_is_nowhere_available_has_no_metric_and_no_macro() -> None:
    truth = without(outcomes(gaps=0.0), 2)
    found = values(truth, predictions(truth))
    absent = {name for name in NAMES if np.isnan(found[name])}
    assert absent == {name for name in NAMES if name.endswith(TARGETS[2].name)} | {"macro_nmae", "macro_nmae_sd"}


def test_groups_that_contribute_are_counted() -> None:
    truth = without(outcomes(6, gaps=0.0), 4)
    available = truth.available.copy()
    available[:2, :, 1] = False
    truth = Outcomes(truth.scalars, available, truth.paths, truth.complete)
    constant = predictions(truth).scalars
    constant[5] = 1.0
    found = metric_values(truth, [Predictions.of(constant, truth.paths)], UNIT, np.ones((1, 6))).contributes[0]
    counted = dict(zip(NAMES, found.sum(axis=0).tolist(), strict=True))
    for kind in ("mae", "nmae", "rmse", "spearman"):
        assert [counted[f"{kind}.{target.name}"] for target in TARGETS] == [6, 4, 6, 6, 0, 6]
    assert [counted[f"bank_spearman.{target.name}"] for target in TARGETS] == [5, 3, 5, 5, 0, 5]
    assert counted["macro_nmae"] == counted["ade_m"] == 6


@given(st.integers(0, 30), st.floats(0.01, 100))
def test_units_of_outcomes_do_not_change_normalised_errors(seed: int, factor: float) -> None:
    truth = outcomes(5, seed=seed)
    predicted = predictions(truth, seed=seed + 1)
    scaled = Outcomes(truth.scalars * factor, truth.available, truth.paths, truth.complete)
    other = Predictions.of(predicted.scalars * factor, predicted.paths)
    left = values(truth, predicted, SCALE)
    right = values(scaled, other, Scale(SCALE.iqr * factor, SCALE.sd * factor))
    for name in NAMES:
        unit = factor if name.startswith(("mae", "rmse")) else 1.0
        same(left[name] * unit / max(unit, 1.0), right[name] / max(unit, 1.0))


@given(st.permutations(range(6)), st.permutations(range(5)), st.booleans())
def test_the_order_of_groups_and_candidates_changes_nothing(groups: list[int], bank: list[int], ties: bool) -> None:
    truth = outcomes(6, ties=ties)
    predicted = predictions(truth, ties=ties)
    places = np.ix_(groups, bank)
    moved = Outcomes(*(field[places] for field in (truth.scalars, truth.available, truth.paths, truth.complete)))
    other = Predictions.of(predicted.scalars[places], predicted.paths[places])
    same(list(values(truth, predicted).values()), list(values(moved, other).values()))


@given(st.integers(0, 30))
def test_counting_a_group_twice_is_having_it_twice(seed: int) -> None:
    truth = outcomes(5, seed=seed, ties=True)
    predicted = predictions(truth, seed=seed + 1, ties=True)
    counts = np.random.default_rng(seed).multinomial(5, np.full(5, 0.2))
    rows = np.repeat(np.arange(5), counts)
    found = metric_values(truth, [predicted], UNIT, counts[None].astype(float)).counted[0, 0]
    same(found, list(values(truth.take(rows), predicted.take(rows)).values()))


@given(st.integers(0, 30))
def test_what_is_said_about_absent_outcomes_does_not_matter(seed: int) -> None:
    truth = outcomes(5, seed=seed, gaps=0.5)
    predicted = predictions(truth)
    other = Predictions.of(np.where(truth.available, predicted.scalars, -7.0), predicted.paths)
    same(list(values(truth, predicted).values()), list(values(truth, other).values()))


def test_metrics_have_unique_names_and_units() -> None:
    assert len(set(NAMES)) == len(NAMES) == 42
    units = {metric.name: metric.unit for metric in METRICS}
    assert units["rmse.min_ttc_s"] == "s"
    assert units["nmae.min_ttc_s"] == units["macro_nmae"] == "1"
    assert (units["ade_m"], units["heading_mae_deg"], units["speed_mae_mps"]) == ("m", "deg", "m/s")
