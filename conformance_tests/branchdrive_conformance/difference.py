"""The recipe that leads from one dataset to another: the inverse of `recipe.apply_recipe`."""

from __future__ import annotations

import base64
import json
import stat
import zlib
from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import jsonpatch
import numpy as np
import pyarrow as pa

from branchdrive.contract.columns import LAYER_TABLES, TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.parquet import encode_table
from branchdrive_conformance.recipe import Operation, apply_to_table, read_table, sealed_digests

__all__ = ["equal_tables", "manifest_edits", "recipe_between", "templated", "tree"]

_MIN_ALIKE = 50
"""Cells from which on a change that all of them share is looked for."""

_MAX_TEXT_BYTES = 20_000
"""Files of text up to this size are written out, and so are edits of any file."""


def tree(root: Path) -> dict[str, tuple[str, str]]:
    """Kind of everything below `root` by path, and the target of links; folders that are not empty are left out."""
    found: dict[str, tuple[str, str]] = {}
    for path in sorted(root.rglob("*")):
        mode = path.lstat().st_mode
        name = path.relative_to(root).as_posix()
        if stat.S_ISLNK(mode):
            found[name] = "link", str(path.readlink())
        elif stat.S_ISDIR(mode):
            if not any(path.iterdir()):
                found[name] = "folder", ""
        else:
            found[name] = ("file" if stat.S_ISREG(mode) else "fifo"), ""
    return found


def recipe_between(base: Path, changed: Path) -> list[Operation]:
    """Operations that make of the files of `base` those of `changed`, manifests left out.

    Raises:
        pyarrow.ArrowException: A table of `base` cannot be read.
    """
    return list(_operations(base, changed))


def _operations(base: Path, changed: Path) -> Iterator[Operation]:
    before, after = tree(base), tree(changed)
    for entries in (before, after):
        entries.pop(MANIFEST_FILE, None)
    moved = _moved(base, before, changed, after)
    yield from ({"op": "move", "path": path, "to": to} for path, to in moved.items())
    before = {moved.get(path, path): entry for path, entry in before.items()}
    origin = {to: path for path, to in moved.items()}
    for path in before:
        if path not in after:
            below = any(other.startswith(f"{path}/") for other in after)
            if before[path][0] != "folder" or not below:
                yield {"op": "delete", "path": path}
        elif before[path] != after[path]:
            yield {"op": "delete", "path": path}
    for path, (kind, target) in after.items():
        if kind == "file":
            old = (base / origin.get(path, path)).read_bytes() if before.get(path, ("",))[0] == "file" else None
            new = (changed / path).read_bytes()
            if old != new:
                yield from _of_file(path, old, new)
        elif before.get(path) != (kind, target):
            yield {"op": kind, "path": path, **({"target": target} if kind == "link" else {})}


Tree = dict[str, tuple[str, str]]


def _moved(base: Path, before: Tree, changed: Path, after: Tree) -> dict[str, str]:
    """Files that have another name in the other dataset, each with that name."""
    gone = {path: (base / path).read_bytes() for path in before if path not in after and before[path][0] == "file"}
    found: dict[str, str] = {}
    for path in after if gone else ():
        if path not in before and after[path][0] == "file":
            content = (changed / path).read_bytes()
            same = next((old for old in gone if gone[old] == content and old not in found), None)
            if same is not None:
                found[same] = path
    return found


def _of_file(path: str, old: bytes | None, new: bytes) -> Iterator[Operation]:
    found: list[Operation] | None = None
    if old is not None and path.endswith(".parquet"):
        found = _of_table(path, old, new)
    elif old is not None and path.endswith(".json"):
        found = _of_document(path, old, new)
    whole = _whole(path, new)
    if found is None and old is not None and whole["op"] == "text" and _is_text(old):
        lines = {"op": "lines", "file": path, "edits": _line_edits(_lines(old.decode()), _lines(new.decode()))}
        found = [lines] if _size(lines) < _size(whole) else None
    if found is None or sum(map(_size, found)) > max(_size(whole), _MAX_TEXT_BYTES):
        found = [whole]
    yield from found


def _is_text(content: bytes) -> bool:
    try:
        return "\0" not in content.decode()
    except UnicodeDecodeError:
        return False


def _whole(path: str, content: bytes) -> Operation:
    if _is_text(content) and len(content) <= _MAX_TEXT_BYTES:
        return {"op": "text", "file": path, "text": content.decode()}
    return {"op": "bytes", "file": path, "base64": base64.b64encode(zlib.compress(content, 9)).decode()}


