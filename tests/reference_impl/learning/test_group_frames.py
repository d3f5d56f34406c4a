"""`GroupFrames`: whole camera histories of groups, each once, whatever the workers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.validator.writer.invented import BRANCH_TICK, WHOLE_TICKS, make_descriptor, write_rollout

from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.errors import UsageError
from branchdrive.raw.reader import open_dataset
from branchdrive.writer.writer import DatasetWriter

torch = pytest.importorskip("torch")
module = pytest.importorskip("branchdrive_reference.learning.group_frames")

GROUPS = ("g0", "g1", "g2", "g3")
TICKS = tuple(BRANCH_TICK + offset for offset in HISTORY_OFFSETS)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four groups in two shards, the last without its first image."""
    folder = tmp_path_factory.mktemp("groups") / "dataset"
    options: dict[str, Any] = {"num_ticks": WHOLE_TICKS, "has_evidence": False}
    with DatasetWriter(folder, make_descriptor(has_evidence=False, has_media=True), groups_per_shard=2) as writer:
        for group_id in GROUPS:
            with writer.begin_group(group_id) as group:
                write_rollout(group, "nominal", "nominal", frame_ticks=TICKS[group_id == "g3" :], **options)
        writer.finalize()
    return folder


def read(root: Path, camera: str = "bev", **options: Any) -> dict[str, Any]:
    items = list(module.GroupFrames(root, (camera,), **options))
    found = {item["group_id"]: item["frames"] for item in items}
    assert len(found) == len(items)
    return found


def test_items_are_the_histories_of_groups_that_have_every_image(root: Path) -> None:
    found = read(root, "top_down")
    assert list(found) == ["g0", "g1", "g2"]
    for group_id, frames in found.items():
        pixels = open_dataset(root).group(group_id).nominal.frames("top_down", HISTORY_OFFSETS).pixels()
        assert (frames.dtype, tuple(frames.shape)) == (torch.uint8, (16, 1, 4, 5, 3))
        assert (frames[:, 0].numpy() == pixels).all()


def test_batches_are_stacks_of_groups_and_workers_divide_them(root: Path) -> None:
    loader = torch.utils.data.DataLoader(module.GroupFrames(root, ("bev",)), batch_size=2, num_workers=2)
    batches = list(loader)
    assert sorted(name for batch in batches for name in batch["group_id"]) == ["g0", "g1", "g2"]
    assert {tuple(batch["frames"].shape) for batch in batches} == {(2, 16, 1, 4, 5), (1, 16, 1, 4, 5)}


def test_a_seed_draws_the_order_anew_for_every_epoch(root: Path) -> None:
    dataset = module.GroupFrames(root, ("bev",), seed=3)
    orders = set()
    for dataset.epoch in range(8):
        names = [item["group_id"] for item in dataset]
        assert names == [item["group_id"] for item in dataset]
        assert sorted(names) == ["g0", "g1", "g2"]
        orders.add(tuple(names))
    assert len(orders) > 1


def test_chosen_groups_come_alone_and_must_be_whole(root: Path) -> None:
    assert list(read(root, groups=["g2", "g0"])) == ["g0", "g2"]
    assert np.shape(read(root, groups=["g3"], offsets=[0, 0])["g3"]) == (2, 1, 4, 5)
    with pytest.raises(UsageError, match=r"camera `bev` lacks or repeats images at ticks \[5\]"):
        read(root, groups=["g3"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cameras": ("front",)}, r"no cameras `front` in this dataset; it has `bev`, `top_down`"),
        ({"cameras": ()}, "no cameras"),
        ({"groups": ["g9"]}, r"no groups \['g9'\] among the 4 groups"),
    ],
)
def test_what_is_not_there_is_named(root: Path, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        module.GroupFrames(root, **{"cameras": ("bev",), **arguments})
