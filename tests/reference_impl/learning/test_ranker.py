"""The ranker predicts what the models predict, and orders the bank by its utility."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.reference_impl.learning.small_models import SEEDS, SMALL, make_release, small

from branchdrive import UsageError, open_model
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, Profile, Scale, fit_scale, utility
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.ranker import BankRanker
from branchdrive_reference.learning.training import train_model


@pytest.fixture(scope="module")
def trained(release: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Checkpoint]:
    folder = tmp_path_factory.mktemp("trained")
    return [train_model(release, folder, SMALL["M3"], seed=seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def scale(release: Path) -> Scale:
    targets = open_model(release).targets("train")
    return fit_scale(Targets(targets.scalars, targets.scalars_available))


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_it_ranks_by_the_utility_of_the_mean_prediction(
    release: Path, trained: list[Checkpoint], scale: Scale, profile: Profile
) -> None:
    layer = open_model(release)
    ranker, inputs = BankRanker(trained, layer, scale=scale, profile=profile), layer.sensor_inputs("train")
    mean = np.mean([one.scalars for one in predict(trained, layer, "train")], axis=0)
    for row, (state, controls) in enumerate(zip(inputs.state, inputs.controls, strict=True)):
        found = ranker(state, controls)
        np.testing.assert_allclose(found.scalars, mean[row], rtol=1e-5, atol=2e-4)
        expected = utility(Targets(found.scalars, np.ones((13, 6), bool)), scale, profile)
        np.testing.assert_array_equal(found.utilities, expected)
        assert sorted(found.order.tolist()) == list(range(13))
        assert (np.diff(found.utilities[found.order]) <= 0).all()


def test_ties_are_in_canonical_order(release: Path, trained: list[Checkpoint]) -> None:
    layer = open_model(release)
    flat = Scale(np.full(5, 1e6), np.full(5, 2e6))
    inputs = layer.sensor_inputs("val")
    found = BankRanker(trained, layer, scale=flat, profile=PROFILES["balanced"])(inputs.state[0], inputs.controls[0])
    assert np.ptp(found.utilities) == 0
    assert found.order.tolist() == list(range(13))


def test_one_seed_will_do(release: Path, trained: list[Checkpoint], scale: Scale) -> None:
    layer, (one,) = open_model(release), predict(trained[1:2], release, "val")
    inputs = layer.sensor_inputs("val")
    ranker = BankRanker(trained[1:2], layer, scale=scale, profile=PROFILES["safety"])
    found = ranker(inputs.state[0], inputs.controls[0]).scalars
    np.testing.assert_allclose(found, one.scalars[0], rtol=1e-5, atol=2e-4)


def test_other_models_are_refused(release: Path, trained: list[Checkpoint], scale: Scale, tmp_path: Path) -> None:
    layer, other = open_model(release), open_model(make_release(tmp_path / "other", seed=9))
    action = train_model(release, tmp_path, SMALL["M1"], seed=11)
    wider = train_model(release, tmp_path, small("M3", patience=2), seed=11)
    for checkpoints, root, message in (
        ([action], layer, "M1 is no model of histories and actions alone"),
        ([trained[0], wider], layer, "2 checkpoints are not seeds of one configuration"),
        ([], layer, "0 checkpoints are not seeds of one configuration"),
        (trained, other, "was trained under another split or normalisation"),
    ):
        with pytest.raises(UsageError, match=message):
            BankRanker(checkpoints, root, scale=scale, profile=PROFILES["balanced"])
