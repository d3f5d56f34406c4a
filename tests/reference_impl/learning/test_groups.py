"""Items of the torch dataset are the numpy arrays of the model layer."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.model_release import CANDIDATES, make_frames, write_release
from torch.utils.data import DataLoader

from branchdrive import InputContract, ModelLayer, UsageError, open_model
from branchdrive.runtime.environment import install_command
from branchdrive_reference.learning.groups import BranchGroupDataset

KEYS = {
    InputContract.SENSOR: {"state", "controls"},
    InputContract.OBJECTS: {"state", "controls", "objects", "objects_mask"},
    InputContract.MIXED: {"state", "controls", "expert"},
    InputContract.PRIVILEGED: {"state", "controls", "expert", "surroundings", "surroundings_mask"},
}
SHARED = {"actions", "scalars", "mask", "trajectory"}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_release(tmp_path_factory.mktemp("model") / "release", make_frames())


@pytest.fixture(scope="module")
def layer(root: Path) -> ModelLayer:
    return open_model(root)


def expected(layer: ModelLayer, contract: InputContract, partition: str) -> dict[str, Any]:
    inputs = getattr(layer, f"{contract.value}_inputs")(partition, normalised=True)
    targets = layer.targets(partition, normalised=True)
    arrays = {name: getattr(inputs, name.replace("_mask", "_available")) for name in KEYS[contract]}
    arrays |= {"scalars": targets.scalars, "mask": targets.scalars_available, "trajectory": targets.trajectories}
    return arrays


@pytest.mark.parametrize("contract", InputContract)
@pytest.mark.parametrize("partition", ["train", "val"])
def test_items_are_the_normalised_arrays(layer: ModelLayer, contract: InputContract, partition: str) -> None:
    dataset = BranchGroupDataset(layer, partition, contract)
    arrays = expected(layer, contract, partition)
    assert dataset.groups == layer.groups(partition)
    assert dataset.candidate_order == CANDIDATES
    for i in range(len(dataset)):
        item = dataset[i]
        assert set(item) == KEYS[contract] | SHARED
        for name, values in arrays.items():
            is_mask = values.dtype == np.bool_
            assert item[name].dtype == (torch.bool if is_mask else torch.float32)
            filled = values[i] if is_mask else np.nan_to_num(values[i], nan=0.0).astype(np.float32)
            np.testing.assert_array_equal(item[name].numpy(), filled, err_msg=name)
        np.testing.assert_array_equal(item["actions"].numpy(), layer.actions())


def test_no_item_holds_a_value_that_is_no_number(layer: ModelLayer) -> None:
    dataset = BranchGroupDataset(layer, "train", InputContract.PRIVILEGED)
    assert not dataset[0]["mask"].all()
    assert all(bool(torch.isfinite(values).all()) for i in range(3) for values in dataset[i].values())


def test_the_default_loader_makes_batches(root: Path) -> None:
    dataset = BranchGroupDataset(root, "train")
    (batch,) = DataLoader(dataset, batch_size=3)
    assert {name: list(values.shape) for name, values in batch.items()} == {
        "state": [3, 16, 21], "controls": [3, 80, 3], "actions": [3, 13, 29], "scalars": [3, 13, 6],
        "mask": [3, 13, 6], "trajectory": [3, 13, 10, 5],
    }  # fmt: skip
    torch.testing.assert_close(batch["state"][2], dataset[2]["state"], rtol=0, atol=0)


def test_a_loss_over_the_mask_has_a_gradient(root: Path) -> None:
    (batch,) = DataLoader(BranchGroupDataset(root, "train"), batch_size=3)
    weight = torch.zeros(29, 6, requires_grad=True)
    error = torch.square(batch["actions"] @ weight - batch["scalars"])
    loss = (error * batch["mask"]).sum() / batch["mask"].sum()
    loss.backward()  # type: ignore[no-untyped-call]
    assert weight.grad is not None
    assert bool(torch.isfinite(weight.grad).all()) and bool(weight.grad.any())


def test_a_variant_selects_items(layer: ModelLayer) -> None:
    assert BranchGroupDataset(layer, "train", variant="extended").groups == ("g1",)
    with pytest.raises(UsageError, match="no group of the partition 'val' is in the variant 'extended'"):
        BranchGroupDataset(layer, "val", variant="extended")


def test_without_an_encoding_there_are_no_actions(tmp_path: Path) -> None:
    root = write_release(tmp_path / "release", make_frames(bare=True), bare=True)
    assert set(BranchGroupDataset(root, "train")[0]) == {"state", "controls", "scalars", "mask", "trajectory"}


@pytest.mark.parametrize("index", [3, -4])
def test_an_item_that_is_not_there_ends_an_iteration(layer: ModelLayer, index: int) -> None:
    dataset = BranchGroupDataset(layer, "train")
    with pytest.raises(IndexError, match=f"item {index} of 3"):
        dataset[index]
    assert len(list(dataset)) == 3


def test_it_shows_its_size_and_shapes(layer: ModelLayer) -> None:
    shown = repr(BranchGroupDataset(layer, "val"))
    assert shown.startswith("BranchGroupDataset(1 groups, sensor: state [16, 21], controls [80, 3], ")


def test_without_torch_the_error_is_the_line_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "branchdrive_reference.learning.groups")
    message = f"needs the package 'torch': {install_command('models')}"
    with pytest.raises(ModuleNotFoundError, match=re.escape(message)):
        importlib.import_module("branchdrive_reference.learning.groups")
