"""Recipes: how a base dataset is changed into the dataset of a case, as a list of JSON objects.

Each has a member `op` and the `file` or `path` that it changes, relative to the dataset::

    rows            `keep`: ranges [start, stop] of the table's rows, in their new order; a row may be taken twice, and
                    [start, stop, file] takes rows of another table as the base has it
    sort            `by`: columns in whose ascending order the rows are put; rows that are alike there stay in theirs
    set             `column`, which rows, and `value` for all of them, `values` for each, `from`: ranges of rows whose
                    cells they get, or `of`: another column whose cells they get, those of `from` where it is there;
                    or, of several columns, which rows and `cells`: what each column has in all of them
    scale           `column`, which rows, `by`: values times a number
    shift           `column`, which rows, `by`: values plus a number
    drop_column     `column`
    add_column      `column`, `type`, `value` or `values`
    cast            `column`, `type`
    nullable        `columns`: that may have nulls, as the file says
    order           `columns`: all of them, in their new order
    describe        `table`: metadata of the file's schema, or null, if it changes; `columns`: metadata of those columns
                    whose metadata change, each an object or null, or null for no metadata of any column
    written         `settings`: arguments of pyarrow's `write_table`, instead of those of every table here
    json            `patch`: a JSON patch (RFC 6902)
    lines           `edits`: [start, stop, [line, ...]] each puts lines in the place of lines, the last edit first
    text, bytes     `text`, or `base64` of zlib-compressed bytes: the content of the file
    splice          `parts`: ranges [start, stop] of the file's bytes, and base64 of others, in their new order
    copy            `to`: the file under another name as well
    delete          a file or folder, and folders that are empty then
    folder          an empty folder
    link            `target` of a symbolic link
    fifo            a named pipe
    move            `to`: the file or folder under another name
    seal            writes the manifest of the files that are there
    manifest        `edits`, as `lines`, of the manifest; ``{sha256 PATH}``, ``{layer NAME}`` and ``{dataset}`` stand
                    for the digests that a manifest sealed now would have

Tables are Parquet files; types are named as Arrow names them, and `dictionary` is text in a dictionary. A number that
JSON lacks is `"NaN"`, `"Infinity"` or `"-Infinity"`, and bytes of a cell are hexadecimal. A range [start, stop] of rows
does not hold `stop`, and goes backwards where `stop` comes before `start`. Which rows an operation changes is given by
`rows`, ranges of them, or by `where`: values that other columns have there, by column, each of them a value, a list of
values, or `{"from": first, "to": last}`. An operation that finds nothing to change is an error.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jsonpatch

from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest
from branchdrive_conformance.splice import spliced
from branchdrive_conformance.table_operation import TABLE_OPERATIONS, apply_to_table, encoded, read_table

__all__ = ["Operation", "apply_recipe", "edited_lines", "sealed_digests"]

Operation = Mapping[str, Any]

_PLACEHOLDER = re.compile(r"\{(?:sha256 [^{}]+|layer [a-z]+|dataset)\}")


def apply_recipe(recipe: Sequence[Operation], root: Path) -> None:
    """Change the dataset at `root`; a file that changes is replaced, never written into.

    Args:
        recipe: What to do, in this order.
        root: The dataset.

    Raises:
        ValueError: An operation is unknown, leads out of the dataset, or does not fit what is there.
    """
    tables = {file: read_table(_read(_path(root, file))) for file in _named_tables(recipe)}
    place = 0
    while place < len(recipe):
        operation = recipe[place]
        if operation["op"] in TABLE_OPERATIONS:
            # One read and one write for all that happens to a table in a row.
            path, settings = _path(root, operation["file"]), None
            table = read_table(_read(path))
            while place < len(recipe) and recipe[place].get("file") == operation["file"]:
                if recipe[place]["op"] not in TABLE_OPERATIONS:
                    break
                if recipe[place]["op"] == "written":
                    settings = recipe[place]["settings"]
                else:
                    table = apply_to_table(recipe[place], table, tables.__getitem__)
                place += 1
            _write(path, encoded(table, settings))
            continue
        if operation["op"] not in _OPERATIONS:
            raise ValueError(f"a recipe has no operation {operation['op']!r}")
        _OPERATIONS[operation["op"]](operation, root)
        place += 1


def _named_tables(recipe: Sequence[Operation]) -> set[str]:
    """Files whose rows are taken into other tables."""
    ranges = (span for operation in recipe if operation["op"] == "rows" for span in operation["keep"])
    return {file for _, _, *files in ranges for file in files}


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


def _read(path: Path) -> bytes:
    """Content of a file of the dataset, and of nothing that a link leads to."""
    if path.is_symlink():
        raise ValueError(f"{path.name!r} is a link, and no operation reads through one")
    return path.read_bytes()


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
    _write(path, dump_json(jsonpatch.apply_patch(json.loads(_read(path)), operation["patch"])))


def _lines(operation: Operation, root: Path) -> None:
    path = _path(root, operation["file"])
    lines = edited_lines(_read(path).decode().splitlines(keepends=True), operation["edits"])
    _write(path, "".join(lines).encode())


def _content(operation: Operation, root: Path) -> None:
    is_text = operation["op"] == "text"
    content = operation["text"].encode() if is_text else zlib.decompress(base64.b64decode(operation["base64"]))
    _write(_path(root, operation["file"]), content)


def _splice(operation: Operation, root: Path) -> None:
    path = _path(root, operation["file"])
    _write(path, spliced(_read(path), operation["parts"]))


def _copy(operation: Operation, root: Path) -> None:
    _write(_path(root, operation["to"]), _read(_path(root, operation["path"])))


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
    lines = edited_lines(_read(path).decode().splitlines(keepends=True), edits)
    _write(path, "".join(lines).encode())


_OPERATIONS: dict[str, Callable[[Operation, Path], None]] = {
    "json": _json, "lines": _lines, "text": _content, "bytes": _content, "splice": _splice, "copy": _copy,
    "delete": _delete, "folder": _made, "link": _made, "fifo": _made, "move": _move, "seal": _seal,
    "manifest": _manifest,
}  # fmt: skip
