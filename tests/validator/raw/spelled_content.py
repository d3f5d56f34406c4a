"""Digests of what tables say, byte by byte as the specification spells them, without the code that computes them.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from typing import Any

from branchdrive.contract.columns import Column, declared_table

ORDER = ("rollouts", "controls", "observations", "actors", "evidence")
"""Tables whose rows belong to attempts, in declared order."""

Row = dict[str, Any]


def sha(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


def spelled(column: Column, cells: list[Any]) -> bytes:
    """A column of a block, byte by byte as chapter 3 has it."""
    content = bytes(cell is not None for cell in cells) if column.nullable else b""
    if column.type == "string":
        texts = sorted({cell.encode() for cell in cells if cell is not None})
        places = [-1 if cell is None else texts.index(cell.encode()) for cell in cells]
        content += b"".join(struct.pack("<i", place) for place in (*places, len(texts)))
        return content + b"".join(struct.pack("<i", len(text)) + text for text in texts)
    if column.type.startswith("list"):
        lists = [cell or [] for cell in cells]
        content += b"".join(struct.pack("<i", len(values)) for values in lists)
        return content + b"".join(struct.pack("<d", value) for values in lists for value in values)
    form = {"bool": "<?", "int32": "<i", "int64": "<q", "float32": "<f", "float64": "<d"}[column.type]
    return content + b"".join(struct.pack(form, 0 if cell is None else cell) for cell in cells)


def table_block(name: str, rows: Sequence[Row]) -> bytes:
    """Digest of the block of rows of a table, in the order of their key, which no two share."""
    ordered = sorted(rows, key=lambda row: [_sortable(row[part]) for part in declared_table(name).key])
    return sha(
        f"{name} {len(rows)}\n".encode()
        + b"".join(spelled(column, [row[column.name] for row in ordered]) for column in declared_table(name).columns)
    )


def _sortable(value: Any) -> Any:
    return value.encode() if isinstance(value, str) else value


def group_blocks(group_id: str, rows: dict[str, list[Row]]) -> dict[str, bytes]:
    """Digests of the rows of a branch group in every table, in the order of `ORDER`."""
    attempts = {row["rollout_id"] for row in rows["rollouts"] if row["group_id"] == group_id}
    own = {name: [row for row in rows[name] if row["rollout_id"] in attempts] for name in ORDER if name in rows}
    return {name: table_block(name, found) for name, found in own.items()}


def lines_digest(parts: dict[str, str]) -> str:
    """Digest of lines of a name and a digest, sorted by the bytes of the names."""
    return sha("".join(f"{name} {parts[name]}\n" for name in sorted(parts, key=str.encode)).encode()).hex()
