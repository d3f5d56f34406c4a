"""A branch group while it is collected: a folder of finished rollouts, and a marker once it is closed.

A rollout is prepared under a name that starts with a dot and then renamed, so that every rollout
with a proper name is whole. Whatever starts with a dot was left behind by a killed process.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.formats.durable import delete, move, partial_path, replace_file, sync_dir, write_file
from branchdrive.formats.folder import Folder
from branchdrive.raw.media.media_folder import FRAMES, MediaFolder
from branchdrive.raw.rollout import ROLLOUTS, Rollout, RolloutTables
from branchdrive.writer.buffer import record_table
from branchdrive.writer.media_buffer import MediaBuffer

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["StagedGroup", "arrow_bytes"]

_CLOSED_FILE = ".closed.json"
_FOLDER = re.compile(r"[0-9]{8,}\..+")


class StagedGroup:
    """The folder of one group in the staging area; its name holds the group's place and identity."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @staticmethod
    def folder_name(index: int, group_id: str) -> str:
        """Name of the folder of a group at place `index`."""
        return f"{index:08d}.{group_id}"

    @classmethod
    def find_all(cls, groups_dir: Path) -> list[StagedGroup]:
        """Every staged group, by place."""
        groups = [cls(path) for path in groups_dir.glob("*") if _FOLDER.fullmatch(path.name)]
        return sorted(groups, key=lambda group: group.index)

    @property
    def index(self) -> int:
        """The group's place in the dataset."""
        return int(self.folder.name.split(".", maxsplit=1)[0])

    @property
    def group_id(self) -> str:
        """The group's identity."""
        return self.folder.name.split(".", maxsplit=1)[1]

    @property
    def is_closed(self) -> bool:
        """Whether the group's collection is over."""
        return (self.folder / _CLOSED_FILE).exists()

    def close(self) -> None:
        """Declare the group's collection over."""
        replace_file(self.folder / _CLOSED_FILE, dump_json({"group_id": self.group_id, "index": self.index}))

    def reopen(self) -> None:
        """Let the group take further rollouts, and clear away what a killed process left behind."""
        (self.folder / _CLOSED_FILE).unlink(missing_ok=True)
        sync_dir(self.folder)
        for path in self.folder.iterdir():
            if path.name.startswith("."):
                delete(path)

    @property
    def rollout_ids(self) -> list[str]:
        """Identities of the finished rollouts, sorted."""
        return sorted(path.name for path in self.folder.iterdir() if not path.name.startswith("."))

    def media(self, rollout_id: str, descriptor: Descriptor) -> MediaFolder | None:
        """Where the images of a finished rollout are; ``None`` where the descriptor claims no media stream."""
        claims_media = FRAMES in descriptor.tables
        return MediaFolder(Folder(self.folder / rollout_id), "", descriptor.cameras_by_name) if claims_media else None

    def media_buffer(self, rollout_id: str, descriptor: Descriptor) -> MediaBuffer | None:
        """What takes the images of a rollout that begins; ``None`` where the descriptor claims no media stream."""
        folder = self.media(rollout_id, descriptor)
        return None if folder is None else MediaBuffer(self.folder / f".{rollout_id}.media", folder)

    def add(self, rollout: Rollout, images: MediaBuffer | None = None) -> None:
        """Add a finished rollout with its images: wholly or not at all."""
        folder = self.folder / rollout.rollout_id
        partial = partial_path(folder)
        delete(partial)
        partial.mkdir()
        row = record_table(TABLES[ROLLOUTS], rollout.record)
        for name, table in {ROLLOUTS: row, **rollout.tables}.items():
            write_file(_table_path(partial, name), arrow_bytes(table))
        if images is not None:
            images.hand_over(partial)
        sync_dir(partial)
        move(partial, folder)

    def table(self, rollout_id: str, name: str) -> pa.Table:
        """Rows of a finished rollout in the table `name`, with the declared schema."""
        import pyarrow as pa

        return pa.ipc.open_file(_table_path(self.folder / rollout_id, name).read_bytes()).read_all()

    def record(self, rollout_id: str) -> dict[str, Any]:
        """Row of a finished rollout in the rollouts table."""
        record: dict[str, Any] = self.table(rollout_id, ROLLOUTS).to_pylist()[0]
        return record

    def rollout(self, rollout_id: str, descriptor: Descriptor) -> Rollout:
        """A finished rollout of the dataset that the descriptor describes."""
        folder = self.folder / rollout_id
        names = [name for name in TABLES if name != ROLLOUTS and _table_path(folder, name).exists()]
        tables = {name: self.table(rollout_id, name) for name in names}
        return Rollout(self.record(rollout_id), RolloutTables(tables), self.media(rollout_id, descriptor))


def _table_path(folder: Path, name: str) -> Path:
    return folder / f"{name}.arrow"


def arrow_bytes(table: pa.Table) -> pa.Buffer:
    """The table as an Arrow file."""
    import pyarrow as pa

    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
    return sink.getvalue()
