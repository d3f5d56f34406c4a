"""Faults of cameras: each changes what it says of one attempt's images, and nothing else."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from tests.synthetic import write_dataset
from tests.synthetic_map import map_descriptor, map_tables

from branchdrive import open_dataset
from branchdrive.formats.image_header import read_header
from branchdrive.formats.image_parts import find_flaw
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.testing.media import view
from branchdrive_reference.rendering.fault import (
    DESCRIPTIONS,
    ImageFault,
    Images,
    drawn_image_fault,
    with_image_fault,
)
from branchdrive_reference.rendering.group import GroupRenderer, piece_paths
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.rig import cameras_of

CAMERAS = ("front", "left", "right")
TICKS = tuple(range(0, 50, 5))
IMAGES: Images = {(tick, camera): view(10 * tick + k) for tick in TICKS for k, camera in enumerate(CAMERAS)}
SEED = 4


def changed(fault: ImageFault, rollout_id: str = "g0.nominal.a1") -> tuple[Images, list[tuple[int, str]]]:
    images = with_image_fault(IMAGES, CAMERAS, fault, rollout_id, SEED)
    return images, [at for at in IMAGES if images.get(at) != IMAGES[at]]


def test_every_fault_is_described() -> None:
    assert list(DESCRIPTIONS) == list(ImageFault)


def test_a_dropped_image_is_missing() -> None:
    images, (at,) = changed(ImageFault.DROPPED)
    assert images.keys() == IMAGES.keys() - {at}


def test_a_damaged_image_keeps_its_header_and_loses_its_end() -> None:
    images, (at,) = changed(ImageFault.DAMAGED)
    assert read_header(images[at]) == read_header(IMAGES[at])
    assert find_flaw(images[at], "png") is not None


def test_a_duplicated_image_is_that_of_the_observation_before() -> None:
    images, ((tick, camera),) = changed(ImageFault.DUPLICATED)
    assert images[tick, camera] == IMAGES[tick - 5, camera]


def test_a_late_camera_lags_to_the_end() -> None:
    images, at = changed(ImageFault.LATE)
    (camera,) = {camera for _, camera in at}
    assert [tick for tick, _ in at] == list(range(at[0][0], TICKS[-1] + 1, 5))
    assert all(images[tick, camera] == IMAGES[tick - 5, camera] for tick, _ in at)


def test_swapped_images_are_those_of_the_other_camera() -> None:
    images, (one, other) = changed(ImageFault.SWAPPED)
    assert one[0] == other[0]
    assert (images[one], images[other]) == (IMAGES[other], IMAGES[one])


@pytest.mark.parametrize("fault", ImageFault)
def test_where_and_when_differ_between_attempts(fault: ImageFault) -> None:
    assert len({tuple(changed(fault, f"g{k}.nominal.a1")[1]) for k in range(20)}) > 5


def test_draws_are_of_seed_and_attempt_alone_and_keep_their_rate() -> None:
    rates = {"image_dropped": 0.2, "image_late": 0.5, "partial": 1.0}
    drawn = [drawn_image_fault(f"g{k}.nominal.a1", SEED, rates) for k in range(400)]
    assert drawn == [drawn_image_fault(f"g{k}.nominal.a1", SEED, rates) for k in range(400)]
    assert 50 < drawn.count(ImageFault.DROPPED) < 110
    assert 120 < drawn.count(ImageFault.LATE) < 200
    assert drawn.count(None) == 400 - drawn.count(ImageFault.DROPPED) - drawn.count(ImageFault.LATE)
    assert {drawn_image_fault(f"g{k}.nominal.a1", SEED, {}) for k in range(9)} == {None}


def test_faults_are_drawn_where_images_are_rendered(tmp_path: Path) -> None:
    document = map_descriptor()
    document["collection"]["faults"] = {"image_dropped": 1.0}
    write_dataset(tmp_path / "dataset", {"raw/shard-00000": map_tables()["raw/shard-00001"]}, document)
    cameras = tuple(
        camera for camera in cameras_of(["rgb_surround"], width_px=16, height_px=8) if camera.name in ("front", "rear")
    )
    renderer = GroupRenderer(open_dataset(tmp_path / "dataset"), MediaPlan(cameras))
    renderer.write_piece(tmp_path, 0, 0, "g2", lambda: None)
    _, index = piece_paths(tmp_path, 0)
    counts = Counter(decode_table(index.read_bytes(), "frames")["rollout_id"].to_pylist())
    assert len(counts) == 15
    assert set(counts.values()) == {2 * 26 - 1}
