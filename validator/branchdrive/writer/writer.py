"""The writer of a dataset: opens or resumes it, commits whole shards and finishes it with a manifest.

Whatever a reader can see at any moment is whole, also after ``kill -9``. Finished rollouts, closed
groups and committed shards survive. An attempt that a kill or an exception cuts off before
`RolloutWriter.finish` is not in the dataset, nothing tells that it was made, and its number goes to
the next attempt; `RolloutWriter.abandon` discards in the same way. A rollout that the simulator
ended early is a result and not such a loss: finish it, with status ``partial``.

The finished bytes do not depend on interruptions or on the number of processes. They do not depend
on the order in which groups were begun either, if every group is begun with its ``index``; without
one, a group takes the next free place, and the order decides.

Source: spec/03-layout.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, RAW_DIR
from branchdrive.errors import ContractError, UsageError
from branchdrive.files.identity_print import repeated
from branchdrive.formats.descriptor_file import differing_fields, render_descriptor
from branchdrive.formats.manifest import Manifest, build_manifest, check_against_manifest, read_manifest, write_manifest
from branchdrive.formats.media_archive import MAX_CAMERA_NAME
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard import Shard
from branchdrive.writer.assembly import assemble_shard, install_ready_shards, recover_log, shard_files
from branchdrive.writer.buffer import map_table
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.place_log import FileState, KnownFile, PlaceLog
from branchdrive.writer.stage import Stage

__all__ = ["DatasetWriter"]


class DatasetWriter:
    """Creates or resumes the dataset at `root`; one process at a time may hold it.

    A folder in which no rollout was finished is begun again, whatever descriptor it was begun with.

    Args:
        root: Folder of the dataset; created if it does not exist.
        descriptor: What the dataset is; a resumed dataset must have the same.
        groups_per_shard: Places of one shard: group `index` lies in shard ``index // groups_per_shard``.
        maps: Where the descriptor claims the stream `map`: the elements of each town, each with the columns of
            the table `map` by name, without ``town``; columns that may be null may be left out.

    Raises:
        UsageError: The folder holds something else, another descriptor or another number of groups
            per shard, another writer has it open, `maps` are given and not claimed, or the name of a
            camera is too long for an archive.
        ContractError: An element of a map has an unknown or missing column or a value of a wrong type.
        DatasetError: The folder holds a descriptor or shards that cannot be read, or shards that are
            not of this writer, or a finished dataset whose files are not those of its manifest.
    """

    def __init__(
        self,
        root: str | Path,
        descriptor: Descriptor,
        *,
        groups_per_shard: int = 32,
        maps: Mapping[str, Sequence[Mapping[str, object]]] | None = None,
    ) -> None:
        self.root = Path(root)
        self.descriptor = descriptor
        if groups_per_shard < 1:
            raise UsageError(f"groups_per_shard must be at least 1, found {groups_per_shard}")
        if not isinstance(descriptor, Descriptor):
            raise UsageError(
                f"descriptor must be a `Descriptor`, found {type(descriptor).__name__}; pass Descriptor(...)"
            )
        long = [camera.name for camera in descriptor.cameras if len(camera.name) > MAX_CAMERA_NAME]
        if long:
            raise UsageError(f"cameras {long}: names of at most {MAX_CAMERA_NAME} characters fit into an archive")
        if maps and MAP not in descriptor.tables:
            raise UsageError(
                "maps are given, and the descriptor does not claim the stream `map`; claim it or drop them"
            )
        self._maps = {town: map_table(town, elements) for town, elements in (maps or {}).items()}
        if self.root.exists() and not self.root.is_dir():
            raise UsageError(f"{self.root}: is not a folder; choose another one")
        self.root.mkdir(parents=True, exist_ok=True)
        self._stage = Stage(self.root, descriptor)
        self._check_folder()
        if not self._stage.hold():
            raise UsageError(f"{self.root}: another `DatasetWriter` has the dataset open; wait for it or stop it")
        try:
            self._recover(groups_per_shard)
        except BaseException:
            self.close()
            raise

    def _check_folder(self) -> None:
        """Refuse a folder that is not this dataset, before anything in it is touched."""
        names = {path.name for path in self.root.iterdir()}
        if DESCRIPTOR_FILE in names:
            fields = (
                "; ".join(differing_fields(self._stage.dataset, self.descriptor))
                if self._is_described_otherwise()
                else ""
            )
            if fields and not self._stage.is_blank:
                raise UsageError(
                    f"{self.root}: holds a dataset with another descriptor ({fields}); choose another folder"
                )
        elif any(not name.startswith(".") for name in names):
            raise UsageError(f"{self.root}: is not empty and holds no dataset; choose another folder")

    def _is_described_otherwise(self) -> bool:
        return (self.root / DESCRIPTOR_FILE).read_bytes() != render_descriptor(self.descriptor)

    def _recover(self, groups_per_shard: int) -> None:
        with self._stage.registry():
            self._check_folder()
            digests = self._checked_digests() if self.is_finished else {}
            if not (self.root / DESCRIPTOR_FILE).exists() or self._is_described_otherwise():
                self._stage.clear()  # what a start that failed before its first rollout left
                self._stage.dataset.replace(DESCRIPTOR_FILE, render_descriptor(self.descriptor))
            self._stage.sweep()
            self._stage.save_maps(self._maps)
            install_ready_shards(self._stage)
            recover_log(self._stage, groups_per_shard, digests)

    def _checked_digests(self) -> dict[str, KnownFile]:
        """Digests of a finished dataset, each of which its file was found to have."""
        states = {path: FileState.at(self.root / path) for path in read_manifest(self._stage.dataset)[0].files}
        manifest = check_against_manifest(self._stage.dataset)
        return {path: KnownFile(manifest.files[path], state) for path, state in states.items() if state is not None}

    @property
    def is_finished(self) -> bool:
        """Whether the dataset has its manifest; it loses it as soon as a group is begun."""
        return (self.root / MANIFEST_FILE).exists()

    def begin_group(self, group_id: str, *, index: int | None = None) -> GroupWriter:
        """Open a group for writing: a new one, an open one, or a closed or committed one for further attempts.

        Args:
            group_id: Identity of the group.
            index: The group's place; by default the one it has, or the next after all others, so
                that the order of the calls decides the dataset's bytes.

        Raises:
            UsageError: The id or the place cannot be used, or the writer is closed.
        """
        self._check_open()
        if index is None:
            with self._stage.registry():
                log, staged = self._stage.read_log(), {group.group_id: group.index for group in self._stage.groups()}
                next_place = max(log.last_place, *staged.values(), -1) + 1
                index = staged.get(group_id, log.committed.get(group_id, next_place))
        return GroupWriter(self.root, self.descriptor, group_id, index)

    @property
    def places(self) -> dict[str, int]:
        """Place of every group that was begun, by its id."""
        self._check_open()
        with self._stage.registry():
            return self._stage.read_log().committed | {group.group_id: group.index for group in self._stage.groups()}

    @property
    def closed(self) -> frozenset[str]:
        """Ids of the groups whose collection is over: closed in the stage, or committed in a shard."""
        self._check_open()
        with self._stage.registry():
            staged = {group.group_id: group.is_closed for group in self._stage.groups()}
            committed = self._stage.read_log().committed
            return frozenset(staged.keys() | committed.keys()) - {i for i, is_closed in staged.items() if not is_closed}

    def is_closed(self, group_id: str) -> bool:
        """Whether the group's collection is over: see `closed`."""
        self._check_open()
        with self._stage.registry():
            for group in self._stage.groups():
                if group.group_id == group_id:
                    return group.is_closed
            return group_id in self._stage.read_log().committed

    def commit(self) -> int:
        """Write every shard whose places are all taken by closed groups; the number of shards written.

        Raises:
            ContractError: A shard would break a spec limit, or rollout ids repeat in it.
            UsageError: The writer is closed.
        """
        self._check_open()
        return sum(self._commit_shard(shard, partial=False) for shard in self._staged_shards(partial=False))

    def _staged_shards(self, *, partial: bool) -> list[int]:
        """Shards with staged groups; those with a free place if `partial` only."""
        with self._stage.registry():
            log = self._stage.read_log()
            places: dict[int, set[int]] = {}
            for group in self._stage.groups():
                places.setdefault(log.shard_of(group.index), set()).add(group.index)
            return sorted(shard for shard, taken in places.items() if partial or _is_full(log, shard, taken))

    def _commit_shard(self, shard: int, *, partial: bool) -> bool:
        """Write one shard unless a group in it is open or, if not `partial`, a place in it is free."""
        with self._stage.registry():
            log = self._stage.read_log()
            groups = [group for group in self._stage.groups() if log.shard_of(group.index) == shard]
            filled = [group for group in groups if group.rollout_ids]
            if not filled or not all(group.is_closed for group in groups):
                return False
            if not partial and not _is_full(log, shard, (group.index for group in groups)):
                return False
            assemble_shard(self._stage, log, shard, filled, self._maps)
            return True

    def finalize(self) -> str:
        """Write the remaining shards and then, last of all, the manifest; close the writer.

        A finished dataset that nothing was added to is left as it is.

        Returns:
            The identity of the dataset, 64 hexadecimal digits.

        Raises:
            UsageError: A group is open, there is no rollout at all, the folder holds files that are
                not the writer's, or the writer is closed. The dataset is not finished then.
            DatasetError: The folder holds a link or a special file, or a finished dataset has changed.
            ContractError: Rollout ids repeat, or a shard would break a spec limit.
        """
        self._check_open()
        self._check_none_open()
        if self.is_finished:  # and nothing was added to it
            with self._stage.registry():
                known = self._known_digests(self._stage.read_log())
            identity = check_against_manifest(self._stage.dataset, known=known).identity
            self.close()
            return identity
        for shard in self._staged_shards(partial=True):
            self._commit_shard(shard, partial=True)
        with self._stage.registry():
            self._check_none_open()
            log = self._stage.read_log()
            self._check_rollouts(log)
            for empty in self._stage.groups():
                self._stage.drop(empty)
            manifest = build_manifest(self._stage.dataset, known=self._known_digests(log))
            self._check_places(manifest, log)
            write_manifest(self._stage.dataset, manifest)
            self._stage.remove()  # no other writer can begin before this
        self._stage.let_go()
        return manifest.identity

    def _known_digests(self, log: PlaceLog) -> dict[str, str]:
        """Digests, by path, of files that have not changed since they were written or checked."""
        digests = {}
        for index in log.shards:
            committed, folder = log.read_shard(index), Shard(self._stage.dataset, index).folder
            for name, file in committed.files.items() if committed is not None else ():
                if file.state == FileState.at(folder / name):
                    digests[f"{RAW_DIR}/{folder.name}/{name}"] = file.sha256
        return digests

    def _check_none_open(self) -> None:
        open_groups = [group.group_id for group in self._stage.groups() if not group.is_closed]
        if open_groups:
            raise UsageError(f"{self.root}: groups {open_groups} are open; close each with `begin_group(...).close()`")

    def _check_rollouts(self, log: PlaceLog) -> None:
        prints = {index: shard.rollout_prints for index in log.shards if (shard := log.read_shard(index)) is not None}
        if not any(map(len, prints.values())):
            raise UsageError(f"{self.root}: there is no rollout to finish a dataset with")
        ids = sorted(repeated(prints, self._rollout_ids))
        if ids:
            raise ContractError(f"rollout ids {ids} occur in two groups; give every attempt its own rollout_id")

    def _rollout_ids(self, shard: int) -> list[str]:
        ids: list[str] = Shard(self._stage.dataset, shard).decode(ROLLOUTS).column("rollout_id").to_pylist()
        return ids

    def _check_places(self, manifest: Manifest, log: PlaceLog) -> None:
        shards = (Shard(self._stage.dataset, index) for index in log.shards)
        own = {DESCRIPTOR_FILE} | {
            f"{RAW_DIR}/{shard.folder.name}/{name}" for shard in shards for name in shard_files(self.descriptor)
        }
        foreign = sorted(set(manifest.files) - own)
        if foreign:
            raise UsageError(f"{self.root}: {foreign[:5]} have no place in the dataset; move them out of it")

    def _check_open(self) -> None:
        if not self._stage.is_held:
            raise UsageError(f"the writer of {self.root} is closed; make another `DatasetWriter`")

    def close(self) -> None:
        """Let go of the dataset as it is; a later `DatasetWriter` resumes it. A finished one stays finished."""
        if self._stage.is_held and self._stage.folder.exists():
            with self._stage.registry():
                if self.is_finished and not self._stage.groups():
                    self._stage.remove()
        self._stage.let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"DatasetWriter({str(self.root)!r}, dataset {self.descriptor.dataset_id!r})"


def _is_full(log: PlaceLog, shard: int, staged: Iterable[int]) -> bool:
    """Whether every place of a shard is taken by a group that is staged or committed."""
    return len({*staged, *log.groups_of(shard).values()}) == log.groups_per_shard
