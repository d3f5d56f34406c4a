"""Damage of files and folders: bytes, tables, documents, manifests, names, links, and changes while they are read.

Each function changes a copy of a dataset whose files are hard links to the original: a file is replaced, never
written in place.
"""

from __future__ import annotations

import json
import os
import socket
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
from tests.changed_input import changed_lines
from tests.fuzz.draw import Draw
from tests.validator.contract.changing import changed, changes
from tests.validator.engine.datasets import parquet_bytes
from tests.validator.engine.test_hostile_documents import DOCUMENTS
from tests.validator.engine.test_hostile_tables import BOMBS

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.untrusted_parquet import decode_table

__all__ = ["DAMAGES", "Damage", "put"]

Damage = Callable[[Draw, Path], str]
"""Damages the dataset at a path and says how."""

DAMAGES: dict[str, Damage] = {}

OUTSIDE = "outside"
"""A folder beside the dataset that links lead to, and that nobody may touch."""


def _damage(function: Damage) -> Damage:
    DAMAGES[function.__name__.strip("_")] = function
    return function


def put(path: Path, content: bytes) -> None:
    """Replace a file, or make it."""
    path.unlink(missing_ok=True)
    path.write_bytes(content)


def _files(root: Path, suffix: str = "") -> list[str]:
    return sorted(
        path.relative_to(root).as_posix() for path in root.rglob(f"*{suffix}") if path.is_file() and path.name
    )


def _changed_bytes(draw: Draw, content: bytes) -> tuple[str, bytes]:
    data = bytearray(content)
    size = max(len(data), 1)
    start, length = draw.below(size), 1 + draw.below(64)
    kind = draw.choice(("bits", "footer bits", "cut", "piece missing", "overwritten", "twice", "zeroed"))
    match kind:
        case "bits" | "footer bits":  # Parquet keeps its footer in the last kilobyte
            reach = size if kind == "bits" else min(size, 1000)
            for _ in range(1 + draw.below(5)):
                place = size - 1 - draw.below(reach)
                data[place : place + 1] = bytes(byte ^ (1 << draw.below(8)) for byte in data[place : place + 1])
        case "cut":
            del data[start:]
        case "piece missing":
            del data[start : start + length]
        case "overwritten":
            data[start : start + length] = draw.bytes(length)
        case "twice":
            data[start:start] = data[start : start + length]
        case _:
            data[start : start + length] = bytes(length)
    return kind, bytes(data)


@_damage
def bytes_(draw: Draw, root: Path) -> str:
    path = draw.choice(_files(root))
    kind, content = _changed_bytes(draw, (root / path).read_bytes())
    put(root / path, content)
    return f"{path}: {kind}"


# --- tables


def _with_text(table: pa.Table, content: bytes) -> pa.Table:
    """The first column of text, or else the first, with text that need not be UTF-8 in its first cell."""
    index = next((i for i, field in enumerate(table.schema) if pa.types.is_dictionary(field.type)), 0)
    values = [str(value).encode() for value in table[index].to_pylist()]
    text = pa.array([content, *values[1:]][: len(values)], pa.binary())
    array = pa.Array.from_buffers(pa.string(), len(text), text.buffers())
    return table.set_column(index, table.column_names[index], array)


def _take(table: pa.Table, rows: Sequence[int]) -> pa.Table:
    return table.take(pa.array(rows, pa.int64()))


