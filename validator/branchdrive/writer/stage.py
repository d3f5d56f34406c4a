"""The staging area `.staging/`: where a dataset grows before its parts become visible.

::

    .staging/
      writer.lock        held by the one `DatasetWriter`
      registry.lock      held for a moment by whoever changes which groups are staged or committed
      places.json        groups per shard, and the place of every committed group
      maps.arrow         the maps of all towns, where they are claimed
      locks/<group>.lock held by the one `GroupWriter` of a group
      groups/00000007.<group>/<rollout>/<table>.arrow, and media.bin with the images of the rollout
      shards/            shards that wait for their rename into `raw/`
      trash/             folders on their way out
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import MANIFEST_FILE, MAX_SHARD_INDEX, RAW_DIR, STAGING_DIR, WRITER_LOCK
from branchdrive.errors import UsageError
from branchdrive.formats.durable import delete, make_dir, move, partial_path, remove, replace_file
from branchdrive.formats.folder import Folder
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.raw.shard import Shard, rollouts_of
from branchdrive.runtime.file_lock import FileLock
from branchdrive.writer.staged_group import StagedGroup, arrow_bytes

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Places", "Stage"]


@dataclass(frozen=True)
class Places:
    """Where groups belong: place ``i`` lies in shard ``i // groups_per_shard``.

    Attributes:
        groups_per_shard: Places of one shard.
        committed: Place of every group that is in a shard, by group id.
    """

    groups_per_shard: int
    committed: Mapping[str, int]

    def shard_of(self, index: int) -> int:
        """Shard that place `index` lies in."""
        return index // self.groups_per_shard

    def render(self) -> bytes:
        """The places as a JSON document."""
        return dump_json({"committed": dict(self.committed), "groups_per_shard": self.groups_per_shard})

    @classmethod
    def parse(cls, content: bytes) -> Places:
        """The places of a document made by `render`."""
        document = json.loads(content)
        return cls(document["groups_per_shard"], document["committed"])


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
        self._places_path = self.folder / "places.json"
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

        The places go first, so that no group can be claimed any more, and the locks go last, the
        writer's after all others, so that the next writer starts from nothing.
        """
        locks = (self._registry_path, self._writer_lock.path)
        delete(self._places_path)
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

    def load_places(self) -> Places:
        """Places of the committed groups.

        Raises:
            UsageError: No `DatasetWriter` has opened the dataset.
        """
        try:
            content = self._places_path.read_bytes()
        except FileNotFoundError:
            raise self._unopened_error() from None
        return Places.parse(content)

    def _unopened_error(self) -> UsageError:
        return UsageError(f"{self.root}: open the dataset with `DatasetWriter` before writing groups")

    def save_places(self, places: Places) -> None:
        """Record which groups are committed."""
        replace_file(self._places_path, places.render())

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
        """Open a group for writing, waiting for whoever writes it now.

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
                places = self.load_places()
                self._check_place(group_id, index, places)
                if lock.acquire(blocking=False):
                    try:
                        self.unfinish()
                        return self._open_group(group_id, index, places), lock
                    except BaseException:
                        lock.release()
                        raise
            with suppress(FileNotFoundError), lock:
                pass  # the group's writer is done; look again at what it left

    def _check_place(self, group_id: str, index: int, places: Places) -> None:
        if places.shard_of(index) > MAX_SHARD_INDEX:
            last = (MAX_SHARD_INDEX + 1) * places.groups_per_shard - 1
            raise UsageError(f"place of group `{group_id}` must be at most {last}, found {index}; choose another index")
        taken = dict(places.committed) | {group.group_id: group.index for group in self.groups()}
        if taken.get(group_id, index) != index:
            raise UsageError(f"group `{group_id}` has place {taken[group_id]}, not {index}")
        holder = next((other for other, place in taken.items() if place == index and other != group_id), None)
        if holder is not None:
            raise UsageError(f"place {index} of group `{group_id}` is taken by group `{holder}`; choose another index")

    def _open_group(self, group_id: str, index: int, places: Places) -> StagedGroup:
        group = StagedGroup(self.groups_dir / StagedGroup.folder_name(index, group_id))
        if group.folder.exists():
            group.reopen()
            return group
        draft = StagedGroup(partial_path(group.folder))
        delete(draft.folder)
        draft.folder.mkdir()
        if group_id in places.committed:
            self._bring_back(draft, group_id, Shard(self.dataset, places.shard_of(index)))
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
