"""Stored tables: Parquet files of unknown origin, read whole, within limits, with the declared columns.

Source: spec/03-layout.md#tables, spec/09-security.md#limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES, TABLES, table_schema
from branchdrive.contract.layer import LAYERS, layer_of_table, table_file, table_path, table_paths
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.formats.store import Store
from branchdrive.formats.untrusted_parquet import decode_table, written_out_bytes

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "absent_table", "conform", "join_parts", "layer_table_paths", "part_numbers", "partitions_of", "parts_of",
    "read_layer_table", "read_table",
]  # fmt: skip

_ALL_IN_FIRST: Mapping[str, int] = MappingProxyType({})


def layer_table_paths(dataset: Store, name: str) -> tuple[str, ...]:
    """Paths of the files of a derived layer's table that a dataset has, in the order of their rows.

    Of a table that is optional there may be none.

    Raises:
        DatasetError: It has none, or of one partition none; or its folder cannot be listed.
    """
    layer = LAYERS[layer_of_table(name)]
    paths = table_paths(name, (f"{layer.name}/{entry}" for entry in dataset.names(layer.name)))
    for path in layer.missing(paths):
        if (file := table_file(path)) is not None and file.table == name:
            raise DatasetError(f"{dataset}: {path!r} is missing; run `branchdrive build` to make the layers again")
    return paths


def absent_table(dataset: Store, name: str) -> DatasetError:
    """What to tell who asks for an optional table that a dataset does without."""
    return DatasetError(f"{dataset}: has no table `{name}`, which `branchdrive build --{name}` adds")


def read_layer_table(dataset: Store, name: str) -> pa.Table:
    """The table `name` of a derived layer, from all of its files; see `read_table`.

    Raises:
        DatasetError: It cannot be read, or it is optional and not there.
    """
    paths = layer_table_paths(dataset, name)
    if not paths:
        raise absent_table(dataset, name)
    return join_parts([read_table(dataset, path, name) for path in paths])


def join_parts(parts: Sequence[pa.Table]) -> pa.Table:
    """Rows of the files of one table, one file after the other, with one dictionary for each column of text.

    Columns stand in the order of the first file, and may hold nulls where those of any file may.
    """
    import pyarrow as pa

    if len(parts) == 1:
        return parts[0]
    first = parts[0].schema
    fields = (field.with_nullable(any(part.field(field.name).nullable for part in parts)) for field in first)
    schema = pa.schema(fields, first.metadata)
    alike = [part.select(schema.names).cast(schema) for part in parts]
    return pa.concat_tables(alike).unify_dictionaries().combine_chunks()


def parts_of(name: str, table: pa.Table, parts: Mapping[str, int] = _ALL_IN_FIRST) -> dict[str, pa.Table]:
    """Rows of a table of a derived layer by the path of the file that they belong in, without those of no partition.

    Args:
        name: The table.
        table: Its rows.
        parts: Number of the part of each group; the first, of a group that is not named.
    """
    import pyarrow as pa

    declared, found = LAYER_TABLES[name], {}
    for partition, rows in partitions_of(name, table):
        numbers = part_numbers(rows["group_id"].to_pylist(), parts) if declared.is_of_groups else np.zeros(0, np.int64)
        for part in np.unique(numbers).tolist() or [0]:
            is_own = numbers == part
            found[table_path(name, partition, part)] = rows if is_own.all() else rows.filter(pa.array(is_own))
    return found


def partitions_of(name: str, table: pa.Table) -> Iterator[tuple[str | None, pa.Table]]:
    """Rows of a table of a derived layer by their partition; all of them, of ``None``, where it has no partitions."""
    import pyarrow.compute as pc

    for partition in LAYER_TABLES[name].partitions or (None,):
        yield partition, table if partition is None else table.filter(pc.equal(table["partition"], partition))


def part_numbers(groups: Sequence[str], parts: Mapping[str, int]) -> NDArray[np.int64]:
    """Number of the part of each of `groups`; the first, of a group that is not named."""
    return np.fromiter((parts.get(group, 0) for group in groups), np.int64, len(groups))


def read_table(dataset: Store, path: str, name: str) -> pa.Table:
    """The table `name` in the file `path` of a dataset, as stored: text as dictionaries, with the file's metadata.

    Raises:
        DatasetError: The file is missing, does not decode, has other columns or nulls than declared, or its
            text would be larger than a decoded table may be, written out for every row.
    """
    content = dataset.read(path, spec_limits().max_table_bytes)
    try:
        table = decode_table(content, name)
    except DecodeError as error:
        raise DatasetError(f"{dataset}: {path!r}: {error}") from error
    schema = table_schema(name)
    found, declared = _types(table.schema), _types(schema)
    if found != declared:
        columns = sorted(column for column in found | declared if found.get(column) != declared.get(column))
        home = "columns.json" if name in TABLES else "layers.json"
        raise DatasetError(f"{dataset}: {path!r}: columns {columns} are not as {home} declares")
    nulls = [field.name for field in schema if not field.nullable and table.column(field.name).null_count]
    if nulls:
        raise DatasetError(f"{dataset}: {path!r}: columns {nulls} hold nulls and must not")
    num_bytes, limit = written_out_bytes(table), spec_limits().max_table_decoded_bytes
    if num_bytes > limit:
        raise DatasetError(
            f"{dataset}: {path!r}: its text is {num_bytes:,} bytes long, written out for every row, "
            f"and may be {limit:,}; run `branchdrive-validate`"
        )
    return table


def conform(table: pa.Table, name: str) -> pa.Table:
    """`table` with exactly the declared schema of the table `name`: plain strings, declared metadata."""
    import pyarrow as pa

    schema = table_schema(name)
    columns = [table.column(field.name).cast(field.type) for field in schema]
    return pa.Table.from_arrays(columns, schema=schema).combine_chunks()


def _types(schema: pa.Schema) -> dict[str, pa.DataType]:
    """Type of every column by name, text without its dictionary and lists without the name of their element."""
    import pyarrow as pa

    types = {}
    for field in schema:
        type_ = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        types[field.name] = pa.list_(type_.value_type) if pa.types.is_list(type_) else type_
    return types
