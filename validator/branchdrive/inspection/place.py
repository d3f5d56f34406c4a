"""What a path is: a dataset, a file of one, a file of others, or nothing that could be inspected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from branchdrive.contract.columns import TABLES, Table, declared_table
from branchdrive.contract.layer import LAYERS, table_file
from branchdrive.contract.layout import (
    CARD_FILE,
    DESCRIPTOR_FILE,
    LICENCE_FILE,
    MANIFEST_FILE,
    RAW_DIR,
    STAGING_DIR,
    TABLES_FILE,
    layer_of,
    shard_index,
)
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import listed, quote
from branchdrive.errors import DatasetError, DecodeError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.formats.untrusted_parquet import decode_table

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["StoredFile", "dataset_at", "stored_file", "table_at"]

_MAGIC = b"PAR1"
_MOST_NAMES = 1000
"""Names of a folder that are looked at for datasets in it."""
_NAMED = 5

_FILES = {
    DESCRIPTOR_FILE: "descriptor: what the dataset is and claims",
    MANIFEST_FILE: "manifest: digests of every other file, of layers, and of the dataset",
    CARD_FILE: "card of the dataset",
    LICENCE_FILE: "licence of the release",
    TABLES_FILE: "results of the benchmark to read",
}


@dataclass(frozen=True)
class StoredFile:
    """A file that was looked at.

    Attributes:
        path: As it was given.
        root: The dataset that it lies in; ``None`` where it lies in none.
        what: What it is.
        num_bytes: Its size.
        declared: What is declared of the table in it; ``None`` of other files.
        rows: The table in it, decoded; ``None`` of other files.
    """

    path: Path
    root: Path | None
    what: str
    num_bytes: int
    declared: Table | None = None
    rows: pa.Table | None = None


def dataset_at(place: Place, *, follow_links: bool = False, allow: Sequence[Path] = ()) -> Store:
    """The dataset at a place.

    Args:
        place: A folder, or where else a dataset may be, see `open_store`.
        follow_links: Whether links are followed: those that stay in the dataset, and those into `allow`.
        allow: Folders that links may lead into.

    Raises:
        UsageError: It is none; the message says what it is instead, and what to inspect.
        DatasetError: An archive cannot be read.
        PlatformError: A store cannot be reached or refuses.
    """
    store = open_store(place, follow_links=follow_links, allow=allow)
    if not isinstance(store, Folder):
        if store.status(DESCRIPTOR_FILE) is None:
            raise UsageError(
                f"{store} is no dataset: there is no {DESCRIPTOR_FILE!r}; files alone are inspected in a folder"
            )
        return store
    path = store.root
    if (path / DESCRIPTOR_FILE).is_file():
        return store
    root = _root_above(path)
    if root is not None:
        raise UsageError(f"{str(path)!r} is a folder of the dataset {str(root)!r}; run `branchdrive inspect {root}`")
    inside = [entry for entry in islice(path.iterdir(), _MOST_NAMES) if (entry / DESCRIPTOR_FILE).is_file()]
    if inside:
        named = listed(sorted(inside)[:_NAMED]) + (f" and {len(inside) - _NAMED} more" if len(inside) > _NAMED else "")
        raise UsageError(f"{str(path)!r} is no dataset and holds some: {named}; inspect one of them")
    if (path / STAGING_DIR).is_dir():
        raise UsageError(
            f"{str(path)!r} has a working area and no {DESCRIPTOR_FILE!r} yet: a collection has only begun"
        )
    raise UsageError(f"{str(path)!r} is no dataset: there is no {DESCRIPTOR_FILE!r} in it, nor in the folders above")


def stored_file(path: Path) -> StoredFile:
    """The file at `path`, a table decoded within the spec limits.

    Raises:
        DatasetError: It cannot be read, or a table in it does not decode.
    """
    root = _root_above(path)
    folder, inside = Folder.at(root or path.parent), path.name if root is None else _inside(path, root)
    with folder.open(inside) as stream:
        is_table = stream.read(len(_MAGIC)) == _MAGIC
        num_bytes = stream.seek(0, 2)
    if not is_table:
        return StoredFile(path, root, _what(inside) if root else "no file of a dataset", num_bytes)
    name = _table_of(inside) if root else None
    declared = None if name is None else declared_table(name)
    what = f"table {name!r}: {declared.title}" if declared else "a Parquet file with a table that is not declared"
    return StoredFile(path, root, what, num_bytes, declared, table_at(folder, inside))


def table_at(folder: Store, path: str) -> pa.Table:
    """The table in a file, as it is stored.

    Raises:
        DatasetError: It cannot be read or does not decode within the spec limits.
    """
    content = folder.read(path, spec_limits().max_table_bytes)
    try:
        return decode_table(content)
    except DecodeError as error:
        raise DatasetError(f"{folder}: {path!r}: {error}; run `branchdrive-validate`") from error


def _root_above(path: Path) -> Path | None:
    """The nearest folder above `path` that holds a descriptor."""
    whole = path.absolute()
    found = next((folder for folder in whole.parents if (folder / DESCRIPTOR_FILE).is_file()), None)
    if found is None:
        return None
    steps = len(whole.parents) - len(found.parents) - 1
    parents = [*path.parents]
    return parents[steps] if steps < len(parents) else found


def _inside(path: Path, root: Path) -> str:
    return path.absolute().relative_to(root.absolute()).as_posix()


def _table_of(path: str) -> str | None:
    """Table that a dataset stores at a path relative to its root."""
    if (file := table_file(path)) is not None:
        return file.table
    match path.split("/"):
        case [folder, shard, name] if folder == RAW_DIR and shard_index(shard) is not None:
            return next((table.name for table in TABLES.values() if table.file_name == name), None)
    return None


def _what(path: str) -> str:
    """What the file at a path relative to the root is in a dataset."""
    layer, _, name = path.partition("/")
    if path in _FILES:
        return _FILES[path]
    if layer in LAYERS and name in LAYERS[layer].documents:
        return f"document of the {layer} layer: {LAYERS[layer].documents[name].title}"
    kind = layer_of(path)
    return f"file of the {kind} layer" if kind else f"a file beside the dataset, which {quote(path)} is no part of"
