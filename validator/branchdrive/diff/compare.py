"""Comparison of two datasets: descriptor, files, and the data of every layer by attempt, row, column and member.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from branchdrive.contract.columns import declared_table, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.identity import claimed_files
from branchdrive.contract.layer import paths_by_table, table_file, table_pattern
from branchdrive.contract.layout import IDENTITY_LAYERS, MANIFEST_FILE, RAW_DIR, STAGING_DIR
from branchdrive.diff.difference import DatasetDifference, TableDifference
from branchdrive.errors import DatasetError
from branchdrive.formats.descriptor_file import differing_values, read_descriptor
from branchdrive.formats.manifest import Manifest, read_manifest
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import conform, join_parts, read_table
from branchdrive.layers.content import file_content, read_document
from branchdrive.raw.content import is_identified, table_content
from branchdrive.raw.shard import Shard, find_shards
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import map_digests
from branchdrive.tables.arrow import from_arrow
from branchdrive.tables.frame import align

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["compare_datasets"]


def compare_datasets(first: Store, second: Store) -> DatasetDifference:
    """Compare two datasets by what they say; neither is judged.

    Raises:
        DatasetError: One is no dataset, or a file of it cannot be read or has other columns than declared.
    """
    ours, theirs = (read_descriptor(dataset) for dataset in (first, second))
    manifests = [_manifest(dataset) for dataset in (first, second)]
    result = DatasetDifference()
    plain = [{**descriptor.model_dump(mode="json"), "layers": []} for descriptor in (ours, theirs)]
    result.descriptor = differing_values(*plain)
    result.files = _files(*manifests)
    result.beside = _beside(first, second, manifests)
    claimed = [{*descriptor.layers} & {*IDENTITY_LAYERS} for descriptor in (ours, theirs)]
    result.layers = [name for name in IDENTITY_LAYERS if name in claimed[0] ^ claimed[1]]
    both = claimed[0] & claimed[1]
    if RAW_DIR in both:
        _compare_raw(result, _RawSide(first, ours), _RawSide(second, theirs))
    _compare_layers(result, (first, second), manifests, both)
    return result


def _manifest(dataset: Store) -> Manifest:
    if dataset.status(MANIFEST_FILE) is None and dataset.status(STAGING_DIR) is not None:
        raise DatasetError(
            f"{dataset}: no {MANIFEST_FILE}: writing was interrupted or goes on; run the same command again to "
            "finish it, or judge what is committed with `branchdrive-validate --staging`"
        )
    return read_manifest(dataset)[0]


def _files(ours: Manifest, theirs: Manifest) -> tuple[int, int, int]:
    shared = ours.files.keys() & theirs.files.keys()
    differing = sum(ours.files[path] != theirs.files[path] for path in shared)
    return differing, len(ours.files) - len(shared), len(theirs.files) - len(shared)


def _beside(first: Store, second: Store, manifests: Sequence[Manifest]) -> tuple[list[str], list[str]]:
    """Names of companions in the folder of one alone: of what is no part of the dataset and in no manifest."""
    ours, theirs = (
        {entry.path for entry in dataset.entries()[1] if not entry.path.startswith(".")}
        - {MANIFEST_FILE, *(path.partition("/")[0] for path in manifest.files)}
        for dataset, manifest in zip((first, second), manifests, strict=True)
    )
    return sorted(ours - theirs), sorted(theirs - ours)


class _RawSide:
    """The raw layer of one dataset: which shard an attempt lies in, what every table says of it, and the maps."""

    def __init__(self, dataset: Store, descriptor: Descriptor) -> None:
        self.shard_of: dict[str, Shard] = {}
        self.content: dict[str, dict[str, bytes]] = {}
        self.shard_of_town: dict[str, Shard] = {}
        self.maps: dict[str, str] = {}
        self.tables = [name for name in descriptor.tables if name != "frames"]
        for shard in find_shards(dataset):
            view = ShardView({name: shard.decode(name) for name in self.tables}, descriptor)
            if not is_identified(view):
                raise DatasetError(f"{shard}: identifiers repeat or lead nowhere; run `branchdrive-validate`")
            by_table = table_content(view, np.arange(view.num_rollouts))  # attempts, where identity takes groups
            for place, rollout_id in enumerate(view.rollout_ids):
                self.shard_of[rollout_id] = shard
                self.content[rollout_id] = {name: digests[place] for name, digests in by_table.items()}
            for town, digest in map_digests(view).items():
                if self.maps.setdefault(town, digest) != digest:
                    raise DatasetError(f"{shard}: has another map of {town!r}; run `branchdrive-validate`")
                self.shard_of_town.setdefault(town, shard)

    def map_of(self, town: str) -> pa.Table:
        """Rows of the map of a town; none where the dataset has none."""
        import pyarrow.compute as pc

        if town not in self.maps:
            return table_schema("map").empty_table()
        rows = self.shard_of_town[town].table("map")
        return rows.filter(pc.equal(rows["town"], town))


def _compare_raw(result: DatasetDifference, ours: _RawSide, theirs: _RawSide) -> None:
    result.only_first = sorted(ours.content.keys() - theirs.content.keys())
    result.only_second = sorted(theirs.content.keys() - ours.content.keys())
    shared = ours.content.keys() & theirs.content.keys()
    result.changed = sorted(one for one in shared if ours.content[one] != theirs.content[one])
    for name in dict.fromkeys((*ours.tables, *theirs.tables)):
        changed = [one for one in result.changed if ours.content[one].get(name) != theirs.content[one].get(name)]
        if not changed:
            continue
        found = result.tables[name] = TableDifference()
        if name not in ours.tables or name not in theirs.tables:
            continue
        for mine, others in zip(_rows(ours, name, changed), _rows(theirs, name, changed), strict=True):
            _add(found, mine, others)
    result.towns = sorted(town for town in {*ours.maps, *theirs.maps} if ours.maps.get(town) != theirs.maps.get(town))
    for town in result.towns:
        _add_rows(result.tables.setdefault("map", TableDifference()), "map", ours.map_of(town), theirs.map_of(town))


def _rows(side: _RawSide, name: str, attempts: Collection[str]) -> Iterator[pa.Table]:
    """Rows of attempts, in order; a shard is decoded again where the one before it is another."""
    current, rows = None, None
    for rollout_id in attempts:
        shard = side.shard_of[rollout_id]
        if rows is None or shard != current:
            current, rows = shard, shard.rows(name)
        yield rows[rollout_id]


def _add(found: TableDifference, ours: pa.Table, theirs: pa.Table) -> None:
    """Compare the rows of one attempt by their key."""
    key = [name for name in ("tick", "actor_id") if name in ours.column_names]
    sides = [{name: table[name].to_numpy() for name in key} for table in (ours, theirs)]
    if not key:
        found.add(ours, theirs, ["rollout_id"])
        return
    pairs = align(sides[0], sides[1], key)
    found.only_first += len(pairs.missing)
    found.only_second += len(pairs.extra)
    found.add(ours.take(pairs.expected), theirs.take(pairs.found), ["rollout_id", *key])


def _compare_layers(
    result: DatasetDifference, datasets: tuple[Store, Store], manifests: Sequence[Manifest], claimed: Collection[str]
) -> None:
    listed = [{path for path in manifest.files if "/" in path} for manifest in manifests]
    ours, theirs = (
        file_content(dataset, claimed_files(claimed, there)) for dataset, there in zip(datasets, listed, strict=True)
    )
    differing = [path for path in sorted(ours.keys() | theirs.keys()) if ours.get(path) != theirs.get(path)]
    for name, paths in paths_by_table(differing).items():
        mine, others = (
            _rows_of(dataset, name, [path for path in paths if path in there])
            for dataset, there in zip(datasets, (ours, theirs), strict=True)
        )
        _add_rows(result.tables.setdefault(table_pattern(name), TableDifference()), name, mine, others)
    for path in (path for path in differing if table_file(path) is None):
        if path in ours and path in theirs:
            result.documents[path] = differing_values(*(read_document(dataset, path) for dataset in datasets))
        else:
            result.documents[path] = [f"only in the {'first' if path in ours else 'second'}"]


def _rows_of(dataset: Store, name: str, paths: Sequence[str]) -> pa.Table:
    """Rows of files of a table with the declared schema: a row that has its part elsewhere is the same row."""
    if not paths:
        return table_schema(name).empty_table()
    return join_parts([conform(read_table(dataset, path, name), name) for path in paths])


def _add_rows(found: TableDifference, name: str, ours: pa.Table, theirs: pa.Table) -> None:
    """Compare rows of a table with the declared schema by their key."""
    key = declared_table(name).key
    pairs = align(from_arrow(ours, name), from_arrow(theirs, name), key)
    found.only_first += len(pairs.missing)
    found.only_second += len(pairs.extra)
    found.add(ours.take(pairs.expected), theirs.take(pairs.found), key)
