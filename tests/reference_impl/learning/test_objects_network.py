"""Attention over objects: sets without an order, models that train, lock and are exported like others, trees beside."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.model_release import make_frames, write_release
from tests.reference_impl.learning.small_models import make_release, small

from branchdrive import DatasetError, UsageError, open_model
from branchdrive.driving.target import TARGETS
from branchdrive.driving.utility import PROFILES, Scale
from branchdrive.model.features import OBJECT_FEATURES
from branchdrive_reference.benchmark.document import objects_protocol
from branchdrive_reference.benchmark.onnx_export import TOLERANCE, check_equal, export_selector
from branchdrive_reference.learning.configuration import Configuration, ModelConfig, ObjectsConfig, TreesConfig
from branchdrive_reference.learning.objects_network import ObjectsEncoder, object_parts
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.ranker import BankRanker
from branchdrive_reference.learning.training import train_model
from branchdrive_reference.learning.trees import tree_rows

OBJECTS = ObjectsConfig(observations=3, object_width=6, heads=2, width=5)
M3 = small("M3")
M3O = Configuration(replace(M3.model, name="M3o", contract="objects", objects=OBJECTS), M3.training)
NAMES = [name for name, _ in OBJECT_FEATURES]
SCALE = Scale(np.zeros(len(TARGETS) - 1), np.ones(len(TARGETS) - 1))


def sets(num_groups: int = 4) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """State, objects and mask of sets of up to 32, the last group without any."""
    rng = np.random.default_rng(2)
    state = torch.from_numpy(rng.normal(size=(num_groups, 16, 21)).astype(np.float32))
    objects = torch.from_numpy(rng.uniform(-20, 20, (num_groups, 16, 32, 11)).astype(np.float32))
    mask = torch.from_numpy(np.arange(32) < rng.integers(1, 9, (num_groups, 16, 1)))
    mask[-1] = False
    return state, torch.where(mask[..., None], objects, 0.0), mask


def test_neither_the_order_of_objects_nor_unused_places_mean_anything() -> None:
    encoder, (state, objects, mask) = ObjectsEncoder(OBJECTS), sets()
    found = encoder(state, objects, mask)
    assert found.shape == (4, 5)
    turned = torch.from_numpy(np.random.default_rng(3).permutation(32))
    torch.testing.assert_close(encoder(state, objects[:, :, turned], mask[:, :, turned]), found)
    torch.testing.assert_close(encoder(state, torch.where(mask[..., None], objects, 7.0), mask), found)
    early = objects.clone()
    early[:, :13] += 1.0
    torch.testing.assert_close(encoder(state, early, mask), found)  # three observations are read
    late = objects.clone()
    late[0, 15, 0] += 1.0
    assert (encoder(state, late, mask) - found)[:, :].abs().amax(1).gt(1e-6).tolist() == [True, False, False, False]
    pooled_nothing = torch.nn.functional.gelu(encoder.pool.bias)
    torch.testing.assert_close(found[-1], pooled_nothing)


def test_parts_of_an_object_are_what_their_names_say() -> None:
    one = torch.zeros(len(NAMES))
    for name, value in {"x_m": 30.0, "y_m": 40.0, "vel_x_mps": -6.0, "vel_y_mps": 0.0, "yaw_rad": torch.pi / 2}.items():
        one[NAMES.index(name)] = value
    parts = object_parts(one)
    assert parts.shape == (14,)
    torch.testing.assert_close(parts[-4:], torch.tensor([0.0, 1.0, 1.0, 0.36]), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize(
    "about",
    [{"contract": "sensor"}, {"contract": "privileged"}, {"contract": "objects", "trees": TreesConfig(2, 2, 0.1, 1)}],
)
def test_only_networks_under_their_contract_encode_objects(about: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="`objects` are encoded by networks under the contract 'objects'"):
        ModelConfig("M3o", fusion_width=9, objects=OBJECTS, **about)


def test_a_model_of_objects_trains_predicts_and_is_exported(tmp_path: Path) -> None:
    layer = open_model(make_release(tmp_path / "release"))
    trained = [train_model(layer, tmp_path / "checkpoints", M3O, seed=seed) for seed in (11, 23)]
    (found,) = predict(trained[:1], layer, "test")
    assert found.scalars.shape == (1, 13, 6)
    blind = train_model(layer, tmp_path / "checkpoints", M3, seed=11)
    assert not np.allclose(predict([blind], layer, "test")[0].scalars, found.scalars)
    seen = layer.objects_inputs("test")
    ranker = BankRanker(trained[:1], layer, scale=SCALE, profile=PROFILES["balanced"])
    ranked = ranker(seen.state[0], seen.controls[0], seen.objects[0], seen.objects_available[0])
    np.testing.assert_allclose(ranked.scalars, found.scalars[0], rtol=1e-3, atol=1e-3)
    with pytest.raises(UsageError, match=r"the model reads .*'objects', 'objects_mask'"):
        ranker(seen.state[0], seen.controls[0])
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    content = export_selector(trained, layer, scale=SCALE, profiles={"balanced": PROFILES["balanced"]})
    assert check_equal(content, trained, layer, "test") <= TOLERANCE


def test_a_release_without_objects_says_how_it_gets_them(tmp_path: Path) -> None:
    frames = make_frames()
    del frames["objects"]
    with pytest.raises(DatasetError, match="has no table `objects`, which `branchdrive build --objects` adds"):
        train_model(write_release(tmp_path / "release", frames), tmp_path / "checkpoints", M3O, seed=11)


def test_trees_see_the_nearest_object_last_and_their_number() -> None:
    _, objects, mask = sets()
    rows = tree_rows({"objects": objects, "objects_mask": mask, "actions": torch.eye(2)}).numpy()
    parts = object_parts(objects[:, -1].double())
    for group in range(4):
        own = parts[group][mask[group, -1]].numpy()
        row = rows[2 * group]
        assert row[4 * 14] == len(own)
        if not len(own):
            assert (row[: 4 * 14] == -1000).all()
            continue
        expected = np.concatenate([own[own[:, -2].argmin()], own.mean(0), own.min(0), own.max(0)])
        np.testing.assert_allclose(row[: 4 * 14], expected, atol=1e-6)


def test_the_protocol_has_those_of_trees_and_three_more() -> None:
    models = objects_protocol().models
    assert [(model.id, model.contract) for model in models[-3:]] == [
        ("M3o", "objects"), ("M3or", "objects"), ("T3o", "objects"),
    ]  # fmt: skip
    by_name = {model.id: Configuration.of(model) for model in models}
    for name, other in (("M3o", "M3"), ("M3or", "M3r")):
        added = {"name": name, "contract": "objects", "objects": by_name[name].model.objects}
        assert by_name[name] == replace(by_name[other], model=replace(by_name[other].model, **added))
    assert by_name["T3o"].model == replace(by_name["T3"].model, name="T3o", contract="objects")