TABLE_EDITS: Mapping[str, Callable[[pa.Table], bytes]] = {
    "no row": lambda t: parquet_bytes(t.slice(0, 0)),
    "one row": lambda t: parquet_bytes(t.slice(0, 1)),
    "rows twice": lambda t: parquet_bytes(pa.concat_tables([t, t])),
    "rows backwards": lambda t: parquet_bytes(_take(t, range(len(t))[::-1])),
    "a row group for each row": lambda t: parquet_bytes(t, row_group_size=1),
    "a column twice": lambda t: parquet_bytes(t.append_column(t.schema.field(0), t[0])),
    "a column in capitals": lambda t: parquet_bytes(t.append_column(t.column_names[0].upper(), t[0])),
    "no column": lambda t: parquet_bytes(t.select([])),
    "columns backwards": lambda t: parquet_bytes(t.select(t.column_names[::-1])),
    "300 columns": lambda t: parquet_bytes(pa.table({f"c{i}": [0] for i in range(300)})),
    "all columns text": lambda t: parquet_bytes(pa.table({n: pa.array([str(v) for v in t[n].to_pylist()])
                                                          for n in t.column_names})),
    "all columns null": lambda t: parquet_bytes(pa.table({n: pa.nulls(len(t)) for n in t.column_names})),
    "a megabyte of metadata": lambda t: parquet_bytes(t.replace_schema_metadata({"x": "y" * 2**20})),
    "10,001 pairs of metadata": lambda t: parquet_bytes(t.replace_schema_metadata({str(i): "" for i in range(10_001)})),
    "metadata for a terminal": lambda t: parquet_bytes(t.replace_schema_metadata({"\x1b[2J": "\x1b]0;owned\x07"})),
    "300,000 equal rows": lambda t: parquet_bytes(_take(t, [0] * 300_000 if len(t) else [])),
    "text that is no UTF-8": lambda t: parquet_bytes(_with_text(t, b"\xff\xfe")),
    "half a surrogate": lambda t: parquet_bytes(_with_text(t, b"\xed\xa0\x80")),
    "text for a terminal": lambda t: parquet_bytes(_with_text(t, b"\x1b[31m\x07")),
    **{f"a bomb, {name}": (lambda t, content=content: content) for name, content in BOMBS.items()},
}  # fmt: skip


@_damage
def table(draw: Draw, root: Path) -> str:
    path = draw.choice(_files(root, ".parquet"))
    kind = draw.choice(tuple(TABLE_EDITS))
    rows = decode_table((root / path).read_bytes(), Path(path).stem)
    put(root / path, TABLE_EDITS[kind](rows))
    return f"{path}: {kind}"


# --- documents


@_damage
def document(draw: Draw, root: Path) -> str:
    path = draw.choice(_files(root, ".json"))
    known = json.loads((root / path).read_bytes())
    place, new = draw.choice(changes(known))
    put(root / path, json.dumps(changed(known, place, new)).encode())
    return f"{path} {place} {new!r:.60}"


@_damage
def no_document(draw: Draw, root: Path) -> str:
    path = draw.choice(_files(root, ".json"))
    kind = draw.choice(tuple(DOCUMENTS))
    put(root / path, DOCUMENTS[kind])
    return f"{path}: {kind}"


@_damage
def manifest(draw: Draw, root: Path) -> str:
    """A line changed; a manifest made again would undo it."""
    lines = (root / MANIFEST_FILE).read_text().splitlines(keepends=True)
    place = draw.below(len(lines))
    new = draw.choice(changed_lines(lines[place]))
    put(root / MANIFEST_FILE, "".join([*lines[:place], new, *lines[place + 1 :]]).encode())
    return f"{MANIFEST_FILE} line {place} {new!r:.60}"


@_damage
def checkpoint(draw: Draw, root: Path) -> str:
    """Weights with a header that lies; of a dataset without weights, a file that calls itself so."""
    files = _files(root, ".safetensors")
    path = draw.choice(files) if files else "raw/shard-00000/weights.safetensors"
    headers = {
        "no header": b"", "a header without end": b"{", "a deep header": b"[" * 100_000,
        "offsets beyond the end": b'{"w":{"dtype":"F32","shape":[1],"data_offsets":[0,9999999]}}',
        "a shape of trillions": b'{"w":{"dtype":"F32","shape":[1000000,1000000],"data_offsets":[0,0]}}',
        "metadata of another type": b'{"__metadata__":{"branchdrive":1}}',
        "no metadata": b'{"__metadata__":{}}', "a pickle": b"\x80\x04c",
    }  # fmt: skip
    kind = draw.choice(tuple(headers))
    size = draw.choice((len(headers[kind]), len(headers[kind]), 2**63, 2**64 - 1, 0))
    put(root / path, struct.pack("<Q", size) + headers[kind])
    return f"{path}: {kind}, header of {size} bytes"


