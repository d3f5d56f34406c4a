"""Parquet bytes that may be hostile, read back in full and within limits.

Reading takes bytes that are already in memory and decodes every value: no filter is pushed down and no statistic is
believed, because both belong to the writer of the file. Types are Parquet's: of the Arrow schema that a writer may
have stored, metadata and nullability of columns alone are read.

Source: spec/03-layout.md#tables, spec/09-security.md#limits.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache
from inspect import signature
from typing import TYPE_CHECKING, Any, BinaryIO

from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.errors import DecodeError, LimitError

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

__all__ = ["decode_table", "promised_rows", "written_out_bytes"]

_BATCH_ROWS = 65_536
_PLAIN_BATCH_ROWS = 128
"""Rows that are decoded at once where text comes written out, of which a page can hold a thousandfold."""
_ARROW_KEY = b"ARROW:schema"
_FOOTER_END_BYTES = 8
"""The length of the footer and the magic number, at the end of a file."""

_MAX_FOOTER_BYTES = 1 << 24
"""Bytes of a footer that is read alone: of 256 columns in 100 row groups it has two million."""

_MAX_REASON_CHARACTERS = 200


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
        The table, each column in one piece, those of text and of bytes as dictionary arrays.

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
    # What pyarrow raises on damaged bytes; a C++ exception arrives as RuntimeError. A TypeError is not among them:
    # it says that this module calls pyarrow wrongly, and must not be laid at the data's door.
    except (pa.ArrowException, OSError, UnicodeError, RuntimeError, MemoryError) as error:
        raise DecodeError(f"{label} does not decode: {_reason(error)}") from error


def promised_rows(stream: BinaryIO) -> int:
    """Rows that the footer of a Parquet file promises: quick to read, and not counted.

    Args:
        stream: The file, of which the footer alone is read.

    Raises:
        DecodeError: The bytes have no footer that can be read.
    """
    import pyarrow as pa

    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(size - _FOOTER_END_BYTES, 0))
    end = stream.read(_FOOTER_END_BYTES)
    length = int.from_bytes(end[:4], "little") + _FOOTER_END_BYTES
    if len(end) < _FOOTER_END_BYTES or length > min(size, _MAX_FOOTER_BYTES):
        raise DecodeError("has no footer of a Parquet file")
    stream.seek(size - length)
    try:
        return int(_open(_footer(stream.read(length)), spec_limits()).metadata.num_rows)
    except (pa.ArrowException, OSError, UnicodeError, RuntimeError, MemoryError) as error:
        raise DecodeError(f"its footer does not decode: {_reason(error)}") from error


def _decode(content: bytes | memoryview, label: str, limits: Limits) -> pa.Table:
    import pyarrow as pa

    # Of the footer only its totals are read: on damaged metadata of a column, pyarrow ends the process.
    file = _open(content, limits)
    num_columns, num_rows_promised = file.metadata.num_columns, file.metadata.num_rows
    if num_columns > limits.max_table_columns:
        raise LimitError(f"{label} has {num_columns} columns; the limit is {limits.max_table_columns}")
    _check_size(num_rows_promised, 0, label, limits)
    stored = file.schema_arrow
    if len(set(stored.names)) != len(stored.names):
        raise DecodeError(f"{label} repeats a column name")
    footer = _open(_footer(content), limits)
    text = [field.name for field in footer.schema_arrow if _is_text(field.type)]
    try:
        file = _open(content, limits, read_dictionary=text, metadata=footer.metadata)
        batches = list(_batches(file, _BATCH_ROWS, label, limits))
    except OSError:  # damage, or text in a delta encoding, which Arrow does not read as a dictionary
        file = _open(content, limits, metadata=footer.metadata)
        batches = list(_batches(file, _PLAIN_BATCH_ROWS, label, limits))
    num_rows = sum(batch.num_rows for batch in batches)
    if num_rows != num_rows_promised:
        raise DecodeError(f"{label} promises {num_rows_promised} rows in its footer and holds {num_rows}")
    schema = batches[0].schema if batches else file.schema_arrow
    pieces = [[batch.column(place) for batch in batches] for place in range(len(schema))]
    batches.clear()
    columns = [_joined(pieces, field.type) for field in schema]
    return _with_metadata(pa.Table.from_arrays(columns, schema=schema), stored)


def _joined(pieces: list[list[pa.Array]], kind: pa.DataType) -> pa.ChunkedArray:
    """The first column in one piece and with one dictionary; what it is joined from is taken away, to be freed."""
    import pyarrow as pa

    column = pa.chunked_array(pieces.pop(0), kind).unify_dictionaries()
    return column if column.num_chunks <= 1 else pa.chunked_array([column.combine_chunks()])


def _batches(file: pq.ParquetFile, batch_rows: int, label: str, limits: Limits) -> Iterator[pa.RecordBatch]:
    """All rows of the file, as long as they keep within the limits, with text as dictionary arrays."""
    num_rows, num_bytes = 0, 0
    for decoded in file.iter_batches(batch_size=batch_rows, use_threads=False):
        num_rows += decoded.num_rows
        _check_size(num_rows, num_bytes + decoded.nbytes, label, limits)  # before text is encoded, which may shrink it
        decoded.validate(full=True)
        batch = _encoded(decoded)
        num_bytes += batch.nbytes
        yield batch


def _encoded(batch: pa.RecordBatch) -> pa.RecordBatch:
    import pyarrow as pa

    arrays = [array.dictionary_encode() if _is_text(array.type) else array for array in batch.columns]
    return pa.RecordBatch.from_arrays(arrays, names=batch.schema.names)


def _is_text(kind: pa.DataType) -> bool:
    """Whether values are text or bytes, of which a few on disk can be many in memory."""
    import pyarrow as pa

    return bool(pa.types.is_string(kind) or pa.types.is_binary(kind))


def _with_metadata(table: pa.Table, stored: pa.Schema) -> pa.Table:
    """The table with metadata and nullability as they are stored, and with lists whose elements have one name."""
    import pyarrow as pa

    if len(stored) != table.num_columns:
        raise DecodeError(f"the footer names {len(stored)} columns and the data {table.num_columns}")
    fields, columns = [], []
    # By position: hiding the Arrow schema changes a column's name that reads like its key.
    for field, column in zip(stored, table.columns, strict=True):
        kind = pa.list_(column.type.value_type) if pa.types.is_list(column.type) else column.type
        fields.append(field.with_type(kind))
        columns.append(column if column.type == kind else column.cast(kind))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields, stored.metadata))


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


def _open(content: bytes | memoryview, limits: Limits, **options: Any) -> pq.ParquetFile:
    import pyarrow as pa
    import pyarrow.parquet as pq

    return pq.ParquetFile(
        pa.BufferReader(content),
        pre_buffer=False,
        thrift_string_size_limit=limits.max_footer_string_bytes,
        thrift_container_size_limit=limits.max_footer_items,
        **_without_extensions(),
        **options,
    )


@cache
def _without_extensions() -> dict[str, bool]:
    """The option that switches extension types off; before pyarrow 21 there are none to switch off."""
    import pyarrow.parquet as pq

    name = "arrow_extensions_enabled"
    return {name: False} if name in signature(pq.ParquetFile).parameters else {}


def _footer(content: bytes | memoryview) -> bytes:
    """A file of the footer alone that names no Arrow schema, so that types follow from Parquet's."""
    end = bytes(content[-_FOOTER_END_BYTES:])
    footer = bytes(content[-_FOOTER_END_BYTES - int.from_bytes(end[:4], "little") : -_FOOTER_END_BYTES])
    return end[4:] + footer.replace(_ARROW_KEY, bytes(len(_ARROW_KEY))) + end


def _check_size(num_rows: int, num_bytes: int, label: str, limits: Limits) -> None:
    if num_rows > limits.max_table_rows:
        raise LimitError(f"{label} holds {num_rows} rows or more; the limit is {limits.max_table_rows}")
    if num_bytes > limits.max_table_decoded_bytes:
        limit = limits.max_table_decoded_bytes
        raise LimitError(f"{label} decodes to {num_bytes} bytes or more; the limit is {limit}")


def _reason(error: BaseException) -> str:
    """First line of an error's message, short and printable: it may quote the file."""
    text = str(error).split("\n", maxsplit=1)[0] or type(error).__name__
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)[:_MAX_REASON_CHARACTERS]
