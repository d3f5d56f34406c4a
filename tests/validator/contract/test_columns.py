"""Tables and streams as code sees them: Arrow schemas, metadata, availability."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.each import each

from branchdrive.contract.columns import STREAMS, TABLES, TICK_TABLES, Column, Table, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.resources import load_resource
from branchdrive.testing import strategies

COLUMNS = [(table, column) for table in TABLES.values() for column in table.columns]
each_table = pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
COLUMN_IDS = [f"{table.name}.{column.name}" for table, column in COLUMNS]
each_column = each(("table", "column"), COLUMNS, ids=COLUMN_IDS)


def declared(table: str, column: str) -> dict[str, Any]:
    columns = load_resource("columns.json")["tables"][table]["columns"]
    return next(entry for entry in columns if entry["name"] == column)


def full_metadata(field: pa.Field) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in field.metadata.items()}


@each_table
def test_arrow_schema_has_the_declared_columns(table: Table) -> None:
    schema = table_schema(table.name)
    assert schema.names == [column.name for column in table.columns]
    assert table.file_name == f"{table.name}.parquet"


ARROW_TYPES = {
    "string": pa.string(),
    "bool": pa.bool_(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "float32": pa.float32(),
    "float64": pa.float64(),
    "list<float64>": pa.list_(pa.float64()),
}


@each_column
def test_arrow_field_is_the_declared_one(table: Table, column: Column) -> None:
    entry = declared(table.name, column.name)
    field = table_schema(table.name).field(column.name)
    assert field.type == ARROW_TYPES[entry["type"]]
    assert field.nullable == ("available" in entry)
    expected = {key: entry[key] for key in ("unit", "frame", "track", "description") if key in entry}
    if "shape" in entry:
        expected["shape"] = f"[{', '.join(entry['shape'])}]"
    assert full_metadata(field) == expected


@each_column
def test_column_is_nullable_exactly_where_it_says_when(table: Table, column: Column) -> None:
    assert column.nullable == (column.available is not None)
    if column.available:
        assert (column.available.mask is None) != (column.available.when is None)
        assert (column.available.rule is not None) == (column.available.when == "valued")


@each_column
def test_availability_refers_to_columns_that_are_always_there(table: Table, column: Column) -> None:
    if column.available and column.available.mask:
        mask = table[column.available.mask]
        assert mask.type == "bool"
        assert not mask.nullable
    if column.available and column.available.rule:
        assert not table[column.available.rule].nullable
        assert set(strategies.VALUED_RULES) <= set(table[column.available.rule].values)


@each_table
def test_every_mask_governs_a_column(table: Table) -> None:
    governed = {c.available.mask for c in table.columns if c.available and c.available.mask}
    assert {c.name for c in table.columns if c.name.endswith("_available")} == governed


@each_table
def test_key_columns_exist_and_are_never_null(table: Table) -> None:
    assert table.key
    assert not any(table[name].nullable for name in table.key)


@each_column
def test_range_is_one_that_the_type_can_hold(table: Table, column: Column) -> None:
    if column.min is not None and column.max is not None:
        assert column.min <= column.max
    for bound in (column.min, column.max):
        if bound is not None and column.type.startswith("int"):
            info = np.iinfo(column.type)
            assert bound == int(bound)
            assert info.min <= bound <= info.max


@each_table
def test_unknown_column_is_a_key_error(table: Table) -> None:
    with pytest.raises(KeyError):
        table["no_such_column"]


def test_unknown_table_is_a_key_error() -> None:
    with pytest.raises(KeyError):
        table_schema("no_such_table")


@each_table
@settings(max_examples=settings.default.max_examples // 3)
@given(data=st.data())
def test_strategy_of_values_stays_inside_the_declaration(table: Table, data: st.DataObject) -> None:
    for column in table.columns:
        value = data.draw(strategies.column_values(column))
        stored = pa.array([value], ARROW_TYPES[column.type])[0].as_py()
        assert stored == value
        for number in stored if isinstance(stored, list) else [stored]:
            assert column.min is None or number >= column.min
            assert column.max is None or number <= column.max
        if column.values:
            assert value in column.values


ORDER = ("rollouts", "controls", "decisions", "observations", "actors", "evidence", "map", "frames")


def test_tables_of_ticks_record_attempts() -> None:
    assert TICK_TABLES == ("controls", "observations", "actors", "evidence")


@given(strategies.descriptors())
def test_tables_of_a_descriptor_are_those_of_its_streams_in_order(descriptor: Descriptor) -> None:
    claimed = {table for name in descriptor.streams for table in STREAMS[name].tables}
    assert descriptor.tables == tuple(name for name in ORDER if name in claimed)
    assert {"rollouts", "controls", "observations"} <= {*descriptor.tables}


def test_required_streams_alone_need_three_tables() -> None:
    required = {name for name, stream in STREAMS.items() if stream.required}
    assert required == {"ego_route_state", "controls", "route_result"}
    assert tuple(TABLES) == ORDER


def test_streams_are_those_of_the_descriptor_schema() -> None:
    streams = load_resource("descriptor.schema.json")["properties"]["streams"]
    assert tuple(streams["items"]["enum"]) == tuple(STREAMS)
    assert streams["maxItems"] == len(STREAMS)
    required = [clause["contains"]["const"] for clause in streams["allOf"]]
    assert required == [name for name, stream in STREAMS.items() if stream.required]


def test_cameras_of_streams_are_those_of_the_descriptor_schema() -> None:
    needed = {
        clause["if"]["properties"]["streams"]["contains"]["const"]: tuple(
            camera["contains"]["properties"]["name"]["const"]
            for camera in clause["then"]["properties"]["cameras"]["allOf"]
        )
        for clause in load_resource("descriptor.schema.json")["allOf"]
        if "cameras" in clause["then"]["properties"]
    }
    assert needed == {name: stream.cameras for name, stream in STREAMS.items() if stream.cameras}
