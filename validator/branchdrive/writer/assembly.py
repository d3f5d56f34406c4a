"""Assembly of raw shards: staged groups become one folder of tables that appears whole.

A new shard appears with one rename. Replacing a committed one takes two: the old shard leaves, the
ready one takes its name. A kill between them leaves the shard missing, and the dataset without a
manifest, until the next writer completes the second rename (`install_ready_shards`).

The bytes of a shard depend on its rollouts and on the places of its groups alone, not on the
order, the process or the number of attempts in which they were written.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import RAW_DIR, shard_index, shard_name
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import ContractError, DatasetError, DecodeError, UsageError
from branchdrive.formats.durable import delete, durable_stream, make_dir, move, partial_path, sync_dir, write_file
from branchdrive.formats.media_archive import MEDIA_FILE, MediaArchive, member_name
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.raw.media.media_folder import FRAMES, MediaFolder, places_of
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard import Shard, find_shards
from branchdrive.writer.place_log import CommittedShard, FileState, KnownFile, PlaceLog
from branchdrive.writer.place_note import PlaceNote
from branchdrive.writer.stage import Stage
from branchdrive.writer.staged_group import StagedGroup

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["assemble_shard", "install_ready_shards", "recover_log", "shard_files"]


@dataclass(frozen=True)
class _Member:
    """One rollout of a shard: its place, its row, and its staged group unless the old shard holds it."""

    place: int
    record: dict[str, Any]
    group: StagedGroup | None


def assemble_shard(
    stage: Stage, log: PlaceLog, index: int, groups: Sequence[StagedGroup], maps: Mapping[str, pa.Table]
) -> None:
    """Write raw shard `index` from `groups` and from those groups of the present shard that are not among them.

    Call it under the registry lock; `groups` are closed and are dropped from the stage in the end.
    Memory holds one table of the shard, or one image, at a time. `maps` has the elements of each town, for a dataset
    with maps.

    Raises:
        ContractError: The shard would break a spec limit, rollout ids repeat, or the map of a town is missing;
            nothing changed.
        UsageError: The present shard holds files of others, which would be lost; nothing changed.
    """
    shard = Shard(stage.dataset, index)
    old = shard if shard.folder.exists() else None
    if old is not None:
        _check_files(old, stage)
    members = _members(log, groups, old)
    draft = partial_path(stage.shards_dir / shard_name(index))
    delete(draft)
    draft.mkdir()
    files = {}
    for name in stage.descriptor.tables:
        if name == ROLLOUTS:
            table = _rollouts_table(members, log.groups_per_shard)
        elif name == MAP:
            table = _map_table(members, maps)
        elif name == FRAMES:
            table, archive_digest = _archive_images(members, old, stage.descriptor, draft)
            if table.num_rows:
                files[MEDIA_FILE] = _known(draft / MEDIA_FILE, archive_digest)
        else:
            table = _stream_table(name, members, old)
        path, content = draft / TABLES[name].file_name, _checked_bytes(name, table, index)
        write_file(path, content)
        files[path.name] = _known(path, hashlib.sha256(content).hexdigest())
    sync_dir(draft)
    move(draft, stage.shards_dir / shard_name(index))
    _install(stage, index)
    places = {member.record["group_id"]: member.place for member in members}
    log.append(CommittedShard.of(index, places, [member.record["rollout_id"] for member in members], files))
    for group in groups:
        stage.drop(group)


def _known(path: Path, sha256: str) -> KnownFile:
    """A file that was just written, and that no rename of its folder changes."""
    state = FileState.at(path)
    if state is None:
        raise DatasetError(f"{path}: is gone; no other program may work in the staging area")
    return KnownFile(sha256, state)


def _check_files(old: Shard, stage: Stage) -> None:
    own = set(shard_files(stage.descriptor))
    foreign = sorted(
        f"{RAW_DIR}/{old.folder.name}/{path.name}" for path in old.folder.iterdir() if path.name not in own
    )
    if foreign:
        raise UsageError(f"{stage.root}: {foreign[:5]} have no place in the dataset; move them out of it")


def shard_files(descriptor: Descriptor) -> tuple[str, ...]:
    """Names of the files that a shard may have."""
    tables = tuple(TABLES[name].file_name for name in descriptor.tables)
    return (*tables, MEDIA_FILE) if FRAMES in descriptor.tables else tables


def _members(log: PlaceLog, groups: Sequence[StagedGroup], old: Shard | None) -> list[_Member]:
    members = [_Member(group.index, group.record(i), group) for group in groups for i in group.rollout_ids]
    replaced = {group.group_id for group in groups}
    if old is not None:
        kept = [record for record in old.records() if record["group_id"] not in replaced]
        members += [_Member(log.committed[record["group_id"]], record, None) for record in kept]
    members.sort(key=lambda member: member.record["rollout_id"])
    ids = [member.record["rollout_id"] for member in members]
    if len(set(ids)) < len(ids):
        repeated = sorted({i for i in ids if ids.count(i) > 1})
        raise ContractError(f"rollout ids {repeated} occur in two groups; give every attempt its own rollout_id")
    return members


def _rollouts_table(members: Sequence[_Member], groups_per_shard: int) -> pa.Table:
    import pyarrow as pa

    table = pa.Table.from_pylist([member.record for member in members], schema=table_schema(ROLLOUTS))
    return PlaceNote(groups_per_shard, {member.record["group_id"]: member.place for member in members}).add_to(table)


def _stream_table(name: str, members: Sequence[_Member], old: Shard | None) -> pa.Table:
    import pyarrow as pa

    kept = old.rows(name) if old is not None else None
    pieces = [table_schema(name).empty_table()]
    for member in members:
        rollout_id = member.record["rollout_id"]
        if member.group is not None:
            pieces.append(member.group.table(rollout_id, name))
        elif kept is not None:
            pieces.append(kept[rollout_id])
    return pa.concat_tables(pieces)


def _archive_images(
    members: Sequence[_Member], old: Shard | None, descriptor: Descriptor, draft: Path
) -> tuple[pa.Table, str]:
    """Write the archive of the members' images into the folder `draft`; their index, and its digest.

    None is written without images.
    """
    import pyarrow as pa

    kept = (old.rows(FRAMES), old.media(descriptor)) if old is not None else (None, None)
    pieces = [table_schema(FRAMES).empty_table()]
    with durable_stream(draft / MEDIA_FILE) as stream:
        archive = MediaArchive(stream)
        for member in members:
            rollout_id = member.record["rollout_id"]
            rows, media = kept[0][rollout_id] if kept[0] else None, kept[1]
            if member.group is not None:
                rows, media = member.group.table(rollout_id, FRAMES), member.group.media(rollout_id, descriptor)
            if rows is not None and media is not None:
                pieces.append(_archived(rows, media, archive))
        archive.end()
    if archive.num_bytes > spec_limits().max_media_bytes:
        raise ContractError(
            f"{draft.name}: media of {archive.num_bytes} bytes, more than {spec_limits().max_media_bytes}; write a new "
            "dataset with fewer groups per shard"
        )
    index = pa.concat_tables(pieces)
    if not index.num_rows:
        (draft / MEDIA_FILE).unlink()
    return index, archive.digest


def _archived(rows: pa.Table, media: MediaFolder, archive: MediaArchive) -> pa.Table:
    """Append the images of a rollout to an archive; the rollout's index of it."""
    import pyarrow as pa

    key = zip(*(rows.column(name).to_pylist() for name in ("rollout_id", "tick", "camera", "encoding")), strict=True)
    images = media.read_all(places_of(rows))
    offsets = [archive.add(member_name(*names), image) for names, image in zip(key, images, strict=True)]
    moved = {"file": pa.array([MEDIA_FILE] * len(offsets), pa.string()), "offset_bytes": pa.array(offsets, pa.int64())}
    for name, values in moved.items():
        index = rows.schema.get_field_index(name)
        rows = rows.set_column(index, rows.schema.field(index), values)
    return rows


