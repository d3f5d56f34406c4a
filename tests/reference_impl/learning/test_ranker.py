"""The ranker predicts what the models predict, and orders the bank by its utility."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.reference_impl.learning.small_models import SEEDS, SMALL, make_release, small
from tests.repo.checkout import ROOT
from tests.sampling import THOROUGH

from branchdrive import UsageError, open_model
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, Profile, Scale, fit_scale, utility
from branchdrive.formats.image_codec import decode_image
from branchdrive_reference.benchmark.camera_latency import camera_contexts, plain_camera_selector
from branchdrive_reference.benchmark.onnx_export import export_selector
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.image_encoder import open_encoder
from branchdrive_reference.learning.prediction import predict
from branchdrive_reference.learning.ranker import BankRanker, CameraRanker, StepRing, can_rank
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


@pytest.fixture(scope="module", params=["M4", "M5"])
def seeing(request: pytest.FixtureRequest, visual_release: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder, configuration = tmp_path_factory.mktemp("seeing"), small(request.param, max_epochs=2)
    return [train_model(visual_release, folder, configuration, seed=seed) for seed in SEEDS[:2]]


def observations(release: Path, group: int) -> list[dict[str, bytes]]:
    """Images of every observation of a validation group, by camera."""
    images = open_model(release).images("sensor", "rgb_surround", "val")
    return [{camera: images.read(group, step, c) for c, camera in enumerate(images.cameras)} for step in range(16)]


def test_one_observation_more_gives_what_the_whole_window_gives(
    visual_release: Path, seeing: list[Checkpoint], scale: Scale
) -> None:
    layer, profile = open_model(visual_release), PROFILES["balanced"]
    ranker = CameraRanker(seeing, layer, scale=scale, profile=profile)
    inputs = layer.sensor_inputs("val")
    history = (inputs.state[0], inputs.controls[0]) if ranker.network.reads else ()
    seen = observations(visual_release, 0)
    for images in (*reversed(seen), *seen):  # the window is the last 16 of them
        ranker.observe(images)
    found = ranker(*history)
    whole = CameraRanker(seeing, layer, scale=scale, profile=profile)
    for images in seen:
        whole.observe(images)
    np.testing.assert_array_equal(found.scalars, whole(*history).scalars)
    mean = np.mean([one.scalars for one in predict(seeing, layer, "val")], axis=0)
    np.testing.assert_allclose(found.scalars, mean[0], rtol=1e-4, atol=2e-4)
    assert (np.diff(found.utilities[found.order]) <= 0).all()


@pytest.mark.parametrize("seeing", ["M5", pytest.param("M4", marks=THOROUGH)], indirect=True)
def test_the_page_asks_the_exported_selector_as_the_ranker_is_asked(
    visual_release: Path, seeing: list[Checkpoint], scale: Scale, tmp_path: Path
) -> None:
    pytest.importorskip("onnxruntime")
    layer, file = open_model(visual_release), tmp_path / "m5.onnx"
    file.write_bytes(export_selector(seeing, layer, scale=scale, profiles=PROFILES))
    ranker, names = CameraRanker(seeing, layer, scale=scale, profile=PROFILES["balanced"]), {}
    inputs, seen = layer.sensor_inputs("val"), observations(visual_release, 0)
    history = {"state": inputs.state[0], "controls": inputs.controls[0]} if ranker.network.reads else {}
    page = (ROOT / "docs/benchmark.md").read_text(encoding="utf-8")
    (block,) = (found for found in re.findall(r"```python\n(.*?)```", page, re.S) if "targets_after" in found)
    exec(block.replace("build/m5.onnx", str(file)), names)
    found = names["targets_after"](seen, {name: np.float32(values) for name, values in history.items()})
    for images in seen:
        ranker.observe(images)
    np.testing.assert_allclose(found, ranker(**history).scalars, rtol=1e-4, atol=2e-4)


def test_the_encoding_is_the_one_that_the_page_describes(visual_release: Path) -> None:
    content = observations(visual_release, 0)[0]["front"]
    pixels = decode_image(content).astype(np.float64)
    fine = np.repeat(np.repeat(pixels, 24, axis=0), 48, axis=1)  # every cell is whole pixels of this
    height, width = pixels.shape[:2]
    means = fine.reshape(24, height, 48, width, 3).mean(axis=(1, 3))
    patches = np.floor(means + 0.5).reshape(6, 4, 8, 6, 3).swapaxes(1, 2).reshape(48, 72)
    (found,) = open_encoder("rgb_patches").encode([content])
    assert np.abs(found - patches).max() <= 1  # a mean of floats may fall to the other side of a half
    assert (found == patches).mean() > 0.99


def test_the_whole_window_is_timed_by_what_it_predicts(visual_release: Path, seeing: list[Checkpoint]) -> None:
    layer = open_model(visual_release)
    (context,) = camera_contexts(layer, "val", 1)
    assert can_rank(seeing)
    assert [len(images) for images in context.window] == [6] * 16
    mean = np.mean([one.scalars for one in predict(seeing, layer, "val")], axis=0)
    np.testing.assert_allclose(plain_camera_selector(seeing, layer)(*context), mean[0], rtol=1e-4, atol=2e-4)


def test_what_was_never_seen_counts_as_no_image(visual_release: Path, seeing: list[Checkpoint], scale: Scale) -> None:
    layer = open_model(visual_release)
    ranker = CameraRanker(seeing, layer, scale=scale, profile=PROFILES["balanced"])
    inputs = layer.sensor_inputs("val")
    history = (inputs.state[0], inputs.controls[0]) if ranker.network.reads else ()
    nothing = ranker(*history).scalars
    for _ in range(20):
        ranker.observe({})
    np.testing.assert_array_equal(ranker(*history).scalars, nothing)
    ranker.observe(observations(visual_release, 0)[0])
    assert (ranker(*history).scalars != nothing).any()
    ranker.reset()
    np.testing.assert_array_equal(ranker(*history).scalars, nothing)
    with pytest.raises(UsageError, match="no camera 'bev'; there are front, front_left"):
        ranker.observe({"bev": b""})
    state, controls = inputs.state[0], inputs.controls[0]
    for given in ((state, None), (None, controls), (None, None) if history else (state, controls)):
        with pytest.raises(UsageError, match="give it that and no more"):
            ranker(*given)


def test_a_ring_keeps_the_last_sixteen_in_order() -> None:
    ring = StepRing(torch.zeros(2, 3))
    for number in range(1, 21):
        ring.push(torch.full((2, 3), float(number)))
        expected = [max(number - 15 + step, 0) for step in range(16)]
        assert ring.window()[1, :, 2].tolist() == expected


def test_other_models_rank_from_no_cameras(release: Path, trained: list[Checkpoint], scale: Scale) -> None:
    with pytest.raises(UsageError, match="M3 is no model of surround views and actions"):
        CameraRanker(trained, open_model(release), scale=scale, profile=PROFILES["balanced"])


def test_other_models_are_refused(release: Path, trained: list[Checkpoint], scale: Scale, tmp_path: Path) -> None:
    layer, other = open_model(release), open_model(make_release(tmp_path / "other", seed=9))
    action = train_model(release, tmp_path, SMALL["M1"], seed=11)
    assert can_rank(trained) and not can_rank([action]) and not can_rank([*trained, action])
    wider = train_model(release, tmp_path, small("M3", patience=2), seed=11)
    for checkpoints, root, message in (
        ([action], layer, "M1 is no model of histories, objects and actions alone"),
        ([trained[0], wider], layer, "2 checkpoints are not seeds of one configuration"),
        ([], layer, "0 checkpoints are not seeds of one configuration"),
        (trained, other, "was trained under another split or normalisation"),
    ):
        with pytest.raises(UsageError, match=message):
            BankRanker(checkpoints, root, scale=scale, profile=PROFILES["balanced"])
