"""What a dataset is and holds, from its descriptor, its manifest, its file names and one small table of each shard."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import MANIFEST_FILE, STAGING_DIR
from branchdrive.errors import DatasetError
from branchdrive.formats.manifest import Manifest, read_manifest
from branchdrive.formats.store import Entry, Store
from branchdrive.inspection.table_files import MOST_SHARDS, TableFiles, files_of_tables, media_files
from branchdrive.quality.partition import PARTITIONS
from branchdrive.raw.contexts import Context, contexts_of_quality, contexts_of_shard
from branchdrive.raw.shard import find_shards

__all__ = ["Overview", "look_over"]


@dataclass(frozen=True)
class Overview:
    """What a dataset is and holds, unjudged.

    Attributes:
        dataset: Where it is.
        descriptor: What it says of itself.
        manifest: Its manifest as it is written; ``None`` where there is none that can be read.
        is_staged: Whether a writer's working area lies in it.
        num_shards: Raw shards.
        tables: Files of every table that it claims.
        media: Files of images in raw shards.
        contexts: What is known of each group, by group id; of the first shards alone where there are many.
        faults: What could not be read, a line each.
    """

    dataset: Store
    descriptor: Descriptor
    manifest: Manifest | None
    is_staged: bool
    num_shards: int
    tables: tuple[TableFiles, ...]
    media: tuple[Entry, ...]
    contexts: dict[str, Context]
    faults: tuple[str, ...]

    @property
    def kind(self) -> str:
        """What it is, in a few words."""
        if self.manifest is None:
            return "a collection that is not finished" if self.is_staged else "a dataset without a manifest"
        if not self.descriptor.has_raw:
            return "a detached release: derived layers that name their raw layer by digest"
        return "a release beside its raw layer" if "model" in self.descriptor.layers else "a dataset"

    @property
    def is_all(self) -> bool:
        """Whether every shard was looked at."""
        return self.num_shards <= MOST_SHARDS

    def count(self, column: str) -> Counter[str]:
        """Groups by a column of text, the most frequent value first, equal ones by name."""
        found = Counter(str(context[column]) for context in self.contexts.values() if context.get(column) is not None)
        return Counter(dict(sorted(found.items(), key=lambda item: (-item[1], item[0]))))

    @property
    def partitions(self) -> dict[str, int]:
        """Groups of the frozen population by partition, in the order of documents."""
        frozen = [c for c in self.contexts.values() if c.get("core_valid") and not c.get("near_duplicate")]
        found = Counter(context["partition"] for context in frozen)
        return {name: found[name] for name in PARTITIONS if found[name]}


def look_over(dataset: Store, descriptor: Descriptor) -> Overview:
    """Look a dataset over; what cannot be read is reported and costs nothing else."""
    faults: list[str] = []
    manifest = None
    if dataset.status(MANIFEST_FILE) is not None:
        try:
            manifest = read_manifest(dataset)[0]
        except DatasetError as error:
            faults.append(str(error))
    shards = find_shards(dataset) if descriptor.has_raw else []
    contexts: dict[str, Context] = {}
    for shard in shards[:MOST_SHARDS]:
        try:
            contexts.update(contexts_of_shard(shard))
        except DatasetError as error:
            faults.append(str(error))
    try:
        for group_id, context in contexts_of_quality(dataset, descriptor).items():
            contexts[group_id] = {**context, **contexts.get(group_id, {})}
    except DatasetError as error:
        faults.append(str(error))
    tables = tuple(files_of_tables(dataset, descriptor))
    faults += [f"table {found.table.name!r} {found.fault}" for found in tables if found.fault]
    return Overview(
        dataset, descriptor, manifest, dataset.status(STAGING_DIR) is not None, len(shards), tables,
        tuple(media_files(dataset, descriptor)), contexts, tuple(dict.fromkeys(faults)),
    )  # fmt: skip