def _map_table(members: Sequence[_Member], maps: Mapping[str, pa.Table]) -> pa.Table:
    """The maps of the towns that the members drive in."""
    import pyarrow as pa

    towns = sorted({member.record["town"] for member in members})
    missing = [town for town in towns if town not in maps]
    if missing:
        raise ContractError(f"no map of {missing}, where rollouts drive; pass it to `DatasetWriter` in `maps`")
    return pa.concat_tables([maps[town] for town in towns])


def _checked_bytes(name: str, table: pa.Table, index: int) -> bytes:
    """Parquet bytes that are known to decode within the spec limits."""
    content = encode_table(table)
    try:
        decode_table(content, name)
    except DecodeError as error:
        raise ContractError(f"{shard_name(index)}: {error}; write a new dataset with fewer groups per shard") from error
    return content


def _install(stage: Stage, index: int) -> None:
    """Give a ready shard its visible name; after an interruption at any point it can be done again."""
    ready = stage.shards_dir / shard_name(index)
    visible = Shard(stage.dataset, index).folder
    replaced = stage.trash_dir / shard_name(index)
    stage.unfinish()
    make_dir(stage.root / RAW_DIR)
    delete(replaced)
    if visible.exists():
        move(visible, replaced)
    move(ready, visible)
    delete(replaced)


