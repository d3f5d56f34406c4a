"""Schemas of stored tables against the declared ones. Source: spec/05-raw-streams.md#metadata."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from branchdrive.contract.columns import declared_table, table_schema
from branchdrive.contract.document import parse_json
from branchdrive.contract.machine_trace import trace_of
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.text import printable, quote

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CHECKED_METADATA", "COLUMNS_KEY", "metadata_mismatches", "trace_mismatches", "type_mismatches"]

CHECKED_METADATA = ("unit", "frame", "shape", "track")
"""Metadata that every column carries as declared."""

COLUMNS_KEY = "branchdrive.columns"
"""Member of a file's metadata that may carry them for all columns."""


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
    """Columns of the stored table `name` whose unit, frame, shape or track is recorded otherwise than declared.

    Columns record them as metadata of their fields, in a member of the file's metadata, or, where a file has neither,
    by their names alone.
    """
    try:
        carriers = [carrier for carrier in (_of_fields(schema), _of_file(schema)) if carrier]
    except (ValueError, RecursionError) as error:
        yield Mismatch({}, f"JSON with an object for each column as {COLUMNS_KEY!r}", str(error))
        return
    for carrier in carriers:
        for column in declared_table(name).columns:
            declared, stored = column.metadata, carrier.get(column.name, {})
            for key in CHECKED_METADATA:
                wanted, found = declared.get(key), stored.get(key)
                if wanted != found:
                    yield Mismatch({"column": column.name}, f"{key} {wanted!r}", f"{found!r}")


def _of_fields(schema: pa.Schema) -> dict[str, dict[str, str]]:
    """Metadata of fields, of the columns that have any that is checked."""
    found = {}
    for field in schema:
        stored = {key.decode("utf-8", "replace"): text for key, text in (field.metadata or {}).items()}
        if checked := {key: stored[key].decode("utf-8", "replace") for key in CHECKED_METADATA if key in stored}:
            found[field.name] = checked
    return found


def _of_file(schema: pa.Schema) -> dict[str, dict[str, Any]]:
    """What the member `COLUMNS_KEY` of the file's metadata says of columns; nothing where there is none.

    Raises:
        ValueError: It is no JSON object of objects.
    """
    content = (schema.metadata or {}).get(COLUMNS_KEY.encode())
    if content is None:
        return {}
    document = parse_json(content)
    if not isinstance(document, dict) or not all(isinstance(about, dict) for about in document.values()):
        raise ValueError("is no object of objects")
    return document


def trace_mismatches(schema: pa.Schema) -> Iterator[Mismatch]:
    """Metadata of a file, key by key, that hold a trace of the machine that wrote it."""
    for key, content in sorted((schema.metadata or {}).items()):
        text = content.decode("utf-8", errors="replace")
        if trace := trace_of(text):
            name = key.decode("utf-8", errors="replace")
            yield Mismatch({}, f"metadata `{printable(name)}` without {trace}", quote(text))
