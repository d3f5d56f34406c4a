"""Boosted trees: what they keep is what scikit-learn fitted, and they train, lock and predict like other models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from sklearn.ensemble import HistGradientBoostingRegressor
from tests.reference_impl.learning.small_models import MEAN, make_release

from branchdrive.benchmark.protocol.protocol import DeclaredModel
from branchdrive_reference.benchmark.document import trees_protocol
from branchdrive_reference.learning.checkpoint import read_checkpoint
from branchdrive_reference.learning.configuration import Configuration, ModelConfig, TreesConfig
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.training import train_model
from branchdrive_reference.learning.trees import ABSENT, TreesNetwork, tree_rows

SMALL = TreesConfig(iterations=4, leaves=5, learning_rate=0.3, min_rows=3)
CONFIGURATION = replace(MEAN, model=ModelConfig("T3", "privileged", 9, trees=SMALL))


def inputs(num_groups: int = 30, num_candidates: int = 4) -> dict[str, torch.Tensor]:
    """Three of the tensors of a dataset under the privileged contract, with outcomes that follow from them."""
    rng = np.random.default_rng(1)
    state, action = rng.normal(size=(num_groups, 6, 2)), rng.normal(size=(num_candidates, 3))
    scalars = np.repeat(state[:, -1, :1, None] * action[None, :, :1], 6, axis=2) + rng.normal(size=6)
    found = {
        "state": state, "actions": action, "scalars": scalars,
        "surroundings": rng.normal(size=(num_groups, 6, 1)),
        "trajectory": rng.normal(size=(num_groups, num_candidates, 10, 5)),
    }  # fmt: skip
    tensors = {name: torch.from_numpy(values.astype(np.float32)) for name, values in found.items()}
    mask = torch.ones(scalars.shape, dtype=torch.bool)
    mask[:5, :, 0], mask[..., 5] = False, False
    return {**tensors, "mask": mask, "surroundings_mask": torch.arange(num_groups)[:, None, None].expand(-1, 6, 1) > 3}


def test_kept_trees_predict_what_scikit_learn_does() -> None:
    data, network = inputs(), TreesNetwork(SMALL)
    network.fit(data)
    found = network(data, num_groups=30, num_candidates=4)
    rows = tree_rows(data).numpy()
    for target in (0, 3):
        there = data["mask"][..., target].reshape(-1).numpy()
        other = HistGradientBoostingRegressor(
            max_iter=4, max_leaf_nodes=5, learning_rate=0.3, min_samples_leaf=3, early_stopping=False, random_state=0
        ).fit(rows[there], data["scalars"][..., target].reshape(-1).double().numpy()[there])
        np.testing.assert_allclose(found.scalars[..., target].reshape(-1).numpy(), other.predict(rows), atol=1e-12)
    assert (found.scalars[..., 5] == 0).all()
    assert found.trajectories.shape == (30, 4, 10, 5)
    np.testing.assert_allclose(found.trajectories[3, 2], data["trajectory"].double().mean((0, 1)))


def test_rows_hold_what_is_available() -> None:
    rows = tree_rows(inputs()).reshape(30, 4, -1)
    assert rows.shape[2] == 4 * 2 + 4 * 1 + 3
    assert (rows[0, :, 8:12] == ABSENT).all()
    assert (rows[9, :, 8:12] != ABSENT).all()
    assert (rows[9, :, :12] == rows[9, 0, :12]).all()


def test_model_trains_once_and_predicts_from_its_file(tmp_path: Path) -> None:
    release, folder = make_release(tmp_path / "release"), tmp_path / "checkpoints"
    trained = train_model(release, folder, CONFIGURATION, seed=0)
    assert train_model(release, folder, CONFIGURATION, seed=0).sha256 == trained.sha256
    path = folder / "T3-seed0.safetensors"
    assert read_checkpoint(path).configuration == CONFIGURATION
    (found,) = predict([path], release, "test")
    assert found.scalars.shape == (1, 13, 6)
    assert np.isfinite(found.scalars).all()
    (again,) = predict([trained], release, "test")
    assert again.scalars.tolist() == found.scalars.tolist()


@pytest.mark.parametrize("declared", trees_protocol().models[-2:], ids=lambda declared: declared.id)
def test_models_of_the_protocol_are_configured(declared: DeclaredModel) -> None:
    found = Configuration.of(declared)
    assert found.model.trees is not None
    assert (found.model.is_trained, found.model.reads_actions) == (False, True)
