"""What lies in the staging area of a collection that runs or was killed: list it, settle it, look into it.

A group that is being written is left alone; everything else may change while this looks at it, but what
is copied is whole.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from branchdrive.contract.layout import DESCRIPTOR_FILE, RAW_DIR, STAGING_DIR
from branchdrive.errors import UsageError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.runtime.file_lock import FileLock
from branchdrive.writer.assembly import assemble_shard
from branchdrive.writer.place_log import LOG_FILE
from branchdrive.writer.stage import Stage
from branchdrive.writer.staged_group import StagedGroup

__all__ = ["GroupState", "StagedFacts", "abandon_group", "close_group", "snapshot", "staged_groups"]

_EARLIER_LOG = "places.json"
"""Where earlier versions kept places, whole; a writer reads the shards instead."""

GroupState = Literal["closed", "open", "written now"]


@dataclass(frozen=True)
class StagedFacts:
    """A staged group.

    Attributes:
        index: Its place in the dataset.
        group_id: Its identity.
        state: Whether its collection is over, was cut off, or goes on at this moment.
        num_rollouts: Finished rollouts in it.
        is_committed: Whether a shard holds an earlier state of it, which comes back if it is abandoned.
    """

    index: int
    group_id: str
    state: GroupState
    num_rollouts: int
    is_committed: bool


def _open_stage(root: Path) -> Stage:
    area = root / STAGING_DIR
    if (area / _EARLIER_LOG).is_file() and not (area / LOG_FILE).is_file():
        raise UsageError(
            f"{root}: an earlier version of branchdrive began the collection; run the collector's command again, which "
            "goes on with it"
        )
    if not (area / LOG_FILE).is_file():
        others = sorted(entry.name for entry in area.iterdir()) if area.is_dir() else []
        if others:
            raise UsageError(
                f"{root}: no collection runs or was cut off there; {STAGING_DIR} belongs to a rendering, a build or a "
                "benchmark, and the same command goes on with it"
            )
        raise UsageError(f"{root}: has no staging area, so that no collection runs or was cut off there")
    return Stage(root, read_descriptor(Folder(root)))


def staged_groups(root: Path) -> list[StagedFacts]:
    """The staged groups of the dataset at `root`, by place.

    Raises:
        UsageError: There is no staging area.
        DatasetError: The descriptor cannot be read.
    """
    stage = _open_stage(root)
    with stage.registry():
        committed = stage.read_log().committed
        return [
            StagedFacts(g.index, g.group_id, _state(stage, g), len(g.rollout_ids), g.group_id in committed)
            for g in stage.groups()
        ]


def _state(stage: Stage, group: StagedGroup) -> GroupState:
    lock = stage.group_lock(group.group_id)
    if not _take(lock):
        return "written now"
    lock.release()
    return "closed" if group.is_closed else "open"


def _take(lock: FileLock) -> bool:
    return not FileLock.held_here(lock.path) and lock.acquire(blocking=False)


@contextmanager
def _settled(root: Path, group_id: str) -> Iterator[tuple[Stage, StagedGroup]]:
    stage = _open_stage(root)
    with stage.registry():
        group = next((group for group in stage.groups() if group.group_id == group_id), None)
        if group is None:
            raise UsageError(f"{root}: has no staged group {group_id!r}; `branchdrive staging` lists them")
        lock = stage.group_lock(group_id)
        if not _take(lock):
            raise UsageError(f"group `{group_id}` is written now; wait for its collector or stop it")
        try:
            yield stage, group
        finally:
            lock.release()


def close_group(root: Path, group_id: str) -> None:
    """Declare a staged group's collection over: its finished rollouts go into the dataset as they are.

    Raises:
        UsageError: There is no such group, or it is being written.
    """
    with _settled(root, group_id) as (_, group):
        group.close()


def abandon_group(root: Path, group_id: str) -> None:
    """Remove a staged group with its finished rollouts; an earlier state of it that a shard holds stays.

    Raises:
        UsageError: There is no such group, or it is being written.
    """
    with _settled(root, group_id) as (stage, group):
        stage.drop(group)


@contextmanager
def snapshot(root: Path) -> Iterator[Path]:
    """A finished dataset of everything that the collection at `root` has finished so far, in a folder that is removed.

    Raises:
        UsageError: There is no staging area, or no finished rollout.
        ContractError: A shard would break a spec limit.
    """
    with TemporaryDirectory(prefix="branchdrive-staging-") as folder:
        target = Path(folder)
        _copy(root, target)
        yield target


def _copy(root: Path, target: Path) -> None:
    source = _open_stage(root)
    copy = Stage(target, source.descriptor)
    copy.hold()
    with source.registry():  # nothing is committed, reopened or dropped meanwhile
        num_committed, maps = len(source.read_log().committed), source.load_maps()
        shutil.copyfile(source.folder / LOG_FILE, copy.folder / LOG_FILE)
        shutil.copyfile(root / DESCRIPTOR_FILE, target / DESCRIPTOR_FILE)
        if (root / RAW_DIR).exists():
            shutil.copytree(root / RAW_DIR, target / RAW_DIR, copy_function=_link)
        for group in source.groups():
            folder = copy.groups_dir / group.folder.name
            folder.mkdir()
            for rollout_id in group.rollout_ids:
                shutil.copytree(group.folder / rollout_id, folder / rollout_id, copy_function=_link)
    staged = [group for group in copy.groups() if group.rollout_ids]
    if not staged and not num_committed:
        raise UsageError(f"{root}: no rollout is finished yet; look again later")
    log = copy.read_log()
    for shard in sorted({log.shard_of(group.index) for group in staged}):
        assemble_shard(copy, log, shard, [g for g in staged if log.shard_of(g.index) == shard], maps)
    write_manifest(copy.dataset, build_manifest(copy.dataset))
    copy.remove()
    copy.let_go()


def _link(source: str, target: str) -> str:
    """Copy a file that is never changed in its place: by a link, or by its bytes where the system cannot link."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
    return target
