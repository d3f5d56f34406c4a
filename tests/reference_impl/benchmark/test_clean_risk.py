"""The learned risk of a whole drive: what it is fitted on, how it is calibrated, and what it lets selectors choose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.validator.benchmark.samples import contexts, data, data_with_endings, prediction_set, whole_protocol

from branchdrive import UsageError
from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.ending import Endings
from branchdrive.text.table import Table
from branchdrive_reference.benchmark.clean_risk import (
    CLEAN_FROM,
    calibration,
    clean_sections,
    fit_clean,
    judged_clean,
)


def drives(clean: np.ndarray, known: np.ndarray) -> Endings:
    """Endings in which collisions alone part clean drives from others."""
    events, monitored = np.zeros((*clean.shape, 3), bool), np.ones((*clean.shape, 3), bool)
    events[..., 0], monitored[..., 0] = ~clean & known, known
    return Endings(events, monitored, np.ones(clean.shape, bool), np.ones(clean.shape))


def test_a_risk_follows_history_and_candidate_and_leaves_unknown_drives_out() -> None:
    rng = np.random.default_rng(5)
    histories = rng.normal(size=(200, 2))
    clean = np.column_stack([histories[:, 0] > 0, np.ones(200, bool)])
    known = np.ones_like(clean)
    known[:20] = False
    misleading = np.where(known, clean, False)
    far = np.array([[1.5, 0.0], [-1.5, 0.0], [np.nan, np.nan]])
    found = fit_clean(histories, drives(misleading, known), far)
    assert found.shape == (3, 2)
    assert found[0, 0] > 0.6
    assert found[1, 0] < 0.4
    assert (found[:2, 1] > 0.9).all()
    assert fit_clean(histories, drives(misleading, known), far).tolist() == found.tolist()
    with pytest.raises(UsageError, match="end alike, or none is known"):
        fit_clean(histories, drives(np.ones_like(clean), known), far)


def test_calibration_is_that_of_known_drives() -> None:
    said = np.array([[0.05, 0.95], [0.95, 1.0]])
    clean, known = np.array([[False, True], [False, True]]), np.array([[True, True], [True, False]])
    found = calibration(said, drives(clean, known), np.array([0.5, 0.5]))
    assert found.brier == pytest.approx((0.05**2 + 0.05**2 + 0.95**2) / 3)
    assert found.brier_of_shares == pytest.approx(0.25)
    assert found.counts.tolist() == [1, 0, 0, 0, 2]
    assert found.said[[0, 4]].tolist() == pytest.approx([0.05, 0.95])
    assert found.happened[[0, 4]].tolist() == [0.0, 0.5]
    assert np.isnan(found.said[1])


def test_the_best_among_those_judged_clean_else_among_all() -> None:
    scores = np.array([[0.9, 0.5, 0.1], [0.9, 0.5, 0.1]])
    probabilities = np.array([[CLEAN_FROM - 0.1, CLEAN_FROM, 1.0], [0.0, 0.1, 0.2]])
    assert judged_clean(scores, probabilities).shares.argmax(axis=1).tolist() == [1, 0]


def test_tables_show_calibration_and_choices_beside_the_clean_oracle() -> None:
    inputs = ResultInputs.of(whole_protocol(), data_with_endings(), prediction_set())
    first, *others = clean_sections(inputs, contexts())
    assert isinstance(first, Table)
    assert "calibration" in first.title
    assert sum(int(row[1]) for row in first.rows) == inputs.reported.endings.is_known.sum()  # type: ignore[union-attr]
    assert len(others) == len(inputs.protocol.preferences)
    table = others[0]
    assert isinstance(table, Table)
    regrets = {row[0]: row[1] for row in table.rows}
    assert regrets["oracle"] == "0.000"
    assert {"type_prior", "type_prior, judged clean", "E-M3, judged clean", "oracle_clean"} < set(regrets)
    assert any("nothing here is called safe" in note for note in table.notes)
    without = ResultInputs.of(whole_protocol(), data(), prediction_set())
    with pytest.raises(UsageError, match="build it with `--endings`"):
        clean_sections(without, contexts())
    endings = inputs.reported.endings
    assert endings is not None
    unknown = replace(endings, monitored=np.zeros_like(endings.monitored))
    unmonitored = replace(inputs, reported=replace(inputs.reported, endings=unknown))
    with pytest.raises(UsageError, match="no drive of the reported groups was monitored to its end"):
        clean_sections(unmonitored, contexts())
