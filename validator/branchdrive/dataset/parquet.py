"""Parquet bytes of tables: written with pinned settings, read back in full and within limits.

Equal tables give equal bytes (for one version of pyarrow), whatever their chunks and string
encoding in memory. Reading takes bytes that are already in memory and decodes every value:
no filter is pushed down and no statistic is believed, because both belong to whoever wrote the file.

Source: spec/03-layout.md#tables, spec/09-security.md#limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.errors import DecodeError, LimitError

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

__all__ = ["decode_table", "encode_table", "written_out_bytes"]

_ROW_GROUP_ROWS = 100_000
_COMPRESSION_LEVEL = 3
_BATCH_ROWS = 65_536
_TICK = "tick"

_MAX_REASON_CHARACTERS = 200


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


def decode_table(content: bytes | memoryview, name: str | None = None, limits: Limits | None = None) -> pa.Table:
    """Every value of the Parquet file `content`, which may be hostile.

    The file is decoded batch by batch, and decoding stops as soon as it exceeds a limit, whatever
    its footer says. One batch, and one page, can still be large: a process that decodes strangers'
    files also needs a memory limit, which ends in the same error.

    Args:
        content: The file.
        name: Name of the table, for messages.
        limits: Limits on rows, columns and decoded bytes; those of the spec by default.

    Returns:
        The table with string columns as dictionary arrays, one dictionary per column.

    Raises:
        LimitError: The table exceeds a limit.
        DecodeError: The bytes are no Parquet file or are damaged.
    """
    import pyarrow as pa

    limits = limits or spec_limits()
    label = f"table `{name}`" if name else "table"
    if len(content) > limits.max_table_bytes:
        raise LimitError(f"{label} has {len(content)} bytes; the limit is {limits.max_table_bytes}")
    try:
        return _decode(content, label, limits)
    # What pyarrow raises on damaged bytes spans these classes; a C++ exception arrives as RuntimeError.
    except (pa.ArrowException, OSError, ValueError, TypeError, LookupError, RuntimeError, MemoryError) as error:
        raise DecodeError(f"{label} does not decode: {_reason(error)}") from error


def _decode(content: bytes | memoryview, label: str, limits: Limits) -> pa.Table:
    import pyarrow as pa

    file = _open(content, [], limits)
    # Of the footer only its totals are read: on damaged metadata of a column, pyarrow ends the process.
    num_columns, num_rows_promised = file.metadata.num_columns, file.metadata.num_rows
    if num_columns > limits.max_table_columns:
        raise LimitError(f"{label} has {num_columns} columns; the limit is {limits.max_table_columns}")
    schema = file.schema_arrow
    if len(set(schema.names)) != len(schema.names):
        raise DecodeError(f"{label} repeats a column name")
    _check_size(num_rows_promised, 0, label, limits)
    file = _open(content, [field.name for field in schema if pa.types.is_string(field.type)], limits)
    batches, num_rows, num_bytes = [], 0, 0
    for batch in file.iter_batches(batch_size=_BATCH_ROWS, use_threads=False):
        num_rows += batch.num_rows
        num_bytes += batch.nbytes
        _check_size(num_rows, num_bytes, label, limits)
        batch.validate(full=True)
        batches.append(batch)
    if num_rows != num_rows_promised:
        raise DecodeError(f"{label} promises {num_rows_promised} rows in its footer and holds {num_rows}")
    return _canonical(pa.Table.from_batches(batches, schema=file.schema_arrow).unify_dictionaries())


def _canonical(table: pa.Table) -> pa.Table:
    """The table with one Arrow type for each Parquet type, whatever Arrow types its writer used.

    Parquet has one type of text and one of lists; large, view and non-null variants are Arrow's.
    """
    import pyarrow as pa

    fields = []
    for field in table.schema:
        kind = field.type
        if pa.types.is_large_string(kind) or pa.types.is_string_view(kind):
            kind = pa.string()
        elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
            kind = pa.list_(kind.value_type)
        fields.append(field.with_type(kind))
    schema = pa.schema(fields, table.schema.metadata)
    return table if schema.equals(table.schema) else table.cast(schema)


def written_out_bytes(table: pa.Table) -> int:
    """Bytes of a table's text, written out for every row; a dictionary holds it once however many rows have it."""
    import pyarrow as pa
    import pyarrow.compute as pc

    num_bytes = 0
    for piece in (piece for column in table.columns for piece in column.chunks):
        if pa.types.is_dictionary(piece.type):
            lengths = pc.binary_length(piece.dictionary).cast(pa.int64())
            num_bytes += int(pc.sum(lengths.take(piece.indices)).as_py() or 0)
    return num_bytes


def _open(content: bytes | memoryview, strings: list[str], limits: Limits) -> pq.ParquetFile:
    import pyarrow as pa
    import pyarrow.parquet as pq

    return pq.ParquetFile(
        pa.BufferReader(content),
        read_dictionary=strings,
        pre_buffer=False,
        thrift_string_size_limit=limits.max_footer_string_bytes,
        thrift_container_size_limit=limits.max_footer_items,
        arrow_extensions_enabled=False,
    )


def _check_size(num_rows: int, num_bytes: int, label: str, limits: Limits) -> None:
    if num_rows > limits.max_table_rows:
        raise LimitError(f"{label} holds {num_rows} rows or more; the limit is {limits.max_table_rows}")
    if num_bytes > limits.max_table_decoded_bytes:
        limit = limits.max_table_decoded_bytes
        raise LimitError(f"{label} decodes to {num_bytes} bytes or more; the limit is {limit}")


def _reason(error: BaseException) -> str:
    """First line of an error's message, short and printable: it may quote the file."""
    words = str(error).split("\n", maxsplit=1)[0] or type(error).__name__
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in words)[:_MAX_REASON_CHARACTERS]
