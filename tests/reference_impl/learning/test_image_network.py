"""Models of images: whose order counts, what a mask hides, and what they learn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from tests.model_release import CANDIDATES as KEYS
from tests.model_release import make_frames, write_release
from tests.reference_impl.learning.small_models import DECLARED, VISUAL, small
from tests.sampling import sampled
from tests.small_images import add_images, shown_number
from torch import Tensor

from branchdrive import DatasetError, UsageError, open_model
from branchdrive.model.arrays import pack_arrays
from branchdrive.model.normalisation_document import normalisation_document
from branchdrive_reference.learning.configuration import Configuration
from branchdrive_reference.learning.image_network import ImageHistoryEncoder
from branchdrive_reference.learning.network import OutcomeNetwork, build_network, initialise, num_parameters
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.training import train_model, training_data

FEATURES, CANDIDATES = 29, 13
IMAGES = {"M4": "views", "M5": "views", "M6": "bev"}


def made(configuration: Configuration) -> OutcomeNetwork:
    network = build_network(configuration.model, FEATURES)
    assert isinstance(network, OutcomeNetwork)
    initialise(network, seed=3)
    return network


def drawn(num_groups: int = 3) -> dict[str, Tensor]:
    draw = torch.Generator().manual_seed(0)
    return {
        "state": torch.randn(num_groups, 16, 21, generator=draw),
        "controls": torch.randn(num_groups, 80, 3, generator=draw),
        "actions": torch.randn(CANDIDATES, FEATURES, generator=draw),
        "views": torch.randint(0, 256, (num_groups, 16, 6, 48, 72), generator=draw, dtype=torch.uint8),
        "views_mask": torch.ones(num_groups, 16, 6, dtype=torch.bool),
        "bev": torch.randint(0, 17, (num_groups, 16, 1, 64, 256), generator=draw, dtype=torch.uint8),
        "bev_mask": torch.ones(num_groups, 16, 1, dtype=torch.bool),
    }


def outcome(network: OutcomeNetwork, inputs: dict[str, Tensor]) -> Tensor:
    found = network(inputs, num_groups=len(inputs["state"]), num_candidates=len(inputs["actions"]))
    return torch.cat([found.scalars, found.trajectories.flatten(2)], dim=2)


@pytest.mark.parametrize(("name", "number", "paper"), [
    ("M4", 1_721_272, 1.717), ("M5", 2_331_280, 2.333), ("M6", 1_442_984, 1.448),
])  # fmt: skip
def test_declared_sizes_are_near_those_of_the_paper(name: str, number: int, paper: float) -> None:
    found = num_parameters(build_network(DECLARED[name].model, FEATURES))
    assert found == number
    assert found / 1e6 == pytest.approx(paper, rel=0.005)


@pytest.mark.parametrize("name", VISUAL)
def test_candidates_and_groups_are_told_apart_by_themselves(name: str) -> None:
    network, inputs = made(VISUAL[name]), drawn()
    found, order, groups = outcome(network, inputs), torch.randperm(CANDIDATES), torch.tensor([2, 0, 1])
    permuted = outcome(network, {**inputs, "actions": inputs["actions"][order]})
    torch.testing.assert_close(permuted, found[:, order])
    moved = {key: values if key == "actions" else values[groups] for key, values in inputs.items()}
    torch.testing.assert_close(outcome(network, moved), found[groups])


@pytest.mark.parametrize("name", VISUAL)
def test_each_reads_its_images_and_no_others(name: str) -> None:
    network, inputs, mine = made(VISUAL[name]), drawn(), IMAGES[name]
    found = outcome(network, inputs)
    for other in ("views", "bev", "state"):
        changed = {**inputs, other: inputs[other].flip(1)}
        is_read = other == mine or (other == "state" and name == "M5")
        assert torch.equal(outcome(network, changed), found) != is_read


@pytest.mark.parametrize("name", VISUAL)
def test_what_stands_behind_a_mask_does_not_matter(name: str) -> None:
    network, inputs, mine = made(VISUAL[name]), drawn(), IMAGES[name]
    hidden = {**inputs, f"{mine}_mask": inputs[f"{mine}_mask"].clone(), mine: inputs[mine].clone()}
    hidden[f"{mine}_mask"][:, 4:7] = False
    before = outcome(network, hidden)
    hidden[mine][:, 4:7] = 255
    assert torch.equal(outcome(network, hidden), before)
    assert not torch.equal(before, outcome(network, inputs))


def test_a_step_depends_on_its_own_images(monkeypatch: pytest.MonkeyPatch) -> None:
    network, inputs = made(VISUAL["M4"]), drawn()
    encoder = network.contexts["views"]
    assert isinstance(encoder, ImageHistoryEncoder)
    steps = encoder.encode_steps(inputs["views"], inputs["views_mask"])
    alone = [encoder.encode_steps(inputs["views"][:, step], inputs["views_mask"][:, step]) for step in range(16)]
    torch.testing.assert_close(torch.stack(alone, dim=1), steps)
    whole = outcome(network, inputs)
    monkeypatch.setattr("branchdrive_reference.learning.image_network._CHUNK", 2)
    with torch.no_grad():
        torch.testing.assert_close(outcome(network, inputs), whole)


@pytest.mark.parametrize(("changes", "message"), [
    ({"contract": "sensor"}, "stream `semantic_bev` is of track 'privileged' and the input contract 'sensor'"),
    ({"contract": "mixed"}, "stream `semantic_bev` is of track 'privileged' and the input contract 'mixed'"),
    ({"views": DECLARED["M6"].record["model"]["bev"]}, "the encoding 'bev_patches' is not one of `views`"),
    ({"bev": {**DECLARED["M6"].record["model"]["bev"], "encoding": "none"}}, "no image encoding 'none'; there are"),
    ({"views": {**DECLARED["M4"].record["model"]["views"], "encoding": "resnet18"}}, "a `patch_width` goes with"),
])  # fmt: skip
def test_a_configuration_that_cannot_be_is_refused(changes: dict[str, object], message: str) -> None:
    record = DECLARED["M6"].record
    record["model"] |= changes
    with pytest.raises(DatasetError, match=message):
        Configuration.from_record(record)


def test_a_residual_network_plugs_in() -> None:
    record = DECLARED["M4"].record
    record["model"]["views"] |= {"encoding": "resnet18"}
    del record["model"]["views"]["patch_width"]
    network = made(Configuration.from_record(record))
    inputs = drawn() | {"views": torch.randn(3, 16, 6, 512)}
    assert outcome(network, inputs).shape == (3, CANDIDATES, 56)


@pytest.fixture(scope="module")
def telling(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release in which displacement follows from what the pictures show, and from nothing else."""
    partitions = {f"g{i:02}": "val" if i % 4 == 3 else "train" for i in range(24)}
    frames = make_frames(5, assignment=partitions)
    scalars = frames["scalars"]
    shown = np.array([shown_number(group) for group in scalars["group_id"].tolist()])
    scalars["displacement_m"] = np.ma.masked_array(20.0 * shown, np.zeros(len(shown), bool))
    scalars["displacement_available"] = np.ones(len(shown), bool)
    arrays = pack_arrays(frames, sorted(partitions), KEYS)
    root = write_release(
        tmp_path_factory.mktemp("telling") / "release", frames, normalisation=normalisation_document(arrays, partitions)
    )
    return add_images(root, partitions)


