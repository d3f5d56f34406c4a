"""Declarations of the derived layers: their metaschema, names, keys, masks, patterns, documents and paths."""

from __future__ import annotations

import copy
from fnmatch import fnmatchcase
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pydantic import ValidationError
from tests.each import each
from tests.mismatch import pointers
from tests.repo.checkout import ROOT, anchors

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import (
    LAYER_TABLES,
    PATTERNS,
    RECORDABLE,
    TABLES,
    Column,
    Table,
    declared_table,
    table_schema,
)
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.layer import (
    LAYERS,
    layer_of_table,
    part_of,
    part_of_shard,
    table_file,
    table_path,
    table_paths,
    table_pattern,
)  # fmt: skip
from branchdrive.contract.layout import MAX_SHARD_INDEX, shard_name
from branchdrive.contract.resources import load_resource, schema_dir

COLUMNS = [(table, column) for table in LAYER_TABLES.values() for column in table.columns]
COLUMN_IDS = [f"{table.name}.{column.name}" for table, column in COLUMNS]
UNIT_SUFFIXES: dict[str, tuple[str, ...]] = {
    "m": ("_m",), "m/s": ("_mps",), "m/s2": ("_mps2",), "m/s3": ("_mps3",), "rad": ("_rad",), "deg": ("_deg",),
    "rad/s": ("_radps",), "s": ("_s",), "tick": ("_tick", "_ticks", "tick_offset"), "byte": ("_bytes",),
}  # fmt: skip

each_table = each("table", LAYER_TABLES.values(), ids=LAYER_TABLES)
each_column = each(("table", "column"), COLUMNS, ids=COLUMN_IDS)


def declarations() -> dict[str, Any]:
    return copy.deepcopy(load_resource("layers.json"))


def test_declarations_meet_their_schema() -> None:
    assert schema_mismatches(declarations(), "layers.schema.json") == []


def records_column(document: dict[str, Any]) -> dict[str, Any]:
    column: dict[str, Any] = document["layers"]["canonical"]["tables"]["records"]["columns"][0]
    return column


@each(
    ("pointer", "change"),
    [
        pytest.param("/layers", lambda d: d["layers"].pop("model"), id="a layer lacks"),
        pytest.param("/layers", lambda d: d["layers"].update(media={}), id="a layer too many"),
        pytest.param("/layers/model/after", lambda d: d["layers"]["model"].update(after="media"), id="no such layer"),
        pytest.param(
            "/layers/canonical/tables/records/rate",
            lambda d: d["layers"]["canonical"]["tables"]["records"].update(rate="20 Hz"),
            id="a rate of shards",
        ),
        pytest.param(
            "/layers/canonical/tables/records/columns/0/track",
            lambda d: records_column(d).update(track="secret"),
            id="no such track",
        ),
        pytest.param(
            "/layers/canonical/tables/records/columns/0",
            lambda d: records_column(d).update(nullable=True),
            id="an undeclared property of a column",
        ),
        pytest.param(
            "/layers/canonical/tables/records/key",
            lambda d: d["layers"]["canonical"]["tables"]["records"].update(key=["group_id", "group_id"]),
            id="a key that repeats a column",
        ),
        pytest.param(
            "/layers/canonical/documents/source.json/schema",
            lambda d: d["layers"]["canonical"]["documents"]["source.json"].update(schema="../x.schema.json"),
            id="a schema elsewhere",
        ),
    ],
)
def test_broken_declarations_are_refused(pointer: str, change: Any) -> None:
    document = declarations()
    change(document)
    assert pointer in pointers(schema_mismatches(document, "layers.schema.json"))


def test_layers_are_derived_one_from_another() -> None:
    assert list(LAYERS) == ["canonical", "quality", "model", "benchmark"]
    assert [layer.after for layer in LAYERS.values()] == ["raw", *list(LAYERS)[:-1]]


def test_layers_of_a_descriptor_are_runs_of_these() -> None:
    chain = ["raw", *LAYERS]
    runs = [chain[start:stop] for start in (0, 1) for stop in range(start + 1, len(chain) + 1)]
    allowed = load_resource("descriptor.schema.json")["properties"]["layers"]["enum"]
    assert sorted(allowed) == sorted(runs)


ORDERS = [
    ["raw"], ["raw", "canonical", "quality", "model"], ["canonical"], ["canonical", "quality", "model"],
    ["raw", "canonical", "quality", "model", "benchmark"], ["canonical", "quality", "model", "benchmark"],
]  # fmt: skip
GAPS = [
    [], ["quality"], ["raw", "quality"], ["canonical", "raw"], ["raw", "raw"], ["raw", "media"], ["model"],
    ["raw", "benchmark"], ["canonical", "quality", "benchmark"], ["benchmark"],
]  # fmt: skip


