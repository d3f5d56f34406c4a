"""Encoded images: each by itself, kept under the digests of image and encoder, and refused where a contract forbids."""

from __future__ import annotations

import errno
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tests.model_release import ASSIGNMENT, OUTSIDER
from tests.places import packed
from tests.small_images import MEDIA, SHARD, png, semantic_view

from branchdrive import DatasetError, PlatformError, UsageError, open_model
from branchdrive.driving.feature import InputContract
from branchdrive_reference.learning import image_encoder
from branchdrive_reference.learning.feature_cache import FeatureCache, features_key
from branchdrive_reference.learning.groups import BranchGroupDataset
from branchdrive_reference.learning.image_encoder import BevPatches, ResNet18, RgbPatches, open_encoder
from branchdrive_reference.learning.image_inputs import image_arrays

PRIVILEGED, SENSOR = InputContract.PRIVILEGED, InputContract.SENSOR
ENCODERS = {"views": RgbPatches(), "bev": BevPatches()}


@pytest.fixture
def images(visual_release: Path, tmp_path: Path) -> Path:
    """A release with images of one's own."""
    return shutil.copytree(visual_release, tmp_path / "release")


class Counting:
    """An encoder that counts the images that it encodes."""

    encoding = "rgb_patches"

    def __init__(self, digest: str | None = None) -> None:
        self.digest, self.count = digest or RgbPatches().digest, 0

    def encode(self, pictures: Any) -> NDArray[Any]:
        self.count += len(pictures)
        return RgbPatches().encode(pictures)


