"""The machine form in `schemas/` is well formed and agrees with itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.contract.columns import PATTERNS, STREAMS, TABLES, Column, Table
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.resources import SPEC_VERSION, load_resource, schema_dir

SCHEMAS = sorted(path.name for path in schema_dir().glob("*.schema.json"))
COLUMNS = [(table, column) for table in TABLES.values() for column in table.columns]
UNIT_SUFFIXES: dict[str, str | tuple[str, ...]] = {
    "m": "_m",
    "m/s": "_mps",
    "m/s2": "_mps2",
    "rad": "_rad",
    "rad/s": "_radps",
    "s": "_s",
    "tick": ("tick", "_ticks"),
    "byte": "_bytes",
}

each_schema = each("schema_name", SCHEMAS)
each_column = each(("table", "column"), COLUMNS, ids=[f"{table.name}.{column.name}" for table, column in COLUMNS])


@pytest.mark.parametrize("document", ["rules", "clauses", "columns", "layers", "limits", "metrics", "action-bank"])
def test_declarations_meet_their_schema(document: str) -> None:
    assert schema_mismatches(load_resource(f"{document}.json"), f"{document}.schema.json") == []


def test_every_declaration_has_a_schema() -> None:
    declared = {path.stem for path in schema_dir().glob("*.json") if not path.name.endswith(".schema.json")}
    declared -= {"benchmark-protocol", "benchmark-protocol-visual"}  # as `protocol.schema.json` has them
    assert {f"{stem}.schema.json" for stem in declared} <= set(SCHEMAS)


@each_schema
def test_schema_is_a_json_schema(schema_name: str) -> None:
    Draft202012Validator.check_schema(load_resource(schema_name))


@each_schema
def test_schema_is_named_by_its_file(schema_name: str) -> None:
    schema = load_resource(schema_name)
    assert schema["$id"] == f"https://branchdrive.org/schemas/v{SPEC_VERSION}/{schema_name}"
    assert schema["title"]
    assert schema["description"]


@each_schema
def test_chapters_that_a_schema_names_exist(schema_name: str) -> None:
    for chapter in re.findall(r"spec/[\w-]+\.md", (schema_dir() / schema_name).read_text(encoding="utf-8")):
        assert (ROOT / chapter).is_file()


def texts(node: Any, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Places of a schema that admit a text, with what they say of it."""
    if isinstance(node, dict):
        kinds = node.get("type", ())
        if "string" in ([kinds] if isinstance(kinds, str) else kinds):
            yield place, node
    for key, value in node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ():
        yield from texts(value, f"{place}/{key}")


@pytest.mark.parametrize("name", ["protocol", "lock", "ledger", "results"])
def test_texts_of_a_benchmark_are_one_printable_line(name: str) -> None:
    """They are rendered as Markdown and printed on terminals."""
    for place, text in texts(load_resource(f"{name}.schema.json")):
        assert "pattern" in text or "enum" in text, place
        for odd in ("a\nb", "\x1b[2J", "a\u202eb", "\u2028") if "pattern" in text else ():
            assert re.search(text["pattern"].replace("$", r"\Z"), odd) is None, place


@each_column
def test_column_carries_its_unit_in_its_name(table: Table, column: Column) -> None:
    if column.unit:
        assert column.name.endswith(UNIT_SUFFIXES[column.unit])


@each_column
def test_column_refers_to_what_exists(table: Table, column: Column) -> None:
    names = {other.name for other in table.columns}
    assert column.pattern is None or column.pattern in PATTERNS
    if column.available:
        assert {name for name in (column.available.mask, column.available.rule) if name} <= names
        if column.available.mask:
            assert table[column.available.mask].type == "bool"
            assert not table[column.available.mask].nullable


@each_column
def test_column_bounds_what_it_holds(table: Table, column: Column) -> None:
    if column.min is not None and column.max is not None:
        assert column.min < column.max
    if column.type == "string":
        assert column.pattern or column.values


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda table: table.name)
def test_table_has_unique_columns_and_a_required_key(table: Table) -> None:
    names = [column.name for column in table.columns]
    assert len(set(names)) == len(names)
    assert set(table.key) <= set(names)
    assert not any(table[name].nullable for name in table.key)


def test_every_table_belongs_to_a_stream() -> None:
    assert {name for stream in STREAMS.values() for name in stream.tables} == set(TABLES)


def test_records_name_columns_of_rollouts() -> None:
    records = load_resource("columns.json")["records"]
    names = {column.name for column in TABLES[records["rollout"]["table"]].columns}
    assert {*records["branch_group"]["shared"], *records["branch_group"]["attempts"]} <= names


def test_versions_agree() -> None:
    for path in sorted(Path(schema_dir()).glob("*.json")):
        if path.name.startswith("benchmark-protocol"):  # has a version of its own
            continue
        assert load_resource(path.name).get("version", SPEC_VERSION) == SPEC_VERSION, path.name
    assert load_resource("descriptor.schema.json")["properties"]["spec_version"]["const"] == SPEC_VERSION
