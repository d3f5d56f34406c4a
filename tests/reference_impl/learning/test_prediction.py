"""Predictions: complete, finite, in physical units, and only for the release of the training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.model_release import ASSIGNMENT, CANDIDATES, make_arrays, make_frames, shuffled, write_release
from tests.reference_impl.learning.small_models import MEAN, SMALL, make_release

from branchdrive import UsageError, open_model
from branchdrive.model.normalisation_document import normalisation_document
from branchdrive_reference.learning import prediction
from branchdrive_reference.learning.checkpoint import Checkpoint, checkpoint_path
from branchdrive_reference.learning.groups import BranchGroupDataset
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.training import train_model


@pytest.fixture(scope="module")
def trained(release: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Checkpoint]:
    folder = tmp_path_factory.mktemp("trained")
    made = [train_model(release, folder, configuration, seed=11) for configuration in (MEAN, *SMALL.values())]
    return [*made, train_model(release, folder, SMALL["M3"], seed=23)]


@pytest.mark.parametrize("partition", ["train", "val", "test"])
def test_there_is_one_for_each_checkpoint_and_it_is_complete(
    release: Path, trained: list[Checkpoint], partition: str
) -> None:
    layer = open_model(release)
    found = predict(trained, layer, partition)
    assert [(one.model, one.seed) for one in found] == [
        ("M0", 11),
        ("M1", 11),
        ("M2", 11),
        ("M3", 11),
        ("M3r", 11),
        ("M3", 23),
    ]
    num_groups = len(layer.groups(partition))
    for one in found:
        assert (one.groups, one.candidate_order) == (layer.groups(partition), CANDIDATES)
        assert (one.scalars.shape, one.scalars.dtype) == ((num_groups, 13, 6), np.float64)
        assert (one.trajectories.shape, one.trajectories.dtype) == ((num_groups, 13, 10, 5), np.float64)
        assert np.isfinite(one.scalars).all() and np.isfinite(one.trajectories).all()
    assert not np.array_equal(found[3].scalars, found[-1].scalars)


def test_units_are_physical(release: Path, trained: list[Checkpoint]) -> None:
    layer = open_model(release)
    targets, mean = layer.targets("train"), predict(trained[:1], release, "val")[0]
    there = [targets.scalars[..., t][targets.scalars_available[..., t]].mean() for t in range(6)]
    np.testing.assert_allclose(mean.scalars[0, 5], there, rtol=1e-6)
    np.testing.assert_allclose(mean.trajectories[0, 5], targets.trajectories.mean((0, 1)), rtol=1e-5, atol=1e-5)
    outcome = trained[3].network()(BranchGroupDataset(release, "val").tensors, num_groups=1, num_candidates=13)
    found, scalings = predict([trained[3]], release, "val")[0], layer.scalings()
    np.testing.assert_allclose(found.scalars, scalings.scalars.invert(outcome.scalars.numpy()), rtol=0, atol=1e-3)
    paths = scalings.trajectories.invert(outcome.trajectories.numpy())
    np.testing.assert_allclose(found.trajectories, paths, rtol=0, atol=1e-3)


def test_a_network_takes_a_bounded_number_of_groups_together(
    release: Path, trained: list[Checkpoint], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = predict(trained, release, "train")
    monkeypatch.setattr(prediction, "_GROUPS_AT_ONCE", 1)
    assert len(expected[0].groups) > 1
    given: list[int] = []
    whole = prediction.physical

    def watched(outcome: Any, scalings: Any) -> Any:
        given.append(len(outcome.scalars))
        return whole(outcome, scalings)

    monkeypatch.setattr(prediction, "physical", watched)
    for one, other in zip(predict(trained, release, "train"), expected, strict=True):
        np.testing.assert_allclose(one.scalars, other.scalars, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(one.trajectories, other.trajectories, rtol=1e-9, atol=1e-9)
    assert set(given) == {1}


def test_files_do_as_well_as_checkpoints(release: Path, tmp_path: Path) -> None:
    made = train_model(release, tmp_path, SMALL["M3"], seed=11)
    for one, other in zip(
        predict([made], release, "test"), predict([checkpoint_path(tmp_path, "M3", 11)], release, "test"), strict=True
    ):
        np.testing.assert_array_equal(one.scalars, other.scalars)


def test_order_of_rows_changes_no_bit(tmp_path: Path, release: Path, trained: list[Checkpoint]) -> None:
    frames = make_frames()
    normalisation = normalisation_document(make_arrays(frames), ASSIGNMENT)
    other = write_release(tmp_path / "release", shuffled(frames, 3), normalisation=normalisation)
    for one, same in zip(predict(trained, release, "train"), predict(trained, other, "train"), strict=True):
        np.testing.assert_array_equal(one.scalars, same.scalars)
        np.testing.assert_array_equal(one.trajectories, same.trajectories)


def test_outcomes_are_not_read(release: Path, trained: list[Checkpoint], monkeypatch: pytest.MonkeyPatch) -> None:
    layer = open_model(release)

    def refuse(*arguments: Any, **options: Any) -> None:
        raise AssertionError("outcomes were read")

    monkeypatch.setattr(layer, "targets", refuse)
    assert len(predict(trained, layer, "test")) == len(trained)


def test_a_target_without_training_values_is_predicted_as_nothing(tmp_path: Path) -> None:
    frames = make_frames()
    mask = frames["scalars"]["min_ttc_available"]
    frames["scalars"]["min_ttc_available"] = np.zeros_like(mask)
    values = np.ma.getdata(frames["scalars"]["min_ttc_s"])
    frames["scalars"]["min_ttc_s"] = np.ma.masked_array(values, np.ones(len(values), bool))
    release = write_release(tmp_path / "release", frames)
    made = [train_model(release, tmp_path / "out", model, seed=11) for model in (MEAN, SMALL["M3"])]
    for found in predict(made, release, "test"):
        assert np.isfinite(found.scalars).all()
        assert not found.scalars[..., 0].any()
        assert found.scalars[..., 1].all()


def test_another_release_is_refused(tmp_path: Path, trained: list[Checkpoint]) -> None:
    other = make_release(tmp_path / "other", seed=9)
    with pytest.raises(UsageError, match="M3, seed 11, was trained under another split or normalisation"):
        predict([trained[3]], other, "val")


def test_a_partition_must_have_groups(release: Path, trained: list[Checkpoint]) -> None:
    with pytest.raises(UsageError, match="no group is in the partition 'calibration'"):
        predict(trained, release, "calibration")
    with pytest.raises(UsageError, match="no group of the partition 'val' is in the variant 'extended'"):
        predict(trained, release, "val", variant="extended")
    assert [one.groups for one in predict(trained[:1], release, "train", variant="extended")] == [("g1",)]


def test_predicting_leaves_the_weights_alone(release: Path, trained: list[Checkpoint]) -> None:
    before = {name: values.clone() for name, values in trained[3].weights.items()}
    first, second = (predict([trained[3]], release, "val")[0] for _ in range(2))
    np.testing.assert_array_equal(first.scalars, second.scalars)
    assert all(torch.equal(values, before[name]) for name, values in trained[3].weights.items())
