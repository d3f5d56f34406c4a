"""Recipes: how a base dataset is changed into the dataset of a case, as a list of JSON objects.

Each has a member `op` and the `file` or `path` that it changes, relative to the dataset::

    rows            `keep`: ranges [start, stop) of the table's rows, in their new order; a row may be taken twice
    set             `column`, `rows` (ranges), and `value` for all of them or `values` for each
    scale           `column`, `rows`, `by`: values times a number
    shift           `column`, `rows`, `by`: values plus a number
    drop_column     `column`
    add_column      `column`, `type`, `value` or `values`
    cast            `column`, `type`
    order           `columns`: all of them, in their new order
    metadata        `table`: metadata of the file's schema, or null; `columns`: metadata of columns that have any
    json            `patch`: a JSON patch (RFC 6902)
    lines           `edits`: [start, stop, [line, ...]] each puts lines in the place of lines, the last edit first
    text, bytes     `text`, or `base64` of zlib-compressed bytes: the content of the file
    delete          a file or folder, and folders that are empty then
    folder          an empty folder
    link            `target` of a symbolic link
    fifo            a named pipe
    move            `to`: the file or folder under another name
    seal            writes the manifest of the files that are there
    manifest        `edits`, as `lines`, of the manifest; ``{sha256 PATH}``, ``{layer NAME}`` and ``{dataset}`` stand
                    for the digests that a manifest sealed now would have

Tables are Parquet files; types are named as Arrow names them. A number that JSON lacks is `"NaN"`, `"Infinity"` or
`"-Infinity"`. An operation that finds nothing to change is an error.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jsonpatch
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest
from branchdrive.formats.parquet import encode_table

__all__ = [
    "Operation",
    "apply_recipe",
    "apply_to_table",
    "edited_lines",
    "from_cell",
    "read_table",
    "rows_of",
    "sealed_digests",
]

Operation = Mapping[str, Any]

_NUMBERS = {"NaN": float("nan"), "Infinity": float("inf"), "-Infinity": float("-inf")}
_PLACEHOLDER = re.compile(r"\{(?:sha256 [^{}]+|layer [a-z]+|dataset)\}")
_TABLE_OPERATIONS = ("rows", "set", "scale", "shift", "drop_column", "add_column", "cast", "order", "metadata")


def apply_recipe(recipe: Sequence[Operation], root: Path) -> None:
    """Change the dataset at `root`; a file that changes is replaced, never written into.

    Args:
        recipe: What to do, in this order.
        root: The dataset.

    Raises:
        ValueError: An operation is unknown, leads out of the dataset, or does not fit what is there.
    """
    place = 0
    while place < len(recipe):
        operation = recipe[place]
        if operation["op"] in _TABLE_OPERATIONS:
            # One read and one write for all that happens to a table in a row.
            path = _path(root, operation["file"])
            table = read_table(path.read_bytes())
            while place < len(recipe) and recipe[place].get("file") == operation["file"]:
                if recipe[place]["op"] not in _TABLE_OPERATIONS:
                    break
                table = apply_to_table(recipe[place], table)
                place += 1
            _write(path, encode_table(table))
            continue
        if operation["op"] not in _OPERATIONS:
            raise ValueError(f"a recipe has no operation {operation['op']!r}")
        _OPERATIONS[operation["op"]](operation, root)
        place += 1


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    path.write_bytes(content)


def _path(root: Path, path: str) -> Path:
    """Place of a file of the dataset; a recipe cannot leave it."""
    parts = path.split("/")
    if not all(part not in ("", ".", "..") for part in parts):
        raise ValueError(f"{path!r} is no path inside a dataset")
    place = root
    for part in parts[:-1]:
        place = place / part
        if place.is_symlink():
            raise ValueError(f"{path!r} leads through a link")
    return place / parts[-1]


def read_table(content: bytes) -> pa.Table:
    """Table of a Parquet file of a base dataset, types as they are stored, names of items of lists included.

    Raises:
        pyarrow.ArrowException: The bytes are no Parquet file.
    """
    file = pq.ParquetFile(pa.BufferReader(content))
    table = file.read()
    written = (file.metadata.metadata or {}).get(b"ARROW:schema")
    if written is None:
        return table
    schema = pa.ipc.read_schema(pa.BufferReader(base64.b64decode(written)))
    kinds = [
        other.type if pa.types.is_list(field.type) and pa.types.is_list(other.type) else field.type
        for field, other in zip(table.schema, schema, strict=True)
    ]
    return table.cast(
        pa.schema(
            [field.with_type(kind) for field, kind in zip(table.schema, kinds, strict=True)], table.schema.metadata
        )
    )


def rows_of(ranges: Iterable[Sequence[int]], num_rows: int) -> np.ndarray:
    """Row numbers of ranges ``[start, stop)``.

    Raises:
        ValueError: A range is not within the table.
    """
    parts = []
    for start, stop in ranges:
        if not 0 <= start < stop <= num_rows:
            raise ValueError(f"rows {start} to {stop} are not within {num_rows}")
        parts.append(np.arange(start, stop))
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def from_cell(value: Any, kind: pa.DataType) -> Any:
    """A value of a recipe as a cell of a column."""
    if isinstance(value, list) and pa.types.is_list(kind):
        return [from_cell(item, kind.value_type) for item in value]
    return _NUMBERS[value] if pa.types.is_floating(kind) and isinstance(value, str) else value


def _cells(operation: Operation, kind: pa.DataType, count: int) -> pa.Array:
    values = operation["values"] if "values" in operation else [operation["value"]] * count
    if len(values) != count:
        raise ValueError(f"{operation['op']} of {operation['column']}: {len(values)} values for {count} rows")
    return pa.array([from_cell(value, kind) for value in values], kind)


def apply_to_table(operation: Operation, table: pa.Table) -> pa.Table:
    """The table after one operation on rows or columns.

    Raises:
        ValueError: The operation does not fit the table.
    """
    if operation["op"] == "rows":
        return table.take(pa.array(rows_of(operation["keep"], len(table))))
    if operation["op"] == "order":
        return table.select(operation["columns"])
    if operation["op"] == "metadata":
        fields = [field.with_metadata(operation["columns"].get(field.name)) for field in table.schema]
        return table.cast(pa.schema(fields, operation["table"]))
    name = operation["column"]
    if operation["op"] == "add_column":
        kind = pa.type_for_alias(operation["type"])
        return table.append_column(pa.field(name, kind), _cells(operation, kind, len(table)))
    index = table.schema.get_field_index(name)
    if index < 0:
        raise ValueError(f"the table has no column {name!r}")
    field, column = table.schema.field(index), table.column(index).combine_chunks()
    if operation["op"] == "drop_column":
        return table.remove_column(index)
    if operation["op"] == "cast":
        kind = pa.type_for_alias(operation["type"])
        return table.set_column(index, field.with_type(kind), column.cast(kind, safe=False))
    rows = rows_of(operation["rows"], len(table))
    if operation["op"] in ("scale", "shift"):
        values = column.to_numpy(zero_copy_only=False).copy()
        change = np.multiply if operation["op"] == "scale" else np.add
        values[rows] = change(values[rows].astype(np.float64), operation["by"])
        return table.set_column(index, field, pa.array(values, field.type))
    return table.set_column(
        index, field.with_nullable(True), _replaced(column, rows, _cells(operation, field.type, len(rows)))
    )


def _replaced(column: pa.Array, rows: np.ndarray, cells: pa.Array) -> pa.Array:
    """The column with cells in the place of those at `rows`."""
    source = np.arange(len(column))
    source[rows] = len(column) + np.arange(len(rows))
    return pa.concat_arrays([column, cells]).take(pa.array(source))


def edited_lines(lines: Sequence[str], edits: Sequence[Sequence[Any]]) -> list[str]:
    """Lines after edits ``[start, stop, lines]``, of which the last comes first."""
    result = list(lines)
    for start, stop, new in sorted(edits, key=lambda edit: (edit[0], edit[1]), reverse=True):
        result[start:stop] = new
    return result


def sealed_digests(root: Path) -> dict[str, str]:
    """Digests of the manifest that the dataset at `root` would have if it were sealed now, by placeholder."""
    manifest = build_manifest(Folder(root))
    return {
        **{f"{{sha256 {path}}}": digest for path, digest in manifest.files.items()},
        **{f"{{layer {name}}}": digest for name, digest in manifest.layers.items()},
        "{dataset}": manifest.identity,
    }


def _json(operation: Operation, root: Path) -> None:
    path = _path(root, operation["file"])
    _write(path, dump_json(jsonpatch.apply_patch(json.loads(path.read_bytes()), operation["patch"])))


def _lines(operation: Operation, root: Path) -> None:
    path = _path(root, operation["file"])
    lines = edited_lines(path.read_bytes().decode().splitlines(keepends=True), operation["edits"])
    _write(path, "".join(lines).encode())


def _content(operation: Operation, root: Path) -> None:
    is_text = operation["op"] == "text"
    content = operation["text"].encode() if is_text else zlib.decompress(base64.b64decode(operation["base64"]))
    _write(_path(root, operation["file"]), content)


def _delete(operation: Operation, root: Path) -> None:
    path = _path(root, operation["path"])
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
    _prune(path.parent, root)


def _prune(folder: Path, root: Path) -> None:
    """Remove folders that an operation left empty."""
    while folder != root and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent


def _made(operation: Operation, root: Path) -> None:
    path = _path(root, operation["path"])
    path.parent.mkdir(parents=True, exist_ok=True)
    if operation["op"] == "folder":
        path.mkdir()
    elif operation["op"] == "link":
        path.symlink_to(operation["target"])
    else:
        os.mkfifo(path)


def _move(operation: Operation, root: Path) -> None:
    target = _path(root, operation["to"])
    target.parent.mkdir(parents=True, exist_ok=True)
    source = _path(root, operation["path"])
    source.rename(target)
    _prune(source.parent, root)


def _seal(_: Operation, root: Path) -> None:
    _write(root / MANIFEST_FILE, build_manifest(Folder(root)).render())


def _manifest(operation: Operation, root: Path) -> None:
    path = root / MANIFEST_FILE
    digests = sealed_digests(root)
    edits = [
        (start, stop, [_PLACEHOLDER.sub(lambda found: digests[found[0]], line) for line in lines])
        for start, stop, lines in operation["edits"]
    ]
    lines = edited_lines(path.read_bytes().decode().splitlines(keepends=True), edits)
    _write(path, "".join(lines).encode())


_OPERATIONS: dict[str, Callable[[Operation, Path], None]] = {
    "json": _json, "lines": _lines, "text": _content, "bytes": _content, "delete": _delete, "folder": _made,
    "link": _made, "fifo": _made, "move": _move, "seal": _seal, "manifest": _manifest,
}  # fmt: skip