def described(layers: list[str]) -> dict[str, Any]:
    software = {"name": "none", "version": "1"}
    return {
        "spec_version": "0.1",
        "dataset_id": "invented",
        "dataset_version": "1.0.0",
        "title": "Invented",
        "licence": "CC-BY-4.0",
        "simulator": software,
        "collector": software,
        "streams": ["ego_route_state", "controls", "route_result"],
        "layers": layers,
        "action_bank": load_action_bank().model_dump(mode="json", exclude_none=True),
        "collection": {"seed": 1},
    }


@pytest.mark.parametrize("layers", ORDERS, ids=" ".join)
def test_layers_in_order_are_accepted(layers: list[str]) -> None:
    assert schema_mismatches(described(layers), "descriptor.schema.json") == []
    descriptor = Descriptor.model_validate(described(layers))
    assert descriptor.layers == tuple(layers)
    assert descriptor.has_raw == (layers[0] == "raw")
    assert descriptor.derived_layers == tuple(layer for layer in layers if layer in LAYERS)


@each("layers", GAPS, ids=lambda layers: " ".join(layers) or "none")
def test_layers_out_of_order_are_refused(layers: list[str]) -> None:
    found = schema_mismatches(described(layers), "descriptor.schema.json")
    assert pointers(found) == ["/layers"]
    with pytest.raises(ValidationError):
        Descriptor.model_validate(described(layers))


def test_names_of_tables_are_unique() -> None:
    names = [*TABLES, *(name for layer in LAYERS.values() for name in layer.tables)]
    assert len(set(names)) == len(names)
    assert set(names) == {*TABLES, *LAYER_TABLES}


def test_patterns_have_one_meaning() -> None:
    raw, layers = (load_resource(name)["patterns"] for name in ("columns.json", "layers.json"))
    assert not raw.keys() & layers.keys()
    assert {**raw, **layers} == PATTERNS


@each_table
def test_table_has_unique_columns_and_a_key_that_is_never_null(table: Table) -> None:
    names = [column.name for column in table.columns]
    assert len(set(names)) == len(names)
    assert set(table.key) <= set(names)
    assert not any(table[name].nullable for name in table.key)


@each_column
def test_mask_is_a_column_of_flags_of_the_same_table(table: Table, column: Column) -> None:
    if column.available is not None and column.available.when == "recorded":
        assert column.available.column in RECORDABLE
    elif column.available is not None:
        assert column.available.mask is not None
        mask = table[column.available.mask]
        assert mask.type == "bool"
        assert not mask.nullable


@each_column
def test_column_bounds_what_it_holds(table: Table, column: Column) -> None:
    assert column.pattern is None or column.pattern in PATTERNS
    if column.type == "string":
        assert column.pattern or column.values
    if column.min is not None and column.max is not None:
        assert column.min < column.max
    for bound in (column.min, column.max):
        if bound is not None and column.type.startswith("int"):
            assert bound == int(bound)
            assert np.iinfo(column.type).min <= bound <= np.iinfo(column.type).max


@each_column
def test_column_carries_its_unit_in_its_name(table: Table, column: Column) -> None:
    if column.unit:
        assert column.name.endswith(UNIT_SUFFIXES[column.unit])


@each_table
def test_arrow_schema_has_the_declared_columns(table: Table) -> None:
    schema = table_schema(table.name)
    assert schema.names == [column.name for column in table.columns]
    for column in table.columns:
        field = schema.field(column.name)
        assert field.nullable == column.nullable
        assert field.metadata[b"track"].decode() == column.track
        assert pa.types.is_list(field.type) == column.type.startswith("list<")
    assert declared_table(table.name) is table


@each_table
def test_path_of_a_table_lies_in_the_folder_of_its_layer(table: Table) -> None:
    layer = layer_of_table(table.name)
    stems = [f"{table.name}-{partition}" for partition in table.partitions] or [table.name]
    parts = ["-00000", "-00012"] if {"group_id", "rollout_id"} & {*table.key} else [""]
    names = [f"{stem}{part}.parquet" for stem in stems for part in parts]
    paths = table_paths(table.name, [f"{layer}/{name}" for name in reversed(names)] + ["model/features.json"])
    assert [PurePosixPath(path).parts for path in paths] == [(layer, name) for name in names]
    assert LAYERS[layer].own(["README.md", *paths]) == paths
    for path in paths:
        file = table_file(path)
        assert file is not None
        assert file.table == table.name
        assert table_path(table.name, file.partition, file.part or 0) == path
        assert fnmatchcase(path, table_pattern(table.name, file.partition))
        assert fnmatchcase(path, table_pattern(table.name)) or file.part is None


def test_an_optional_table_is_missing_only_where_it_is_begun() -> None:
    layer = LAYERS["model"]
    assert layer.tables["endings"].optional
    assert not any("endings" in path for path in layer.missing(()))
    assert layer.num_required([table_path("endings", "val")]) == layer.num_required(()) + 4
    rest = {table_path("endings", partition) for partition in ("train", "test", "calibration")}
    assert {*layer.missing([table_path("endings", "val", 3)])} == {*layer.missing(()), *rest}


