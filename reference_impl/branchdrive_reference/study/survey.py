"""Read a whole dataset for a study, one shard in memory at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from branchdrive.cli.progress import Update
from branchdrive.contract.descriptor import Descriptor
from branchdrive.errors import DatasetError, UsageError
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.raw.shard import Shard
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.facts import Facts, shard_facts
from branchdrive_reference.study.finished import open_finished
from branchdrive_reference.study.label import sentence
from branchdrive_reference.study.rollouts import check_names
from branchdrive_reference.study.study import Study
from branchdrive_reference.study.summary import summarise

__all__ = ["study_dataset"]

_NAMES = ("group_id", "scenario_type", "town", "status")
"""Columns of the rollouts table whose text a study counts or prints."""


def study_dataset(root: Path, progress: Update) -> Study:
    """Study the finished dataset in the folder `root`.

    Raises:
        UsageError: The folder holds no finished dataset with a branch group, or one that cannot be read.
    """
    try:
        dataset = open_finished(root)
        for shard in dataset.shards:
            check_names(shard, shard.decode(ROLLOUTS), _NAMES)
        if not dataset.groups:
            raise UsageError(f"{str(root)!r} holds no branch group")
        parts = []
        for done, shard in enumerate(dataset.shards):
            progress(done, len(dataset.shards))
            parts.append(_facts(shard, dataset.descriptor))
    except DatasetError as error:
        raise UsageError(sentence(error)) from error
    with np.errstate(all="ignore"):
        return summarise(Facts.merged(parts), dataset.descriptor)


def _facts(shard: Shard, descriptor: Descriptor) -> Facts:
    """What a shard contributes; its tables leave memory with this call."""
    view = ShardView({name: shard.decode(name) for name in descriptor.tables}, descriptor)
    with np.errstate(all="ignore"):  # numbers of a faulty collection become unavailable, not warnings
        return shard_facts(view)
