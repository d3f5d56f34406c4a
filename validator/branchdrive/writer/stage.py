"""The staging area `.staging/`: where a dataset grows before its parts become visible.

::

    .staging/
      writer.lock        held by the one `DatasetWriter`
      registry.lock      held for a moment by the process that changes which groups are staged or committed
      places.log         places of a shard, and a line for every committed one: its groups, its attempts, its digests
      maps.arrow         the maps of all towns, where they are claimed
      locks/<group>.lock held by the one `GroupWriter` of a group
      groups/00000007.<group>/<rollout>/<table>.arrow, and media.bin with the images of the rollout
      shards/            shards that wait for their rename into `raw/`
      trash/             folders on their way out
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import MANIFEST_FILE, MAX_SHARD_INDEX, RAW_DIR, STAGING_DIR, WRITER_LOCK
from branchdrive.errors import UsageError
from branchdrive.formats.durable import delete, make_dir, move, partial_path, remove, replace_file
from branchdrive.formats.folder import Folder
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.raw.shard import Shard, rollouts_of
from branchdrive.runtime.file_lock import FileLock
from branchdrive.writer.place_log import LOG_FILE, PlaceLog, place_log
from branchdrive.writer.staged_group import StagedGroup, arrow_bytes

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Stage"]


class Stage:
    """The staging area of the dataset at `root`, which `descriptor` describes."""

    def __init__(self, root: Path, descriptor: Descriptor) -> None:
        self.dataset = Folder(root)
        self.descriptor = descriptor
        self.folder = root / STAGING_DIR
        self.groups_dir = self.folder / "groups"
        self.shards_dir = self.folder / "shards"
        self.trash_dir = self.folder / "trash"
        self._writer_lock = FileLock(self.folder / WRITER_LOCK)
        self._registry_path = self.folder / "registry.lock"
        self._locks_dir = self.folder / "locks"
        self._log_path = self.folder.absolute() / LOG_FILE
        self._maps_path = self.folder / "maps.arrow"

    @property
    def root(self) -> Path:
        """Where the dataset is."""
        return self.dataset.root

    @property
    def is_held(self) -> bool:
        """Whether this object has the staging area for itself, as the dataset's one writer must."""
        return self._writer_lock.is_held

    def hold(self) -> bool:
        """Take the staging area, creating what is missing of it; false if another writer has it."""
        make_dir(self.folder)
        try:
            if not self._writer_lock.acquire(blocking=False):
                return False
        except FileNotFoundError:  # another writer finishes the dataset at this moment
            return False
        for folder in (self.groups_dir, self.shards_dir, self.trash_dir, self._locks_dir):
            make_dir(folder)
        self._registry_path.touch()
        return True

    def let_go(self) -> None:
        """Leave the staging area to the next writer."""
        self._writer_lock.release()

    def remove(self) -> None:
        """Delete the staging area of a finished dataset; call it under the registry lock.

        The log goes first, so that no group can be claimed any more, and the locks go last, the
        writer's after all others, so that the next writer starts from nothing.
        """
        locks = (self._registry_path, self._writer_lock.path)
        delete(self._log_path)
        for path in self.folder.iterdir():
            if path not in locks:
                delete(path)
        for path in locks:
            delete(path)
        with suppress(OSError):  # the next writer may be there already
            self.folder.rmdir()

    @contextmanager
    def registry(self) -> Iterator[None]:
        """Lock under which groups are staged, reopened and committed; hold it for a moment only.

        Raises:
            UsageError: There is no staging area: no `DatasetWriter` has opened the dataset.
        """
        lock = FileLock(self._registry_path)
        try:
            lock.acquire(blocking=True, create=False)
        except FileNotFoundError:
            raise self._unopened_error() from None
        try:
            yield
        finally:
            lock.release()

    def read_log(self) -> PlaceLog:
        """The log of committed shards; call it, and use what it gives, under the registry lock.

        Raises:
            UsageError: No `DatasetWriter` has opened the dataset.
        """
        log = self.log
        if not log.read_on():
            raise self._unopened_error()
        return log

    @property
    def log(self) -> PlaceLog:
        """The log as far as this process has read it, whether or not there is one."""
        return place_log(self._log_path)

    def _unopened_error(self) -> UsageError:
        return UsageError(f"{self.root}: open the dataset with `DatasetWriter` before writing groups")

    def save_maps(self, maps: Mapping[str, pa.Table]) -> None:
        """Keep the maps of all towns, by name, for readers of the staging area."""
        import pyarrow as pa

        if maps:
            replace_file(self._maps_path, arrow_bytes(pa.concat_tables(maps.values())).to_pybytes())

    def load_maps(self) -> dict[str, pa.Table]:
        """The maps of all towns, by name; empty where none are claimed."""
        import pyarrow as pa
        import pyarrow.compute as pc

        if not self._maps_path.exists():
            return {}
        table = pa.ipc.open_file(self._maps_path.read_bytes()).read_all()
        return {town: table.filter(pc.field("town") == town) for town in table.column("town").unique().to_pylist()}

    def group_lock(self, group_id: str) -> FileLock:
        """The lock that the writer of a group holds."""
        return FileLock(self._locks_dir / f"{group_id}.lock")

    def groups(self) -> list[StagedGroup]:
        """Every staged group, by place."""
        return StagedGroup.find_all(self.groups_dir)

    @property
    def is_blank(self) -> bool:
        """Whether nothing was recorded: no shard is there, and no finished rollout waits."""
        shards = any((self.root / RAW_DIR).glob("*")) or any(self.shards_dir.glob("*"))
        return not shards and not any(group.rollout_ids for group in self.groups())

    def clear(self) -> None:
        """Remove staged groups, of which none has a finished rollout; only the dataset's one writer may do so."""
        for group in self.groups():
            self.drop(group)

    def claim(self, group_id: str, index: int) -> tuple[StagedGroup, FileLock]:
        """Open a group for writing, waiting for the process that writes it now.

        A new group is staged empty, a staged one is reopened, a committed one is brought back with
        its rollouts. From now on the dataset is unfinished: its manifest is removed.

        Returns:
            The group, and the lock that its writer holds.

        Raises:
            UsageError: The group or the place is taken otherwise, the place is in no shard, this
                process has the group open, or no `DatasetWriter` has opened the dataset.
        """
        lock = self.group_lock(group_id)
        if FileLock.held_here(lock.path):
            raise UsageError(f"group `{group_id}` is open in this process already; close its writer first")
        while True:
            with self.registry():
                log = self.read_log()
                self._check_place(group_id, index, log)
                if lock.acquire(blocking=False):
                    try:
                        self.unfinish()
                        return self._open_group(group_id, index, log), lock
                    except BaseException:
                        lock.release()
                        raise
            with suppress(FileNotFoundError), lock:
                pass  # the group's writer is done; look again at what it left

    def _check_place(self, group_id: str, index: int, log: PlaceLog) -> None:
        if log.shard_of(index) > MAX_SHARD_INDEX:
            last = (MAX_SHARD_INDEX + 1) * log.groups_per_shard - 1
            raise UsageError(f"place of group `{group_id}` must be at most {last}, found {index}; choose another index")
        staged = {group.group_id: group.index for group in self.groups()}
        place = staged.get(group_id, log.committed.get(group_id, index))
        if place != index:
            raise UsageError(f"group `{group_id}` has place {place}, not {index}")
        holders = [other for other, place in staged.items() if place == index]
        holder = next((other for other in (*holders, log.holder_of(index)) if other not in (group_id, None)), None)
        if holder is not None:
            raise UsageError(f"place {index} of group `{group_id}` is taken by group `{holder}`; choose another index")

    def _open_group(self, group_id: str, index: int, log: PlaceLog) -> StagedGroup:
        group = StagedGroup(self.groups_dir / StagedGroup.folder_name(index, group_id))
        if group.folder.exists():
            group.reopen()
            return group
        draft = StagedGroup(partial_path(group.folder))
        delete(draft.folder)
        draft.folder.mkdir()
        if group_id in log.committed:
            self._bring_back(draft, group_id, Shard(self.dataset, log.shard_of(index)))
        move(draft.folder, group.folder)
        return group

    def _bring_back(self, draft: StagedGroup, group_id: str, shard: Shard) -> None:
        records = [record for record in shard.records() if record["group_id"] == group_id]
        names = [name for name in self.descriptor.tables if name != ROLLOUTS and TABLES[name].is_of_rollouts]
        media = shard.media(self.descriptor)
        for rollout in rollouts_of(records, {name: shard.rows(name) for name in names}, media):
            images = draft.media_buffer(rollout.rollout_id, self.descriptor)
            if images is None:
                draft.add(rollout)
                continue
            with closing(images):
                draft.add(images.take_over(rollout), images)

    def unfinish(self) -> None:
        """Remove the manifest: from now on the dataset is not finished."""
        self.dataset.remove(MANIFEST_FILE)

    def sweep(self) -> None:
        """Clear away what killed processes left behind; only the dataset's one writer may do so."""
        for folder in (self.groups_dir, self.shards_dir, self.trash_dir):
            for path in folder.iterdir():
                if folder == self.trash_dir or path.name.startswith("."):
                    delete(path)

    def drop(self, group: StagedGroup) -> None:
        """Remove a staged group."""
        remove(group.folder, self.trash_dir)
