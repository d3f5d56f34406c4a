"""Two lines of Python for each of the libraries that people have, which load what was looked at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from branchdrive.card.front_matter import SPLITS
from branchdrive.contract.layer import table_file, table_pattern
from branchdrive.contract.layout import RAW_DIR
from branchdrive.formats.folder import Folder
from branchdrive.formats.store import Entry
from branchdrive.inspection.overview import Overview
from branchdrive.inspection.table_files import TableFiles

__all__ = ["Lines", "loading", "loading_files"]

_FIRST = ("scalars", "rollouts")
"""What happened to candidates, or of a raw layer its attempts: what most readers begin with."""


class Lines(NamedTuple):
    """How a library loads something.

    Attributes:
        library: Its name.
        lines: The import and the call.
    """

    library: str
    lines: tuple[str, str]


def loading(overview: Overview, table: str | None = None) -> Iterator[Lines]:
    """How each library loads a table, by default the one that most readers begin with; nothing that has no file.

    Of a table with partitions it is the first one. What other libraries take of buckets and archives is theirs to say:
    there, these are the lines of this one.

    Args:
        overview: The dataset.
        table: One of its tables.
    """
    found = {one.table.name: one for one in overview.tables if one.files}
    name = table or next((name for name in _FIRST if name in found), None)
    if name is None or name not in found:
        return
    files, partition = found[name].files, _first_partition(found[name])
    is_model = "model" in overview.descriptor.layers and found[name].layer == "model"
    if not isinstance(overview.dataset, Folder):
        if found[name].layer == RAW_DIR:
            call = f"open_dataset({str(overview.dataset)!a}).table({name!r}).read()"
            yield Lines("branchdrive", ("from branchdrive import open_dataset", f"rows = {call}"))
        elif is_model:
            yield _torch(overview, partition)
        return
    root = overview.dataset.root
    yield from loading_files(_pattern(root, found[name], partition))
    if is_model:
        split = SPLITS.get(partition, partition) if partition else "bank"
        call = f"load_dataset({str(root)!a}, {name!r}, split={split!r})"
        yield Lines("datasets", ("from datasets import load_dataset", f"{name} = {call}"))
        yield _torch(overview, partition)
    elif files:
        pattern = _pattern(root, found[name], partition)
        call = f"load_dataset('parquet', data_files={pattern!a}, split='train')"
        yield Lines("datasets", ("from datasets import load_dataset", f"rows = {call}"))


def _torch(overview: Overview, partition: str | None) -> Lines:
    learning = "from branchdrive_reference.learning.groups import BranchGroupDataset"
    call = f"BranchGroupDataset({str(overview.dataset)!a}, {partition or 'train'!r}, 'sensor')"
    return Lines("torch", (learning, f"groups = {call}"))


def loading_files(pattern: str) -> Iterator[Lines]:
    """How libraries of data frames load a Parquet file, or all whose paths have a pattern."""
    files = f"sorted(glob.glob({pattern!a}))" if "*" in pattern else f"{pattern!a}"
    imports = "import glob, pandas as pd" if "*" in pattern else "import pandas as pd"
    yield Lines("pandas", (imports, f"rows = pd.read_parquet({files})"))
    yield Lines("polars", ("import polars as pl", f"rows = pl.read_parquet({pattern!a})"))
    yield Lines("DuckDB", ("import duckdb", f"rows = duckdb.read_parquet({pattern!a})"))


def _first_partition(table: TableFiles) -> str | None:
    file = table_file(table.files[0].path)
    return None if file is None else file.partition


def _pattern(root: Path, table: TableFiles, partition: str | None) -> str:
    """Path of the file with the rows, or the pattern of the paths of several."""
    files = [entry for entry in table.files if _is_of(entry, partition)]
    if len(files) == 1:
        return str(root / files[0].path)
    if table.layer == RAW_DIR:
        return str(root / RAW_DIR / "shard-*" / table.table.file_name)
    return str(root / table_pattern(table.table.name, partition))


def _is_of(entry: Entry, partition: str | None) -> bool:
    file = table_file(entry.path)
    return file is None or file.partition == partition
