"""Rows of one table that arrive in pieces, and their strict conversion to the declared Arrow types.

Source: spec/05-raw-streams.md#values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Sized
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from branchdrive.contract.columns import TABLES, Column, Table, table_schema
from branchdrive.errors import ContractError
from branchdrive.raw.rollout import key_columns
from branchdrive.tables.arrow import unsigned_zeros

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["RowBuffer", "check_names", "map_table", "record_table"]

_INTEGERS: tuple[type, ...] = (int, np.integer)
_REALS: tuple[type, ...] = (int, float, np.integer, np.floating)
_FLAGS: tuple[type, ...] = (bool, np.bool_)
_SCALAR_TYPES: Mapping[str, tuple[type, ...]] = {
    "string": (str,), "bool": _FLAGS, "int32": _INTEGERS, "int64": _INTEGERS, "float32": _REALS, "float64": _REALS,
    "list<float64>": (list, tuple, np.ndarray),
}  # fmt: skip
"""Python and numpy types that a value may have, by column type; a flag is never a number."""

_ARRAY_KINDS = {"bool": "b", "int32": "iu", "int64": "iu", "float32": "iuf", "float64": "iuf"}
"""Kinds of numpy dtypes that an array may have, by column type."""

_REMEDY = "give values of the declared type, None where a value is unavailable"


def check_names(names: Collection[str], allowed: Collection[str], required: Collection[str], where: str) -> None:
    """Refuse names that are not declared, or required names that are missing.

    Raises:
        ContractError: With the offending names.
    """
    unknown = sorted(set(names) - set(allowed))
    if unknown:
        raise ContractError(f"{where}: unknown columns {unknown}; the declared ones are {sorted(allowed)}")
    missing = sorted(set(required) - set(names))
    if missing:
        raise ContractError(
            f"{where}: missing columns {missing}; only columns with an availability, and those that the descriptor "
            "lists as `unrecorded`, may be left out"
        )


class RowBuffer:
    """Rows of `table` for one rollout, without the column `rollout_id`, which is added at the end."""

    def __init__(self, table: Table, unrecorded: Collection[str]) -> None:
        self._table = table
        self._schema = table_schema(table.name)
        self._columns = {column.name: column for column in table.columns if column.name != "rollout_id"}
        self._required = frozenset(n for n, column in self._columns.items() if column.is_required(unrecorded))
        self._scalars: dict[str, list[object]] = {name: [] for name in self._columns}
        self._arrays: dict[str, list[pa.Array]] = {name: [] for name in self._columns}
        self.num_rows = 0

    def append(self, values: Mapping[str, object]) -> None:
        """Append one row of scalars, or as many rows as the arrays have; a scalar beside arrays is repeated.

        Raises:
            ContractError: A column is unknown or missing, lengths differ, or values have a wrong type.
        """
        if values.keys() != self._columns.keys():
            check_names(values.keys(), self._columns.keys(), self._required, f"table `{self._table.name}`")
        lengths = {name: len(value) for name, value in values.items() if _is_sequence(value)}
        if not lengths:
            for name, pending in self._scalars.items():
                pending.append(_plain(values.get(name)))
            self.num_rows += 1
            return
        if len(set(lengths.values())) > 1:
            raise ContractError(f"table `{self._table.name}`: columns have different lengths: {lengths}")
        length = next(iter(lengths.values()))
        pieces = {name: self._piece(column, values.get(name), length) for name, column in self._columns.items()}
        self._settle()
        for name, piece in pieces.items():
            self._arrays[name].append(piece)
        self.num_rows += length

    def _piece(self, column: Column, value: object, length: int) -> pa.Array:
        where = f"`{self._table.name}.{column.name}`, from row {self.num_rows} on"
        type_ = self._schema.field(column.name).type
        if isinstance(value, np.ndarray) and value.ndim:
            return _from_numpy(value, column.type, type_, where)
        values = value if isinstance(value, (list, tuple)) else [value] * length
        return _from_sequence(values, column.type, type_, where)

    def _settle(self) -> None:
        """Turn the scalars that wait into arrays."""
        for name, pending in self._scalars.items():
            if pending:
                where = f"`{self._table.name}.{name}`, up to row {self.num_rows - 1}"
                type_ = self._schema.field(name).type
                self._arrays[name].append(_from_sequence(pending, self._columns[name].type, type_, where))
                self._scalars[name] = []

    def to_table(self, rollout_id: str) -> pa.Table:
        """The rows as a table of the declared schema, sorted by the table's key; equal keys stay as appended.

        Raises:
            ContractError: Scalars have a wrong type.
        """
        import pyarrow as pa

        self._settle()
        columns = [
            pa.chunked_array([pa.repeat(pa.scalar(rollout_id), self.num_rows)])
            if field.name == "rollout_id"
            else pa.chunked_array(self._arrays[field.name], type=field.type)
            for field in self._schema
        ]
        table = pa.Table.from_arrays(columns, schema=self._schema)
        return table.take(np.lexsort(key_columns(table, self._table))).combine_chunks()


def map_table(town: str, elements: Sequence[Mapping[str, object]]) -> pa.Table:
    """Rows of the table `map` for the elements of a town, by ``element_id``.

    Raises:
        ContractError: A column is unknown or missing, or a value has a wrong type.
    """
    import pyarrow as pa

    declared = TABLES["map"]
    allowed = {column.name for column in declared.columns} - {"town"}
    required = {column.name for column in declared.columns if not column.nullable} - {"town"}
    rows = [table_schema("map").empty_table()]
    for element in elements:
        check_names(element.keys(), allowed, required, f"map of `{town}`")
        rows.append(record_table(declared, {**element, "town": town}))
    return pa.concat_tables(rows).sort_by("element_id").combine_chunks()


def record_table(declared: Table, record: Mapping[str, object]) -> pa.Table:
    """A table of one row with the declared schema; columns that `record` lacks are null.

    Raises:
        ContractError: A value has a wrong type.
    """
    import pyarrow as pa

    schema = table_schema(declared.name)
    columns = [
        _from_sequence([record.get(column.name)], column.type, field.type, f"`{declared.name}.{column.name}`")
        for column, field in zip(declared.columns, schema, strict=True)
    ]
    return pa.Table.from_arrays(columns, schema=schema)


def _is_sequence(value: object) -> TypeGuard[Sized]:
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _plain(value: object) -> object:
    """A scalar without its array: numpy has scalars that are arrays of no dimension."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return None if np.ma.is_masked(value) else value[()]
    return value


