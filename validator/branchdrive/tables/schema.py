"""Schemas of stored tables against the declared ones. Source: spec/05-raw-streams.md#metadata."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from branchdrive.contract.columns import declared_table, table_schema
from branchdrive.contract.machine_trace import trace_of
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.text import printable, quote

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CHECKED_METADATA", "metadata_mismatches", "trace_mismatches", "type_mismatches"]

CHECKED_METADATA = ("unit", "frame", "shape", "track")
"""Metadata that every column carries as declared."""


def type_mismatches(schema: pa.Schema, name: str) -> Iterator[Mismatch]:
    """Columns of the stored table `name` that are missing, undeclared or of another type."""
    declared = table_schema(name)
    there = set(schema.names)
    for field in declared:
        if field.name not in there:
            yield Mismatch({"column": field.name}, f"{field.type}", "no such column")
    for column in schema:
        kind = _plain(column.type)
        if column.name not in declared.names:
            yield Mismatch({"column": column.name}, "no undeclared column", f"{kind}")
        elif not kind.equals(declared.field(column.name).type):
            yield Mismatch({"column": column.name}, f"{declared.field(column.name).type}", f"{kind}")


def _plain(kind: pa.DataType) -> pa.DataType:
    """The type of a column's values; text and bytes may come as a dictionary, other values may not."""
    import pyarrow as pa

    is_encoded = pa.types.is_dictionary(kind) and (
        pa.types.is_string(kind.value_type) or pa.types.is_binary(kind.value_type)
    )
    return kind.value_type if is_encoded else kind


def metadata_mismatches(schema: pa.Schema, name: str) -> Iterator[Mismatch]:
    """Columns of the stored table `name` whose unit, frame, shape or track is not recorded as declared."""
    for column in declared_table(name).columns:
        stored = schema.field(column.name).metadata or {}
        for key in CHECKED_METADATA:
            wanted, found = column.metadata.get(key), stored.get(key.encode())
            if wanted != (found.decode("utf-8", "replace") if found is not None else None):
                yield Mismatch({"column": column.name}, f"{key} {wanted!r}", f"{found!r}")


def trace_mismatches(schema: pa.Schema) -> Iterator[Mismatch]:
    """Metadata of a file, key by key, that hold a trace of the machine that wrote it."""
    for key, content in sorted((schema.metadata or {}).items()):
        text = content.decode("utf-8", errors="replace")
        if trace := trace_of(text):
            name = key.decode("utf-8", errors="replace")
            yield Mismatch({}, f"metadata `{printable(name)}` without {trace}", quote(text))