def install_ready_shards(stage: Stage) -> None:
    """Complete the renames that a killed writer left undone; call it under the registry lock."""
    for path in stage.shards_dir.iterdir():
        index = shard_index(path.name)
        if index is not None:
            _install(stage, index)


def recover_log(stage: Stage, groups_per_shard: int, digests: Mapping[str, KnownFile]) -> None:
    """Let the log say what the visible shards hold; call it under the registry lock.

    A shard whose rollouts file is the one that was committed is believed; the note of another one is read.

    Args:
        stage: The staging area, of this or of an earlier version.
        groups_per_shard: Places of one shard.
        digests: Files whose digest is known from elsewhere, by path.

    Raises:
        DatasetError: A shard was not written by this writer, or its note is damaged.
        UsageError: The shards hold another number of groups.
    """
    log = stage.log
    is_right = log.read_on() and log.groups_per_shard == groups_per_shard and not log.is_torn
    shards = find_shards(stage.dataset)
    is_right &= log.shards == [shard.index for shard in shards]
    found = []
    for shard in shards:
        logged = log.read_shard(shard.index)
        found.append(_recovered(stage, shard, logged, groups_per_shard, digests))
        is_right &= found[-1] == logged
    if not is_right:
        log.begin(groups_per_shard, found)


def _recovered(
    stage: Stage, shard: Shard, logged: CommittedShard | None, groups_per_shard: int, digests: Mapping[str, KnownFile]
) -> CommittedShard:
    rollouts = shard.path(ROLLOUTS)
    folder = f"{RAW_DIR}/{shard.folder.name}"
    known = {name: digests[path] for name in shard_files(stage.descriptor) if (path := f"{folder}/{name}") in digests}
    if logged is not None and rollouts not in digests:
        committed = logged.files.get(TABLES[ROLLOUTS].file_name)
        if committed is not None and committed.state == FileState.at(stage.root / rollouts):
            known = {**logged.files, **known}
            _check_size(stage, stage.log.groups_per_shard, groups_per_shard)
            return replace(logged, files=known)
    table = shard.decode(ROLLOUTS)
    note = PlaceNote.of(table, str(shard.folder))
    if note is None:
        raise DatasetError(
            f"{shard.folder}: another program wrote this; `DatasetWriter` can only continue its own datasets"
        )
    _check_size(stage, note.groups_per_shard, groups_per_shard)
    rollout_ids = table.column("rollout_id").to_pylist()
    return CommittedShard.of(shard.index, note.in_shard(shard.index), rollout_ids, known)


def _check_size(stage: Stage, found: int, groups_per_shard: int) -> None:
    if found != groups_per_shard:
        raise UsageError(f"{stage.root}: has {found} groups per shard, not {groups_per_shard}; pass {found}")