@each_table
def test_a_table_or_partition_without_a_file_lacks_its_first_part(table: Table) -> None:
    layer = LAYERS[layer_of_table(table.name)]
    first = [table_path(table.name, partition) for partition in table.partitions or (None,)]
    every = {*layer.missing(()), *first}
    assert len(every) == layer.num_required(first)
    assert layer.missing([path for path in every if path != first[-1]]) == (first[-1],)
    assert table.optional or {*first} <= {*layer.missing(())}
    if table.is_of_groups:
        other = table_path(table.name, *(table.partitions or (None,))[-1:], 7)
        assert layer.missing([*(path for path in every if path != first[-1]), other]) == ()


@pytest.mark.parametrize(
    "path",
    [
        "canonical/records.parquet", "canonical/records-0.parquet", "canonical/records-000001.parquet",
        "canonical/records-00000-00000.parquet", "canonical/records-train-00000.parquet",
        "quality/records-00000.parquet",
        "model/scalars-train.parquet", "model/scalars-00000.parquet", "model/scalars-other-00000.parquet",
        "model/actions-00000.parquet", "model/actions", "raw/shard-00000/rollouts.parquet", "records-00000.parquet",
    ],
)  # fmt: skip
def test_other_names_are_of_no_table(path: str) -> None:
    assert table_file(path) is None
    assert not any(layer.admits(path) for layer in LAYERS.values())


def test_groups_of_shards_in_a_row_share_a_part() -> None:
    assert [part_of(f"raw/{shard_name(index)}") for index in (0, 63, 64, 127, 128)] == [0, 0, 1, 1, 2]
    assert table_file(table_path("records", part=part_of_shard(MAX_SHARD_INDEX))) is not None
    with pytest.raises(ValueError, match="no folder of a shard"):
        part_of("raw/media")


@each_table
def test_tables_of_the_model_layer_are_divided_by_partition_where_they_name_groups(table: Table) -> None:
    is_divided = layer_of_table(table.name) == "model" and table.key[0] == "group_id"
    assert table.partitions == (table["partition"].values if is_divided else ())


@pytest.mark.parametrize("name", ["rollouts", "no_such_table"])
def test_table_of_no_layer_is_a_key_error(name: str) -> None:
    with pytest.raises(KeyError):
        layer_of_table(name)
    with pytest.raises(KeyError):
        table_path(name)


@pytest.mark.parametrize("layer", LAYERS.values(), ids=LAYERS)
def test_documents_have_schemas_whose_description_names_a_clause(layer: Any) -> None:
    for document in layer.documents.values():
        assert (schema_dir() / document.schema).is_file()
        assert layer.admits(f"{layer.name}/{document.name}")
        assert (f"{layer.name}/{document.name}" in layer.missing(())) != document.optional


OWN_SCHEMAS = ("source", "split", "thresholds", "retention", "population", "variants", "ledger", "features",
               "normalisation", "layers", "protocol", "lock", "results")  # fmt: skip


@each("stem", OWN_SCHEMAS)
def test_clause_of_a_description_exists(stem: str) -> None:
    description = load_resource(f"{stem}.schema.json")["description"]
    chapter, anchor = description.split("(", 1)[1].split(")", 1)[0].split("#")
    assert anchor in anchors(ROOT / chapter)


def test_inputs_and_outcomes_have_the_track_that_the_contracts_rely_on() -> None:
    tracks = {
        name: {column.track for column in LAYER_TABLES[name].value_columns}
        for name in ("state", "past_controls", "expert", "surroundings", "objects", "scalars", "trajectories")
    }
    assert tracks == {
        "state": {"sensor"},
        "past_controls": {"sensor"},
        "expert": {"mixed"},
        "surroundings": {"privileged"},
        "objects": {"objects"},
        "scalars": {"evaluation"},
        "trajectories": {"evaluation"},
    }


@each(
    ("path", "has_place"),
    [
        ("benchmark/checkpoints/M3-seed11.safetensors", True),
        ("benchmark/figures/policy_value.png", True),
        ("benchmark/figures/policy_value.svg", True),
        ("benchmark/TABLES.md", True),
        ("benchmark/checkpoints/M3-seed11.pt", False),
        ("benchmark/checkpoints/.hidden.safetensors", False),
        ("benchmark/checkpoints/deeper/M3.safetensors", False),
        ("benchmark/figures/TABLES.md", False),
        ("benchmark/TABLES.md\n", False),
        ("model/TABLES.md", False),
        ("TABLES.md", False),
    ],
)
def test_further_files_of_the_benchmark_have_a_place(path: str, has_place: bool) -> None:
    assert LAYERS["benchmark"].admits_free(path) == has_place
    assert not any(layer.admits_free(path) for name, layer in LAYERS.items() if name != "benchmark")


def test_folders_of_further_files_have_a_place() -> None:
    layer = LAYERS["benchmark"]
    names = ("checkpoints", "figures", "check", "other")
    assert [name for name in names if layer.holds_folder(f"benchmark/{name}")] == ["checkpoints", "figures"]
    assert not layer.holds_folder("benchmark")
