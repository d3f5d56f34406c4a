"""Rows on disk between two steps of a run: what workers hand on without a parent that holds it all.

A spool is a private folder of temporary files, written and read by this tool alone; nothing in it comes from a
dataset unchecked. Tables are mapped into memory, so that a worker reads the rows that it needs.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import table_schema
from branchdrive.formats.file_error import machine_faults
from branchdrive.formats.table_file import join_parts
from branchdrive.tables.frame import Frame, concat

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Spool", "SpooledFrames", "SpooledTables", "spooled_table"]


@dataclass(frozen=True)
class Spool:
    """A folder of named values.

    Attributes:
        folder: Where they lie.
    """

    folder: Path

    @classmethod
    @contextmanager
    def temporary(cls) -> Iterator[Spool]:
        """A spool that is gone when the block is left, however it is left."""
        with tempfile.TemporaryDirectory(prefix="branchdrive-") as folder:
            yield cls(Path(folder))

    def put(self, name: str, value: Any) -> None:
        """Keep a value of this tool's own making.

        Raises:
            PlatformError: The disk with temporary files is full, or cannot be written.
        """
        with machine_faults(self.folder / name), (self.folder / name).open("wb") as stream:
            pickle.dump(value, stream, protocol=pickle.HIGHEST_PROTOCOL)

    def get(self, name: str) -> Any:
        """A value that was put."""
        with (self.folder / name).open("rb") as stream:
            return pickle.load(stream)  # noqa: S301  (a file of this process group's own)

    def has(self, name: str) -> bool:
        """Whether a value was put."""
        return (self.folder / name).exists()

    def put_table(self, name: str, table: pa.Table) -> None:
        """Keep the rows of a table.

        Raises:
            PlatformError: As `put`.
        """
        import pyarrow as pa

        path = self.folder / name
        with (
            machine_faults(path),
            pa.OSFile(str(path), "wb") as sink,
            pa.ipc.new_file(sink, table.schema) as writer,
        ):
            writer.write_table(table)

    def table(self, name: str) -> pa.Table:
        """A table that was put; its columns lie in the file until they are read."""
        import pyarrow as pa

        return pa.ipc.open_file(pa.memory_map(str(self.folder / name))).read_all()

    def put_array(self, name: str, values: NDArray[np.float64]) -> None:
        """Keep an array of numbers.

        Raises:
            PlatformError: As `put`.
        """
        with machine_faults(self.folder / name), (self.folder / name).open("wb") as stream:
            np.save(stream, values, allow_pickle=False)

    def array(self, name: str) -> NDArray[np.float64]:
        """An array that was put, to read alone; it lies in the file until it is read."""
        path = self.folder / name
        mapped: NDArray[np.float64] = np.load(path, mmap_mode="r" if path.stat().st_size else None, allow_pickle=False)
        return mapped


class SpooledFrames(Mapping[str, Frame]):
    """Frames that shards put, each read when it is asked for: rows of all shards, in their order.

    Args:
        spool: Where they lie.
        shards: Prefixes of the shards.
        names: Names of the frames.
    """

    def __init__(self, spool: Spool, shards: Sequence[str], names: Sequence[str]) -> None:
        self._spool, self._shards, self._names = spool, tuple(shards), tuple(names)

    def __getitem__(self, name: str) -> Frame:
        if name not in self._names:
            raise KeyError(name)
        return concat([self._spool.get(f"{shard}.{name}") for shard in self._shards])

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def spooled_table(path: str) -> str:
    """Name of a file of a derived layer in a spool."""
    return f"{path.replace('/', '-')}.table"


class SpooledTables(Mapping[str, "pa.Table"]):
    """Tables of derived layers whose files were put, each opened when it is asked for.

    Args:
        spool: Where they lie.
        files: Paths of the files of each table, in the order of their rows; without a file, it has no row.
    """

    def __init__(self, spool: Spool, files: Mapping[str, Sequence[str]]) -> None:
        self._spool, self._files = spool, dict(files)
        self._tables: dict[str, pa.Table] = {}

    def __getitem__(self, name: str) -> pa.Table:
        if name not in self._tables:
            rows = [self._spool.table(spooled_table(path)) for path in self._files[name]]
            self._tables[name] = join_parts(rows) if rows else table_schema(name).empty_table()
        return self._tables[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)
