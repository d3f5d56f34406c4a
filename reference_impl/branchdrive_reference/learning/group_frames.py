"""Camera histories of branch groups as items of a torch dataset, read from the raw layer shard by shard.

An item is one group::

    group_id    its identity, to join with what else is known of it; no input
    frames      [16, cameras, height, width, 3] uint8, of the nominal before the branch; without the last axis for maps

The default loader stacks items to batches ``[groups, 16, cameras, ...]``. Of a shard, the index of images alone is in
memory; images are read and decoded one by one. Workers of a loader divide the shards.

Source: paper, "Model Inputs and Targets" (sixteen time steps of six surround cameras).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.text import listed
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.errors import UsageError
from branchdrive.formats.place import Place
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.media.media_folder import FRAMES
from branchdrive.raw.reader import Dataset, open_dataset
from branchdrive.raw.rollout import Rollout
from branchdrive.raw.shard import Shard, rollouts_of
from branchdrive.runtime.environment import install_command

try:
    import torch
    from torch.utils.data import IterableDataset, get_worker_info
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"`branchdrive_reference.learning` needs the package {error.name!r}: {install_command('models')}",
        name=error.name,
    ) from error

__all__ = ["GroupFrames"]

SURROUND = STREAMS["rgb_surround"].cameras


class GroupFrames(IterableDataset[dict[str, Any]]):
    """The images of the cameras of every group before its branch.

    >>> from torch.utils.data import DataLoader
    >>> def loader(dataset: str) -> DataLoader:
    ...     return DataLoader(GroupFrames(dataset, seed=11), batch_size=16, num_workers=2)

    Args:
        dataset: A dataset with its raw layer, or its folder.
        cameras: Cameras of one size, the order of the axis; the six surround cameras by default.
        groups: Ids of the groups; by default all that have a branch and every image.
        offsets: Ticks relative to the branch.
        seed: Draws the order of shards and of groups in them for every `epoch`; without it they are in order.

    Attributes:
        epoch: Number of the pass; set it before each.

    Raises:
        UsageError: The dataset has no such camera or group, or the cameras are of different sizes.
    """

    def __init__(
        self,
        dataset: Dataset | Place,
        cameras: Sequence[str] = SURROUND,
        *,
        groups: Collection[str] | None = None,
        offsets: Sequence[int] = HISTORY_OFFSETS,
        seed: int | None = None,
    ) -> None:
        self._dataset = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
        self._cameras, self._offsets, self._seed = tuple(cameras), tuple(offsets), seed
        self._groups = None if groups is None else frozenset(groups)
        self.epoch = 0
        declared = self._dataset.descriptor.cameras_by_name
        unknown = [camera for camera in self._cameras if camera not in declared]
        if unknown or not self._cameras:
            there = (
                f"it has {listed(sorted(declared))}" if declared else "it has no media; `branchdrive render` adds them"
            )
            asked = f"no cameras {listed(unknown)} in this dataset" if unknown else "no cameras are asked for"
            raise UsageError(f"{asked}; {there}")
        if len({(declared[name].width_px, declared[name].height_px) for name in self._cameras}) > 1:
            raise UsageError(f"cameras {list(self._cameras)} are of different sizes; make a dataset for each size")
        if self._groups is not None and (missing := sorted(self._groups - set(self._dataset.groups))):
            raise UsageError(f"no groups {missing[:3]} among the {len(self._dataset.groups)} groups of this dataset")

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Items of this worker's shards.

        Raises:
            UsageError: A group that was asked for lacks an image.
            DatasetError: A file cannot be read, or an image is not what its index says.
        """
        worker = get_worker_info()
        first, step = (0, 1) if worker is None else (worker.id, worker.num_workers)
        rng = None if self._seed is None else np.random.default_rng([self._seed, self.epoch])
        for shard in _ordered(self._dataset.shards, rng)[first::step]:
            for nominal in _ordered(self._nominals(shard), rng):
                views = [nominal.frames(camera, self._offsets).pixels() for camera in self._cameras]
                frames = torch.from_numpy(np.stack(views, axis=1))
                yield {"group_id": nominal.record["group_id"], "frames": frames}

    def _nominals(self, shard: Shard) -> list[Rollout]:
        """Nominal rollouts of the groups of a shard that are wanted."""
        attempts: dict[str, list[dict[str, Any]]] = {}
        for record in shard.records():
            if record["role"] == "nominal" and (self._groups is None or record["group_id"] in self._groups):
                attempts.setdefault(record["group_id"], []).append(record)
        rows, media = {FRAMES: shard.rows(FRAMES)}, shard.media(self._dataset.descriptor)
        found = [BranchGroup(name, tuple(rollouts_of(of, rows, media))).nominal for name, of in attempts.items()]
        return found if self._groups is not None else [nominal for nominal in found if self._is_whole(nominal)]

    def _is_whole(self, nominal: Rollout) -> bool:
        if nominal.branch_tick is None:
            return False
        wanted = {nominal.branch_tick + offset for offset in self._offsets}
        return all(wanted <= set(nominal.frames(camera).ticks.tolist()) for camera in self._cameras)


def _ordered(items: Sequence[Any], rng: np.random.Generator | None) -> list[Any]:
    return list(items) if rng is None else [items[index] for index in rng.permutation(len(items))]