def _from_sequence(values: Sequence[object], declared: str, type_: pa.DataType, where: str) -> pa.Array:
    """Arrow array of Python values; `None` and `numpy.ma.masked` are null.

    Args:
        values: One value a row.
        declared: Column type as columns.json names it.
        type_: The same as an Arrow type.
        where: The place, for messages.
    """
    import pyarrow as pa

    plain = [_plain(value) for value in values]
    accepted = _SCALAR_TYPES[declared]
    for kind in {type(value) for value in plain} - {type(None)}:
        if not issubclass(kind, accepted) or (kind is bool and bool not in accepted):
            wrong = next(value for value in plain if type(value) is kind)
            raise ContractError(f"{where}: expected {declared}, found {_quote(wrong)}; {_REMEDY}")
    if pa.types.is_list(type_):
        lists = [value for value in plain if isinstance(value, (list, tuple, np.ndarray))]
        for value in lists:
            _from_sequence(list(value), "float64", type_.value_type, where)
    try:
        return unsigned_zeros(pa.array(plain, type=type_))
    except (pa.ArrowException, ValueError, OverflowError) as error:
        raise ContractError(f"{where}: expected {declared}, found {_quote(plain)} ({error}); {_REMEDY}") from error


def _from_numpy(values: np.ndarray[Any, Any], declared: str, type_: pa.DataType, where: str) -> pa.Array:
    """Arrow array of a numpy array; masked entries are null, floats are rounded to the declared width."""
    import pyarrow as pa

    if values.ndim != 1:
        raise ContractError(f"{where}: expected one dimension, found shape {values.shape}")
    kind = values.dtype.kind
    if kind == "O" or (kind == "U" and declared == "string"):
        return _from_sequence(values.tolist(), declared, type_, where)
    if kind not in _ARRAY_KINDS.get(declared, ""):
        raise ContractError(f"{where}: expected {declared}, found an array of {values.dtype}; {_REMEDY}")
    try:
        array = pa.array(
            np.array(np.ma.getdata(values)), mask=np.ma.getmaskarray(values)
        )  # a copy: callers reuse arrays
        return unsigned_zeros(array.cast(type_, safe=kind != "f"))
    except pa.ArrowException as error:
        raise ContractError(f"{where}: expected {declared}, found {values.dtype} ({error}); {_REMEDY}") from error


def _quote(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
