"""Frames of derived layers as Arrow tables with the declared schema, and back.

Source: spec/10-layers.md#tables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import declared_table, table_schema
from branchdrive.errors import ContractError
from branchdrive.tables.frame import Frame, Values

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["StoredFrame", "filled", "from_arrow", "present", "to_arrow", "unsigned_zeros"]


def to_arrow(name: str, frame: Frame) -> pa.Table:
    """Arrow table of the declared schema; masked entries are null.

    Raises:
        ContractError: Columns are not those declared, or values do not fit their type.
    """
    import pyarrow as pa

    schema = table_schema(name)
    if set(frame) != set(schema.names):
        raise ContractError(
            f"table `{name}`: columns {sorted(set(frame) ^ set(schema.names))} are missing or undeclared"
        )
    try:
        columns = [_array(frame[field.name], field.type) for field in schema]
    except (pa.ArrowException, ValueError, OverflowError) as error:
        raise ContractError(f"table `{name}`: {error}") from error
    return pa.Table.from_arrays(columns, schema=schema)


def _array(values: Values, kind: pa.DataType) -> pa.Array:
    import pyarrow as pa

    plain, absent = np.ma.getdata(values), np.ma.getmaskarray(values)
    if plain.dtype == object:
        return pa.array([None if gone else cell for cell, gone in zip(plain.tolist(), absent, strict=True)], kind)
    return pa.array(plain, mask=absent).cast(kind)


def from_arrow(table: pa.Table, name: str) -> dict[str, Values]:
    """Frame of a table that has the declared columns; a nullable column is a masked array."""
    return {column.name: _values(table[column.name], column.nullable) for column in declared_table(name).columns}


class StoredFrame(Mapping[str, Values]):
    """Frame of a table that has the declared columns, each of which is read when it is first asked for.

    Who asks shares the values with others, so they cannot be changed.

    Args:
        table: Its rows.
        name: Its name.
    """

    def __init__(self, table: pa.Table, name: str) -> None:
        self._table = table
        self._nullable = {column.name: column.nullable for column in declared_table(name).columns}
        self._columns: dict[str, Values] = {}

    def __getitem__(self, column: str) -> Values:
        if column not in self._columns:
            values = self._columns[column] = _values(self._table[column], self._nullable[column])
            values.flags.writeable = False
            if np.ma.isMaskedArray(values):
                np.ma.getmask(values).flags.writeable = False
        return self._columns[column]

    def __iter__(self) -> Iterator[str]:
        return iter(self._nullable)

    def __len__(self) -> int:
        return len(self._nullable)


def _values(chunked: pa.ChunkedArray, nullable: bool) -> Values:
    import pyarrow as pa

    array = chunked.combine_chunks()
    if isinstance(array, pa.ChunkedArray):
        array = pa.concat_arrays(array.chunks)
    absent = ~present(array)
    kind = array.type
    if pa.types.is_list(kind):
        lengths = filled(array.value_lengths())
        items = np.array(array.flatten().to_numpy(zero_copy_only=False), np.float64)
        plain = np.empty(len(array), dtype=object)
        for i, (stop, length) in enumerate(zip(np.cumsum(lengths).tolist(), lengths.tolist(), strict=True)):
            plain[i] = items[stop - length : stop]
    elif pa.types.is_string(kind) or pa.types.is_dictionary(kind):
        coded = array if pa.types.is_dictionary(kind) else array.dictionary_encode()
        categories = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
        plain = categories[np.where(absent, -1, filled(coded.indices))]
    else:
        plain = filled(array)
    return np.ma.masked_array(plain, absent) if nullable else plain


def filled(array: pa.Array) -> NDArray[Any]:
    """Numbers or flags of an array; null numbers read 0, null flags false."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_boolean(array.type) and len(array):
        flags = _bits(array, 1)
        return flags & present(array) if array.null_count else flags
    if array.null_count:
        array = pc.fill_null(array, pa.scalar(0, array.type))
    return np.asarray(array.to_numpy(zero_copy_only=False))


def present(array: pa.Array) -> NDArray[np.bool_]:
    """Where an array has values ``[rows]``."""
    return _bits(array, 0) if array.null_count else np.ones(len(array), bool)


def _bits(array: pa.Array, buffer: int) -> NDArray[np.bool_]:
    """Bits of an array that has rows; ten times as fast as the way by Arrow."""
    packed, num_bits = np.frombuffer(array.buffers()[buffer], np.uint8), array.offset + len(array)
    return np.unpackbits(packed, count=num_bits, bitorder="little")[array.offset :].view(bool)


def unsigned_zeros(array: pa.Array) -> pa.Array:
    """The same values with every zero of floating-point numbers as +0.0, in the cells of lists too."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_list(array.type):
        items = unsigned_zeros(array.values)
        return pa.ListArray.from_arrays(array.offsets, items, type=array.type, mask=array.is_null())
    return pc.add(array, pa.scalar(0.0, array.type)) if pa.types.is_floating(array.type) else array