# --- files and folders


@_damage
def exchanged(draw: Draw, root: Path) -> str:
    """One file in the place of another, of the same kind or not."""
    files = _files(root, draw.choice(("", ".parquet", ".json")))
    path, source = draw.choice(files), draw.choice(files)
    put(root / path, (root / source).read_bytes())
    return f"{path}: {source}"


@_damage
def removed(draw: Draw, root: Path) -> str:
    path = draw.choice(_files(root))
    (root / path).unlink()
    return f"{path}: removed"


def _bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            server.bind(f"/proc/self/fd/{folder}/{path.name}")  # socket paths are short
        finally:
            os.close(folder)


_SPECIAL: Mapping[str, Callable[[Path], object]] = {
    "a pipe": os.mkfifo,
    "a socket": _bind,
    "a folder": Path.mkdir,
    "an empty file": Path.touch,
    "a link outside": lambda path: path.symlink_to(next(p for p in path.parents if (p / OUTSIDE).exists()) / OUTSIDE),
    "a link to a file outside": lambda path: path.symlink_to("/etc/hostname"),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link nowhere": lambda path: path.symlink_to("nowhere"),
    "ten sparse gigabytes": lambda path: (path.touch(), os.truncate(path, 10 * 2**30)),
}


@_damage
def special(draw: Draw, root: Path) -> str:
    """Something else in the place of a file, or beside it."""
    path = draw.choice(_files(root))
    kind = draw.choice(tuple(_SPECIAL))
    beside = draw.below(4) == 0
    if kind == "ten sparse gigabytes":  # of media, which may be that large, all would be hashed
        path, beside = draw.choice(_files(root, ".parquet")), False
    place = root / path
    if beside:
        place = place.with_name("extra")
    else:
        place.unlink()
    _SPECIAL[kind](place)
    return f"{place.relative_to(root)}: {kind}"


NAMES: tuple[bytes, ...] = (
    b"\xff\xfe", b"a\nb", b"\x1b[2J", "\u202egnp.exe".encode(), "\u00e9".encode(), "e\u0301".encode(), b"a\\b",
    b"C:x", b"trailing.", b"trailing ", b"-rf", b"%s", b"x" * 255, b"'; DROP TABLE x;--", b"<script>", b"\x7f",
    "\ufeff".encode(), b"...", b"NUL", b"__pycache__", b"branchdrive.py", b"ROLLOUTS.PARQUET", b"Rollouts.parquet",
    b"branchdrive.json ", b"MANIFEST.SHA256",
)  # fmt: skip
"""Names that systems, terminals, shells and people misread, or that collide where case or forms do not count."""


@_damage
def name(draw: Draw, root: Path) -> str:
    """Files with odd names; two that collide where forms of letters do not count."""
    folder = os.fsencode(root / draw.choice(("", "raw", "raw/shard-00000")))
    chosen = {draw.choice(NAMES) for _ in range(1 + draw.below(3))}
    for odd in chosen:
        Path(os.fsdecode(folder + b"/" + odd)).write_bytes(b"x")
    return f"{sorted(chosen)!r}"


@_damage
def tree(draw: Draw, root: Path) -> str:
    """Many tiny files, or a deep folder."""
    place = root / draw.choice(("", "raw", "raw/shard-00000"))
    if draw.below(2):
        count = draw.choice((100, 1000, 3000))
        (place / "many").mkdir()
        for number in range(count):
            (place / "many" / str(number)).touch()
        return f"{count} files"
    depth = draw.choice((9, 40, 100))
    place.joinpath(*["d"] * depth).mkdir(parents=True)
    return f"{depth} folders"
