"""Datasets of groups that are repeated under new identities: with rows, or where so many rows cannot be had without.

A dataset of repeated shards without rows lists as many files as a real one, which are empty. An executor gives, for
each of its shards, what was found and spooled for the shard that it repeats, under identities of its own, and runs all
other tasks. Histories and routes move a little with each repetition, so that groups are no copies of each other.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from branchdrive.contract.layout import DESCRIPTOR_FILE, RAW_DIR, shard_name
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.reading import read_dataset
from branchdrive.engine.shard import ShardResult, ShardTask, spooled_name
from branchdrive.engine.spool import Spool
from branchdrive.files.identities import Identities
from branchdrive.files.survey import take_survey
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest, build_manifest, write_manifest
from branchdrive.formats.parquet import encode_table
from branchdrive.runtime.executor import Died, Executor, Failed
from branchdrive.tables.frame import Frame, Values

__all__ = ["AuditedShard", "Repeating", "audited_shard", "repeat_dataset", "repeated_dataset"]

_IDENTITIES = ("group_id", "rollout_id", "nominal_rollout_id", "trigger_rollout_id")
_MOVED_M = 1000.0
_MOVED_SHARE = 0.05
_KEPT_SHARE = 0.5
"""What a few groups show by chance would be a fault of the whole dataset if all repetitions showed it."""


def _prefixed(table: pa.Table, prefix: str) -> pa.Table:
    for name in _IDENTITIES:
        if name in table.column_names:
            index = table.schema.get_field_index(name)
            renamed = pc.binary_join_element_wise(pa.scalar(prefix), table[name], "")
            table = table.set_column(index, table.schema.field(name), renamed)
    return table


def repeat_dataset(source: Path, target: Path, *, num_groups: int, groups_per_shard: int) -> int:
    """Write a dataset of at least `num_groups` groups to `target` by repeating those of `source`.

    Returns:
        Number of groups written: whole repetitions of the source, `groups_per_shard` or more a shard.
    """
    folders = sorted((source / RAW_DIR).iterdir())
    names = sorted(path.name for path in folders[0].iterdir())
    tables = {name: pa.concat_tables([pq.read_table(folder / name) for folder in folders]) for name in names}
    source_groups = len(pc.unique(tables["rollouts.parquet"]["group_id"]))
    copies_per_shard = -(-groups_per_shard // source_groups)
    num_shards = -(-num_groups // (copies_per_shard * source_groups))
    _begin(target, (source / DESCRIPTOR_FILE).read_bytes())
    for shard in range(num_shards):
        folder = target / RAW_DIR / shard_name(shard)
        folder.mkdir(parents=True)
        for name, table in tables.items():
            copies = [_prefixed(table, f"s{shard}c{copy}-") for copy in range(copies_per_shard)]
            (folder / name).write_bytes(encode_table(pa.concat_tables(copies)))
    write_manifest(Folder(target), build_manifest(Folder(target)))
    return num_shards * copies_per_shard * source_groups


def _begin(target: Path, descriptor: bytes) -> None:
    target.mkdir(parents=True)
    (target / DESCRIPTOR_FILE).write_bytes(descriptor)


@dataclass(frozen=True)
class AuditedShard:
    """A shard as an audit leaves it.

    Attributes:
        result: What was found.
        frames: What it put into the spool, by name.
        descriptor: Bytes of the descriptor of its dataset.
    """

    result: ShardResult
    frames: Mapping[str, Frame]
    descriptor: bytes

    @property
    def num_groups(self) -> int:
        """Its groups."""
        return len(self.result.group_ids)


def audited_shard(root: Path, executor: Executor) -> AuditedShard:
    """The first shard of a dataset."""
    with Spool.temporary() as spool:
        reading = read_dataset(take_survey(Folder.at(root)), frozenset(CATALOGUE), executor, spool=spool)
        result = reading.shards[0]
        name = spooled_name(result.folder)
        frames = {frame: spool.get(f"{name}.{frame}") for frame in result.frames}
    return AuditedShard(result, frames, (root / DESCRIPTOR_FILE).read_bytes())


def repeated_dataset(shard: AuditedShard, target: Path, num_groups: int) -> int:
    """Write a dataset of repeated shards without their rows into the new folder `target`; its number of groups.

    Descriptor and manifest are those of such a dataset. Files of shards are empty: a `Repeating` executor reads none.
    """
    _begin(target, shard.descriptor)
    digests = {DESCRIPTOR_FILE: Folder(target).digest(DESCRIPTOR_FILE)}
    num_shards = -(-num_groups // shard.num_groups)
    for number in range(num_shards):
        folder = f"{RAW_DIR}/{shard_name(number)}"
        (target / folder).mkdir(parents=True)
        for path, digest in shard.result.digests.items():
            name = path.removeprefix(f"{shard.result.folder}/")
            (target / folder / name).touch()
            digests[f"{folder}/{name}"] = digest
    write_manifest(Folder(target), Manifest.of(digests))
    return num_shards * shard.num_groups


class Repeating:
    """An executor whose shards are one shard under new identities, and whose other tasks another executor runs.

    Args:
        shard: What is repeated.
        others: What runs all other tasks.
    """

    def __init__(self, shard: AuditedShard, others: Executor) -> None:
        self._result, self._folder = pickle.dumps(shard.result), shard.result.folder
        self._frames, self._others = shard.frames, others

    def __call__(
        self, function: Callable[[Any], Any], tasks: Sequence[Any], /
    ) -> Iterator[tuple[int, Any | Died | Failed]]:
        """Results of shards first, then of all other tasks."""
        left = []
        for index, task in enumerate(tasks):
            if isinstance(task, ShardTask):
                yield index, self._repeated(task)
            else:
                left.append(index)
        for place, outcome in self._others(function, [tasks[index] for index in left]):
            yield left[place], outcome

    def _repeated(self, task: ShardTask) -> ShardResult:
        number = int(task.folder.rpartition("-")[2])
        result: ShardResult = pickle.loads(self._result)  # noqa: S301  (of this process)
        if task.spool is not None:
            for name, frame in self._frames.items():
                task.spool.put(f"{spooled_name(task.folder)}.{name}", _renamed(name, frame, number, task.folder))
        return _under(result, self._folder, task.folder, number)


def _under(result: ShardResult, folder: str, own: str, number: int) -> ShardResult:
    """The result of a shard of other groups, in another folder."""
    rng = np.random.default_rng(number)

    def name(identity: str) -> str:
        return f"s{number}-{identity}"

    def of_paths(values: Mapping[str, Any]) -> dict[str, Any]:
        return {path.replace(folder, own): value for path, value in values.items()}

    def digests(values: Any) -> Any:
        """Other 63 bits for each value, the same for the same."""
        found, place = np.unique(values, return_inverse=True)
        return rng.integers(0, 2**63, len(found))[place]

    paths = ("digests", "unreadable", "undecodable", "over_limit", "type_mismatches", "metadata_mismatches",
             "trace_mismatches", "media_mismatches", "archive_mismatches", "stored_code")  # fmt: skip
    responses, names = result.responses, Identities(map(name, result.group_ids))
    future = digests(np.concatenate([responses.future, responses.nominal_future]))
    groups = digests(np.concatenate([responses.group, result.track_ends.group]))
    count = len(responses.group)
    expert = responses.expert.copy()
    expert[rng.random(count) >= _KEPT_SHARE, :, 1:] = False
    outcomes = [replace(outcome, group_id=name(outcome.group_id)) for outcome in result.funnel.outcomes]
    for field in paths:
        setattr(result, field, of_paths(getattr(result, field)))
    return replace(
        result,
        folder=own,
        rollout_ids=Identities(map(name, result.rollout_ids)),
        group_ids=names,
        responses=replace(
            responses, group=groups[:count], future=future[:count], nominal_future=future[count:], expert=expert
        ),
        track_ends=result.track_ends._replace(group=groups[count:]),
        outlines=result.outlines._replace(names=names, values=result.outlines.values + number),
        tracks=result.tracks._replace(names=names, digest=digests(result.tracks.digest).astype(np.uint64)),
        funnel=replace(result.funnel, outcomes=outcomes),
    )


def _renamed(table: str, frame: Frame, number: int, folder: str) -> dict[str, Values]:
    """Rows of other groups, whose drives begin elsewhere and differ a little."""
    rng = np.random.default_rng(number)
    found = dict(frame)
    for column in _IDENTITIES:
        if column in frame:
            cells = [None if cell is None else f"s{number}-{cell}" for cell in frame[column].tolist()]
            named = np.array(cells, object)
            absent = np.ma.getmaskarray(frame[column])
            found[column] = np.ma.masked_array(named, absent) if np.ma.isMaskedArray(frame[column]) else named
    if "shard" in frame:
        folders = np.full(len(frame["shard"]), folder, object)
        found["shard"] = np.ma.masked_array(folders, np.ma.getmaskarray(frame["shard"]))
    if table == "routes":
        found["points"] = np.asarray(frame["points"]) + number * _MOVED_M
    if table in ("state", "past_controls"):
        for column, values in frame.items():
            if np.ma.getdata(values).dtype.kind == "f":
                moved = np.ma.getdata(values) * (1 + _MOVED_SHARE * rng.standard_normal(len(values)))
                moved = moved.astype(np.ma.getdata(values).dtype)
                absent = np.ma.getmaskarray(values)
                found[column] = np.ma.masked_array(moved, absent) if np.ma.isMaskedArray(values) else moved
    return found