@pytest.mark.parametrize(("name", "num_epochs"), sampled([("M4", 30), ("M6", 80)], every=2))
def test_what_only_images_tell_is_learned(telling: Path, tmp_path: Path, name: str, num_epochs: int) -> None:
    configuration = small(name, batch_groups=6, max_epochs=num_epochs, patience=80, learning_rate=0.01)
    checkpoint = train_model(telling, tmp_path, configuration, seed=11)
    found, layer = predict([checkpoint], telling, "val")[0], open_model(telling)
    wanted = layer.targets("val").scalars[:, 0, 2]
    assert np.corrcoef(found.scalars[:, :, 2].mean(1), wanted)[0, 1] > 0.7


@pytest.mark.parametrize("name", sampled(VISUAL, every=3))
def test_training_goes_on_to_the_same_weights(visual_release: Path, tmp_path: Path, name: str) -> None:
    configuration = small(name, max_epochs=3)

    def stop(report: object) -> None:
        raise KeyboardInterrupt

    whole = train_model(visual_release, tmp_path / "whole", configuration, seed=23)
    with pytest.raises(KeyboardInterrupt):
        train_model(visual_release, tmp_path / "parts", configuration, seed=23, on_epoch=stop)
    parts = train_model(visual_release, tmp_path / "parts", configuration, seed=23)
    assert parts.sha256 == whole.sha256
    assert all(torch.equal(whole.weights[key], values) for key, values in parts.weights.items())


def test_images_are_part_of_the_provenance(visual_release: Path, release: Path) -> None:
    data = training_data(open_model(visual_release), VISUAL["M4"])
    assert data["train"]["views"].dtype == torch.uint8
    with pytest.raises(UsageError, match="has no images of the stream 'rgb_surround'"):
        training_data(open_model(release), VISUAL["M4"])
