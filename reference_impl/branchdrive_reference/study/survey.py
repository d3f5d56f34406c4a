"""Read a whole dataset for a study, one shard in memory at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from branchdrive.audit.view import ShardView
from branchdrive.cli.progress import Update
from branchdrive.contract.descriptor import Descriptor
from branchdrive.dataset.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.dataset.reader import open_dataset
from branchdrive.dataset.rollout import ROLLOUTS
from branchdrive.dataset.shard import Shard
from branchdrive.errors import DatasetError, UsageError
from branchdrive_reference.study.facts import Facts, shard_facts
from branchdrive_reference.study.fidelity import COMPARED_TABLES
from branchdrive_reference.study.study import Study
from branchdrive_reference.study.summary import summarise

__all__ = ["study_dataset"]


def study_dataset(root: Path, progress: Update) -> Study:
    """Study the finished dataset in the folder `root`.

    Raises:
        UsageError: The folder holds no finished dataset with a branch group, or one that cannot be read.
    """
    for name in (DESCRIPTOR_FILE, MANIFEST_FILE):
        if not (root / name).is_file():
            raise UsageError(f"{str(root)!r} holds no finished dataset: there is no {name!r}")
    try:
        dataset = open_dataset(root)
        if not dataset.groups:
            raise UsageError(f"{str(root)!r} holds no branch group")
        tables = [ROLLOUTS, *(name for name in COMPARED_TABLES if name in dataset.descriptor.tables)]
        parts = []
        for done, shard in enumerate(dataset.shards):
            progress(done, len(dataset.shards))
            parts.append(_facts(shard, tables, dataset.descriptor))
    except DatasetError as error:
        raise UsageError(str(error)) from error
    with np.errstate(all="ignore"):
        return summarise(Facts.merged(parts), dataset.descriptor)


def _facts(shard: Shard, tables: list[str], descriptor: Descriptor) -> Facts:
    """What a shard contributes; its tables leave memory with this call."""
    view = ShardView({name: shard.decode(name) for name in tables}, descriptor)
    with np.errstate(all="ignore"):  # numbers of a faulty collection become unavailable, not warnings
        return shard_facts(view)