def _size(operation: Operation) -> int:
    return len(json.dumps(operation))


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def _line_edits(old: Sequence[str], new: Sequence[str]) -> list[list[Any]]:
    matcher = SequenceMatcher(None, old, new, autojunk=False)
    return [[i, j, list(new[k:m])] for tag, i, j, k, m in matcher.get_opcodes() if tag != "equal"]


def _of_document(path: str, old: bytes, new: bytes) -> list[Operation] | None:
    try:
        before, after = json.loads(old), json.loads(new)
        if dump_json(after) != new:
            return None
    except (ValueError, RecursionError):
        return None
    return [{"op": "json", "file": path, "patch": jsonpatch.make_patch(before, after).patch}]


# Manifests


def templated(root: Path, digests: dict[str, str]) -> list[str]:
    """Lines of the manifest at `root`, digests of it that are right as placeholders."""
    lines = (root / MANIFEST_FILE).read_bytes().decode().splitlines(keepends=True)
    owner = {digest: name for name, digest in reversed(digests.items())}
    result = []
    for line in lines:
        for digest, name in owner.items():
            own = f"{{sha256 {line[66:].rstrip()}}}"
            if digest in line:
                line = line.replace(digest, own if digests.get(own) == digest else name)
        result.append(line)
    return result


def manifest_edits(sealed: Path, changed: Path) -> list[list[Any]]:
    """Edits of lines that make the manifest of `changed` of that of `sealed`, whose files are the same."""
    digests = sealed_digests(sealed)
    return _line_edits(templated(sealed, digests), templated(changed, digests))


# Tables


def equal_tables(one: pa.Table, other: pa.Table) -> bool:
    """Whether tables have the same columns, types, metadata and cells, whatever is said of nulls."""
    if [(f.name, f.type, f.metadata) for f in one.schema] != [(f.name, f.type, f.metadata) for f in other.schema]:
        return False
    if one.schema.metadata != other.schema.metadata or len(one) != len(other):
        return False
    return all(_equal(one.column(i), other.column(i)) for i in range(len(one.schema)))


def _equal(one: pa.ChunkedArray, other: pa.ChunkedArray) -> bool:
    if one.equals(other):
        return True
    if pa.types.is_floating(one.type) and one.is_null() == other.is_null():
        first, second = (column.to_numpy(zero_copy_only=False) for column in (one, other))
        return bool(np.array_equal(first, second, equal_nan=True))
    return repr(one.to_pylist()) == repr(other.to_pylist()) if not pa.types.is_floating(one.type) else False


def _of_table(path: str, old: bytes, new: bytes) -> list[Operation] | None:
    before = read_table(old)
    try:
        after = read_table(new)
        if encode_table(after) != new:  # the way in which it is written is the case
            return None
        found = _cheapest(before, after, Path(path).stem)
    except (ValueError, OSError, pa.ArrowException):
        return None
    return [{"op": operation.pop("op"), "file": path, **operation} for operation in found] if found else None


def _cheapest(before: pa.Table, after: pa.Table, name: str) -> list[dict[str, Any]] | None:
    """The shortest operations that make one table of the other; ``None`` where none do."""
    candidates = []
    for source in _sources(before, after, name):
        operations: list[dict[str, Any]] = []
        table = before
        if source != list(range(len(before))):
            operations.append({"op": "rows", "keep": _ranges(source)})
            table = apply_to_table(operations[-1], table)
        for step in (_column_operations, _schema_operations, _cell_operations):
            for operation in step(table, after):
                operations.append(operation)
                table = apply_to_table(operation, table)
        if equal_tables(table, after):
            candidates.append(operations)
    return min(candidates, key=lambda operations: len(json.dumps(operations)), default=None)


def _sources(before: pa.Table, after: pa.Table, name: str) -> Iterator[list[int]]:
    """Ways to see rows of the new table as rows of the old one."""
    if len(before) == len(after):
        yield list(range(len(before)))
    declared = TABLES.get(name) or LAYER_TABLES.get(name)
    key = [column for column in (declared.key if declared else ()) if column in before.column_names]
    if len(before) and key and set(key) <= set(after.column_names):
        yield _by_key(before, after, key)


def _by_key(before: pa.Table, after: pa.Table, key: list[str]) -> list[int]:
    others = [name for name in before.column_names if name not in key[:1] and name in after.column_names]
    keys, contents = _tuples(before, key), _tuples(before, others)
    free: dict[Any, list[int]] = {}
    for row in reversed(range(len(before))):
        free.setdefault(keys[row], []).append(row)
    alike = {content: row for row, content in reversed(list(enumerate(contents)))}
    taken: dict[Any, int] = {}
    source, previous = [], -1
    for own, content in zip(_tuples(after, key), _tuples(after, others), strict=True):
        if free.get(own):
            previous = taken[own] = free[own].pop()
        elif content in alike:
            previous = alike[content]
        else:
            previous = taken.get(own, min(previous + 1, len(before) - 1))
        source.append(previous)
    return source