def test_cells_are_means_of_their_pixels() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (48, 96, 3), np.uint8)
    cells = pixels.reshape(24, 2, 48, 2, 3).astype(int).sum((1, 3))
    expected = ((2 * cells + 4) // 8).reshape(6, 4, 8, 6, 3).transpose(0, 2, 1, 3, 4).reshape(48, 72)
    np.testing.assert_array_equal(RgbPatches().encode([png(pixels)])[0], expected)


@pytest.mark.parametrize("shape", [(90, 160), (9, 16), (7, 5), (200, 340)])
def test_a_pixel_counts_in_a_cell_by_the_part_of_it_that_lies_there(shape: tuple[int, int]) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (*shape, 3), np.uint8)
    sums = pixels.astype(np.int64)
    for axis, num_cells in ((0, 24), (1, 48)):  # of pixels each repeated so often that every cell has whole ones
        parts = np.repeat(sums, num_cells, axis=axis)
        sums = np.add.reduceat(parts, np.arange(num_cells) * shape[axis], axis=axis)
    whole = math.prod(shape)
    expected = ((2 * sums + whole) // (2 * whole)).reshape(6, 4, 8, 6, 3).transpose(0, 2, 1, 3, 4).reshape(48, 72)
    np.testing.assert_array_equal(RgbPatches().encode([png(pixels)])[0], expected)


@pytest.mark.parametrize("shape", [(90, 160), (9, 16), (7, 5), (900, 1600)])
def test_a_picture_of_one_colour_has_cells_of_it(shape: tuple[int, int]) -> None:
    pixels = np.full((*shape, 3), (3, 128, 255), np.uint8)
    cells = RgbPatches().encode([png(pixels)]).reshape(-1, 3)
    assert np.unique(cells, axis=0).tolist() == [[3, 128, 255]]


def test_channels_are_shares_of_cells() -> None:
    view = np.zeros((256, 256), np.uint8)
    view[0:4, 4:8] = 32 | 64 | 8  # the second cell, whole
    view[3, 255] = 128  # a sixteenth of the last cell of the first row
    cells = BevPatches().encode([png(view)])[0].reshape(8, 8, 8, 8, 4).transpose(0, 2, 1, 3, 4).reshape(64, 64, 4)
    assert cells[0, 1].tolist() == [0, 16, 16, 0]
    assert cells[0, 63].tolist() == [0, 0, 0, 1]
    assert cells.sum() == 33


def test_every_image_is_encoded_by_itself() -> None:
    views = [png(semantic_view(number)) for number in (0.1, 0.9)]
    together, alone = BevPatches().encode(views), [BevPatches().encode([view])[0] for view in views]
    np.testing.assert_array_equal(together, np.stack(alone))
    assert (together[0] != together[1]).any()
    assert BevPatches().encode([]).shape == (0, 64, 256)


def test_features_of_a_residual_network_are_kept_as_they_come() -> None:
    class Means(torch.nn.Module):
        def forward(self, pictures: torch.Tensor) -> torch.Tensor:
            return pictures.mean((1, 2, 3))[:, None].expand(-1, 512)

    encoder = ResNet18(Means(), "a")
    dark, bright = (png(np.full((9, 16, 3), value, np.uint8)) for value in (0, 255))
    found = encoder.encode([dark, bright])
    assert found.shape == (2, 512) and found.dtype == np.float32
    assert found[0, 0] < found[1, 0]
    assert encoder.digest != ResNet18(Means(), "b").digest


def test_nothing_is_downloaded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    open_encoder.cache_clear()
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.setattr(image_encoder, "import_module", lambda name: None)
    with pytest.raises(PlatformError, match=r"needs weights at .*resnet18-f37072fd\.pth', and nothing is downloaded"):
        open_encoder("resnet18")

    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(image_encoder, "import_module", missing)
    with pytest.raises(PlatformError, match="needs the package 'torchvision': pip install torchvision"):
        open_encoder("resnet18")


def test_what_is_kept_is_what_is_encoded(images: Path) -> None:
    layer = open_model(images)
    fresh, kept = (image_arrays(layer, "train", PRIVILEGED, ENCODERS) for _ in range(2))
    shapes = {name: values.shape for name, values in fresh.items()}
    assert shapes == {
        "views": (3, 16, 6, 48, 72), "views_mask": (3, 16, 6), "bev": (3, 16, 1, 64, 256), "bev_mask": (3, 16, 1),
    }  # fmt: skip
    for name, values in fresh.items():
        np.testing.assert_array_equal(values, kept[name])
    assert fresh["views_mask"].all() and fresh["views"].std() > 0
    again = Counting()
    image_arrays(layer, "train", SENSOR, {"views": again})
    assert again.count == 0


def test_another_encoder_or_another_image_is_encoded_anew(images: Path) -> None:
    layer = open_model(images)
    first, other = Counting(), Counting(digest="another")
    for encoder in (first, other):
        image_arrays(layer, "val", SENSOR, {"views": encoder})
    assert (first.count, other.count) == (96, 96)
    checksums = layer.images("sensor", "rgb_surround", "val").checksums[0]
    changed = checksums.copy()
    changed[3, 2] = "0" * 16
    keys = [features_key(*about) for about in (("a", checksums), ("b", checksums), ("a", changed), ("a", checksums.T))]
    assert len({*keys}) == 4


@pytest.mark.parametrize(
    ("place", "other"), [("PIL.Image.__version__", "0.1"), ("branchdrive.formats.image_codec._pillow", lambda: None)]
)
def test_another_decoder_is_another_encoder(place: str, other: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def digests() -> set[str]:
        return {RgbPatches().digest, BevPatches().digest, ResNet18(torch.nn.Identity(), "a").digest}

    here = digests()
    monkeypatch.setattr(place, other)
    assert len(here | digests()) == 6


def test_another_torch_gives_other_features(monkeypatch: pytest.MonkeyPatch) -> None:
    here = ResNet18(torch.nn.Identity(), "a").digest
    monkeypatch.setattr(torch, "__version__", "0.1")
    assert here != ResNet18(torch.nn.Identity(), "a").digest


@pytest.mark.parametrize("place", ["pathlib.Path.mkdir", "os.fsync", "pathlib.Path.replace"])
def test_features_that_cannot_be_kept_stop_nothing(images: Path, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "no space left on device")

    layer = open_model(images)
    with monkeypatch.context() as patch:
        patch.setattr(place, fail)
        found = image_arrays(layer, "val", SENSOR, {"views": RgbPatches()})["views"]
    assert not [*images.parent.glob("release.features/*"), *images.parent.glob("release.features/.*")]
    np.testing.assert_array_equal(found, image_arrays(layer, "val", SENSOR, {"views": RgbPatches()})["views"])


def test_images_are_read_from_an_archive_and_nothing_is_kept(images: Path, tmp_path: Path) -> None:
    expected = image_arrays(open_model(images), "val", SENSOR, {"views": RgbPatches()})
    layer = open_model(packed(images, tmp_path / "packed.zip"))
    before = sorted(tmp_path.iterdir())
    for _ in range(2):
        counting = Counting()
        found = image_arrays(layer, "val", SENSOR, {"views": counting})
        assert counting.count == expected["views_mask"].sum() > 0
        assert {*found} == {*expected}
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values)
    assert sorted(tmp_path.iterdir()) == before


def test_a_damaged_file_of_features_counts_as_none(images: Path) -> None:
    layer = open_model(images)
    expected = image_arrays(layer, "val", SENSOR, {"views": RgbPatches()})["views"]
    (file,) = images.with_name("release.features").iterdir()
    for content in (b"", file.read_bytes()[:100], b"\x80\x04N."):
        file.write_bytes(content)
        np.testing.assert_array_equal(image_arrays(layer, "val", SENSOR, {"views": RgbPatches()})["views"], expected)
    assert FeatureCache(file.parent).get(file.stem, (1,), "uint8") is None


def test_an_image_that_is_not_that_of_the_index_is_refused(images: Path) -> None:
    media = images / SHARD / MEDIA
    content = media.read_bytes()
    media.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(DatasetError, match="the image is not that of its checksum"):
        image_arrays(open_model(images), "train", PRIVILEGED, ENCODERS)
    shutil.rmtree(images / "raw")
    with pytest.raises(DatasetError, match="is not here, and images lie in the raw layer; use the release in place"):
        image_arrays(open_model(images), "train", SENSOR, {"views": Counting("unseen")})


@pytest.mark.parametrize("contract", ["sensor", "mixed"])
def test_no_contract_of_a_vehicle_admits_birds_eye_views(images: Path, contract: str) -> None:
    layer = open_model(images)
    for refused in (
        lambda: layer.images(contract, "semantic_bev"),
        lambda: image_arrays(layer, "train", InputContract(contract), {"bev": BevPatches()}),
        lambda: BranchGroupDataset(layer, "train", contract, images={"bev": BevPatches()}),
    ):
        with pytest.raises(
            UsageError, match=f"`semantic_bev` is of track 'privileged' and the input contract '{contract}'"
        ):
            refused()


def test_streams_that_are_no_inputs_are_refused(images: Path, release: Path) -> None:
    layer = open_model(images)
    for stream, message in (
        ("rgb_top_down", "is of track 'debug'"),
        ("controls", "no stream of images 'controls'; there are rgb_surround, rgb_top_down, semantic_bev"),
    ):
        with pytest.raises(UsageError, match=message):
            layer.images("privileged", stream)
    with pytest.raises(UsageError, match=r"has no images of the stream 'rgb_surround'; it claims \[\]"):
        open_model(release).images("sensor", "rgb_surround")
    with pytest.raises(UsageError, match="the encoding 'bev_patches' is not one of the input 'views'"):
        image_arrays(layer, "train", SENSOR, {"views": BevPatches()})


def test_items_hold_images_where_they_are_asked_for(images: Path) -> None:
    data = BranchGroupDataset(images, "train", "privileged", images=ENCODERS)
    item = data[0]
    assert item["views"].dtype == item["bev"].dtype == torch.uint8
    assert item["views"].shape == (16, 6, 48, 72) and bool(item["bev_mask"].all())
    assert "views" not in BranchGroupDataset(images, "train").tensors
    assert data.groups == tuple(sorted(g for g, part in ASSIGNMENT.items() if part == "train" and g != OUTSIDER))
