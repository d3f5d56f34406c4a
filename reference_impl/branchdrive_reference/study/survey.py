"""Read a whole finished dataset for a study, one shard in memory at a time, whatever names it holds."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.cli.progress import Update
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.place import Place, open_store
from branchdrive.raw.reader import Dataset, open_dataset
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.raw.shard import Shard
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.facts import Facts, shard_facts
from branchdrive_reference.study.label import MAX_TEXT_CHARACTERS, label, sentence
from branchdrive_reference.study.study import Study
from branchdrive_reference.study.summary import summarise

__all__ = ["check_names", "open_finished", "study_dataset"]

_NAMES = ("group_id", "scenario_type", "town", "status")
"""Columns of the rollouts table whose text a study counts or prints."""


def open_finished(root: Place) -> Dataset:
    """Open the finished dataset at `root`.

    Raises:
        UsageError: There is none.
        DatasetError: Its descriptor or layout cannot be read safely.
        PlatformError: A store cannot be reached or refuses.
    """
    store = open_store(root)
    for name in (DESCRIPTOR_FILE, MANIFEST_FILE):
        found = store.status(name)
        if found is None or found.kind == "folder":
            raise UsageError(f"{str(root)!r} holds no finished dataset: there is no {name!r}")
    return open_dataset(store)


def study_dataset(root: Place, progress: Update) -> Study:
    """Study the finished dataset at `root`.

    Raises:
        UsageError: There is no finished dataset with a branch group, or one that cannot be read.
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


def check_names(shard: Shard, table: pa.Table, columns: Collection[str]) -> None:
    """Refuse names that are longer than the format allows any text to be.

    Args:
        shard: Where the table lies, for the message.
        table: The decoded rollouts table, text as dictionaries.
        columns: Text columns whose values a reader is shown.

    Raises:
        UsageError: With the column and the beginning of the name.
    """
    for column in columns:
        names = pc.unique(table.column(column).combine_chunks()).dictionary.drop_null()
        longest = max(pc.utf8_length(names).to_pylist(), default=0)
        if longest > MAX_TEXT_CHARACTERS:
            name = next(name for name in names.to_pylist() if len(name) == longest)
            raise UsageError(
                f"{shard.path(ROLLOUTS)!r}: `{column}` holds a text of {longest:,} characters, '{label(name)}', and "
                f"may hold {MAX_TEXT_CHARACTERS:,}; run `branchdrive-validate`"
            )