def _tuples(table: pa.Table, columns: list[str]) -> list[Any]:
    return list(map(repr, zip(*(table[name].to_pylist() for name in columns), strict=True)))


def _ranges(rows: Sequence[int]) -> list[list[int]]:
    found: list[list[int]] = []
    for row in rows:
        if found and found[-1][1] == row:
            found[-1][1] = row + 1
        else:
            found.append([row, row + 1])
    return found


def _column_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    for name in table.column_names:
        if name not in after.column_names:
            yield {"op": "drop_column", "column": name}
        elif (kind := after.schema.field(name).type) != table.schema.field(name).type:
            yield {"op": "cast", "column": name, "type": _alias(kind)}
    for name in after.column_names:
        if name not in table.column_names:
            kind = after.schema.field(name).type
            yield {"op": "add_column", "column": name, "type": _alias(kind), **_values(after[name].to_pylist(), kind)}


def _schema_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    if table.column_names != after.column_names:
        yield {"op": "order", "columns": after.column_names}
    metadata = {name: after.schema.field(name).metadata for name in after.column_names}
    if after.schema.metadata != table.schema.metadata or any(
        table.schema.field(name).metadata != value for name, value in metadata.items()
    ):
        columns = {name: _texts(value) for name, value in metadata.items() if value}
        yield {"op": "metadata", "table": _texts(after.schema.metadata), "columns": columns}


def _texts(metadata: dict[bytes, bytes] | None) -> dict[str, str] | None:
    return None if metadata is None else {key.decode(): value.decode() for key, value in metadata.items()}


def _alias(kind: pa.DataType) -> str:
    if pa.type_for_alias(str(kind)) != kind:
        raise ValueError(f"{kind} has no alias")
    return str(kind)


def _cell_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    for name in table.column_names:
        old, new = table[name], after[name]
        if _equal(old, new):
            continue
        kind = new.type
        pairs = list(zip(old.to_pylist(), new.to_pylist(), strict=True))
        rows = [i for i, (one, other) in enumerate(pairs) if repr(one) != repr(other)]
        start: dict[str, Any] = {"column": name, "rows": _ranges(rows)}
        shared = _shared_change([pairs[i] for i in rows], kind)
        change = {"op": "set", **_values([pairs[i][1] for i in rows], kind)} if shared is None else shared
        yield {**start, **change}


def _shared_change(pairs: list[tuple[Any, Any]], kind: pa.DataType) -> dict[str, Any] | None:
    """The number that all values were multiplied by, or that was added to them."""
    is_number = pa.types.is_floating(kind) or pa.types.is_integer(kind)
    if len(pairs) < _MIN_ALIKE or not is_number or any(None in pair for pair in pairs):
        return None
    old, new = (np.array(values, np.float64) for values in zip(*pairs, strict=True))
    largest = int(np.argmax(np.abs(old)))
    if not old[largest] or not np.isfinite(new).all():
        return None
    dtype = kind.to_pandas_dtype()
    ratio, difference = new[largest] / old[largest], new[largest] - old[largest]
    for name, change, number in (
        ("scale", np.multiply, ratio), ("scale", np.multiply, round(ratio, 6)),
        ("shift", np.add, difference), ("shift", np.add, round(difference, 6)),
    ):  # fmt: skip
        if number and np.array_equal(change(old, number).astype(dtype), new.astype(dtype)):
            return {"op": name, "by": float(number)}
    return None


def _values(cells: list[Any], kind: pa.DataType) -> dict[str, Any]:
    written = [_to_cell(cell, kind) for cell in cells]
    if written and all(cell == written[0] for cell in written):
        return {"value": written[0]}
    return {"values": written}


def _to_cell(value: Any, kind: pa.DataType) -> Any:
    """A cell as a recipe writes it; the shortest number that the column's type tells apart."""
    if isinstance(value, list):
        return [_to_cell(item, kind.value_type) for item in value]
    if isinstance(value, bytes):
        raise ValueError("a recipe cannot write bytes")
    if pa.types.is_floating(kind) and value is not None:
        if not np.isfinite(value):
            return "NaN" if np.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return float(str(np.float32(value))) if pa.types.is_float32(kind) else value
    return value
