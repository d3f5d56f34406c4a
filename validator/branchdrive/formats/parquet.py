"""Parquet bytes of tables, written with pinned settings; `branchdrive.formats.untrusted_parquet` reads them.

Equal tables give equal bytes (for one version of pyarrow), whatever their chunks and string encoding in memory.
Source: spec/03-layout.md#tables.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["encode_table"]

_ROW_GROUP_ROWS = 100_000
_COMPRESSION_LEVEL = 3
_TICK = "tick"


def encode_table(table: pa.Table) -> bytes:
    """Parquet bytes of `table`.

    zstd level 3; byte-stream split for floats, delta for `tick`, a dictionary for strings only;
    row groups of 100,000 rows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    encodings = {path: encoding for field in table.schema for path, encoding in _encoding(field)}
    sink = pa.BufferOutputStream()
    pq.write_table(
        table.combine_chunks(),
        sink,
        compression="zstd",
        compression_level=_COMPRESSION_LEVEL,
        use_dictionary=[field.name for field in table.schema if pa.types.is_string(field.type)],
        column_encoding=encodings,
        row_group_size=_ROW_GROUP_ROWS,
    )
    return bytes(sink.getvalue())


def _encoding(field: pa.Field) -> Iterator[tuple[str, str]]:
    """Path of the field's leaf and its encoding, where the encoding is not the default."""
    import pyarrow as pa

    if pa.types.is_floating(field.type):
        yield field.name, "BYTE_STREAM_SPLIT"
    elif pa.types.is_list(field.type) and pa.types.is_floating(field.type.value_type):
        yield f"{field.name}.list.element", "BYTE_STREAM_SPLIT"
    elif field.name == _TICK:
        yield field.name, "DELTA_BINARY_PACKED"
