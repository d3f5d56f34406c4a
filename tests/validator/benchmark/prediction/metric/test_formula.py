"""Formulas of metrics: one for every declared metric, of the declared shape."""

from __future__ import annotations

import numpy as np
from tests.each import each
from tests.validator.statistics.samples import UNIT, outcomes, predictions

from branchdrive.benchmark.prediction.metric.error import group_errors
from branchdrive.benchmark.prediction.metric.formula import FORMULAS, Judged, mean_over_groups
from branchdrive.contract.metric import DECLARED_METRICS, DeclaredMetric
from branchdrive.driving.target import TARGETS

TRUTH = outcomes(7, gaps=0.3)
PREDICTED = predictions(TRUTH)
COUNTS = np.array([[1.0] * 7, [2.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0], [7.0] + [0.0] * 6])
RANKS = np.full((7, len(TARGETS)), 0.5), np.full((3, len(TARGETS)), 0.5)
JUDGED = Judged(TRUTH, PREDICTED, group_errors(TRUTH, PREDICTED), UNIT, COUNTS, *RANKS)


def test_every_declared_metric_has_a_formula_and_no_other() -> None:
    assert sorted(FORMULAS) == sorted(declared.name for declared in DECLARED_METRICS)


@each("declared", DECLARED_METRICS)
def test_a_formula_gives_what_is_declared(declared: DeclaredMetric) -> None:
    formula = FORMULAS[declared.name]
    width = len(TARGETS) if declared.per_target else 1
    assert formula.counted(JUDGED).shape == (3, width)
    assert (formula.by_group is not None) == declared.paired
    if formula.by_group is not None:
        assert formula.by_group(JUDGED).shape == (7, width)


def test_a_mean_over_groups_counts_groups_that_have_a_value() -> None:
    values = np.arange(7.0)[:, None]
    values[3] = np.nan
    found = mean_over_groups(lambda _: values).counted(JUDGED)
    assert found[:, 0].tolist() == [3.0, (0 + 0 + 2 + 4 + 5 + 6) / 6, 0.0]
