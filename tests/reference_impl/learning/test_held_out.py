"""A fold trains without the groups that it holds out, and predicts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.reference_impl.learning.small_models import SMALL

from branchdrive import UsageError, open_model
from branchdrive.benchmark.prediction.data import groups_digest
from branchdrive_reference.learning.checkpoint import read_checkpoint
from branchdrive_reference.learning.held_out import HELD_OUT, Fold, open_fold
from branchdrive_reference.learning.pool import Task, train_models
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.training import EpochReport


def test_its_groups_are_no_training_groups(release: Path) -> None:
    layer, whole = open_fold(release, Fold(0, ("g2",))), open_model(release)
    assert layer.groups(HELD_OUT) == ("g2",)
    assert layer.groups("train") == ("g1", "g5")
    assert layer.groups("val") == whole.groups("val")
    assert layer.groups() == whole.groups()
    np.testing.assert_array_equal(layer.targets("train").trajectories, whole.targets("train").trajectories[[0, 2]])
    with pytest.raises(UsageError, match="fold 1 holds out 'g4', which is not a training group"):
        open_fold(release, Fold(1, ("g2", "g4")))


def test_folds_read_no_table_again(release: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = open_model(release)
    expected = open_fold(release, Fold(0, ("g2",))).sensor_inputs("train", normalised=True)
    whole.sensor_inputs(normalised=True)
    folds = [open_fold(whole, Fold(0, ("g2",))), open_fold(whole, Fold(1, ("g1",)))]
    monkeypatch.delattr("branchdrive.model.reader.read_layer_table")
    found = folds[0].sensor_inputs("train", normalised=True)
    np.testing.assert_array_equal(found.state, expected.state)
    np.testing.assert_array_equal(found.controls, expected.controls)
    assert folds[1].groups(HELD_OUT) == ("g1",)
    assert whole.groups("train") == ("g1", "g2", "g5")


def test_folds_of_one_model_and_seed_train_side_by_side(release: Path, tmp_path: Path) -> None:
    folds = [Fold(0, ("g1",)), Fold(1, ("g2", "g5"))]
    tasks = [Task(SMALL["M1"], 11, fold) for fold in folds]
    reports: list[EpochReport] = []
    trained = train_models(release, tmp_path, tasks, on_epoch=reports.append)
    assert {report.fold for report in reports} == {0, 1}
    assert [report.fold for report in reports if report.is_last] == [0, 1]
    assert trained[0].provenance.training_groups_digest == groups_digest(["g2", "g5"])
    assert (trained[0].weights["decoder.bias"] != trained[1].weights["decoder.bias"]).any()
    for task, fold in zip(tasks, folds, strict=True):
        (one,) = predict([read_checkpoint(task.path(tmp_path))], open_fold(release, fold), HELD_OUT)
        assert one.groups == fold.groups
