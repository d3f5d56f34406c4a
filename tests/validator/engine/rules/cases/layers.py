"""Defects and limits of the files of derived layers: presence, columns, metadata and documents."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
from tests.validator.engine.datasets import parquet_bytes
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.files_tables import other_settings
from tests.validator.engine.rules.release import BUILT, LEAKAGE, LEDGER, POPULATION, SPLIT, VARIANTS, ReleaseDraft

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import table_path
from branchdrive.formats.untrusted_parquet import decode_table

STATE = "model/state-train-00000.parquet"
GROUPS = "quality/group_quality-00000.parquet"


def rewrite(d: ReleaseDraft, path: str, change: Callable[[bytes], bytes]) -> None:
    """Change the bytes of a file before the dataset is sealed."""

    def edit(root: Path) -> None:
        (root / path).write_bytes(change((root / path).read_bytes()))

    d.before_seal(edit)


def _with_metadata(rows: pa.Table, column: str, **changes: str) -> pa.Table:
    field = rows.schema.field(column)
    metadata = {**(field.metadata or {}), **{key.encode(): value.encode() for key, value in changes.items()}}
    return rows.set_column(rows.schema.get_field_index(column), field.with_metadata(metadata), rows[column])


# BD-LYR-001


@mutant("BD-LYR-001", at={"file": LEDGER})
def ledger_missing(d: ReleaseDraft) -> None:
    d.before_seal(lambda root: (root / LEDGER).unlink())


@mutant("BD-LYR-001", at={"file": STATE}, findings=4)
def table_missing(d: ReleaseDraft) -> None:
    del d.tables["model"]["state"]


@boundary(
    "BD-LYR-001", "BD-LYR-002", "BD-LYR-003", "BD-LYR-005", "BD-LYR-006", "BD-LYR-007", "BD-LYR-008", "BD-LYR-009"
)
def release_without_an_audit_of_leakage(d: ReleaseDraft) -> None:
    del d.documents[LEAKAGE]
    d.reseal("card")


@boundary("BD-LYR-001", "BD-QUA-013")
def release_that_ends_with_the_quality_layer(d: ReleaseDraft) -> None:
    d.descriptor["layers"] = ["raw", "canonical", "quality"]
    del d.tables["model"]
    d.documents = {path: document for path, document in d.documents.items() if not path.startswith("model/")}
    d.reseal("card")


# BD-LYR-002


@mutant("BD-LYR-002", at={"file": STATE})
def derived_table_truncated(d: ReleaseDraft) -> None:
    rewrite(d, STATE, lambda content: content[: len(content) // 2])


@mutant("BD-LYR-002", at={"file": GROUPS})
def derived_table_is_no_parquet(d: ReleaseDraft) -> None:
    rewrite(d, GROUPS, lambda _: b"group_id,partition\n" * 100)


@mutant("BD-LYR-002", at={"file": GROUPS})
def derived_page_overwritten(d: ReleaseDraft) -> None:
    rewrite(d, GROUPS, lambda content: content[:4] + bytes(200) + content[204:])


@boundary("BD-LYR-002", "BD-LYR-003", "BD-LYR-004")
def derived_tables_inother_settings(d: ReleaseDraft) -> None:
    for layer in BUILT:
        for name in d.tables[layer]:
            for partition in LAYER_TABLES[name].partitions or (None,):
                path = table_path(name, partition)
                rewrite(d, path, other_settings)


# BD-LYR-003


@mutant("BD-LYR-003", at={"file": STATE, "column": "separation_m"}, findings=4)
def privileged_column_among_sensor_histories(d: ReleaseDraft) -> None:
    def widen(rows: pa.Table) -> pa.Table:
        seen = d.tables["model"]["surroundings"]
        assert rows["group_id"].equals(seen["group_id"])
        assert rows["offset_ticks"].equals(seen["offset_ticks"])
        return rows.append_column(seen.schema.field("separation_m"), seen["separation_m"])

    d.map_table("state", widen, folder="model")


@mutant("BD-LYR-003", at={"file": GROUPS, "column": "near_duplicate"})
def derived_column_missing(d: ReleaseDraft) -> None:
    d.map_table("group_quality", lambda rows: rows.drop_columns("near_duplicate"), folder="quality")


@mutant("BD-LYR-003", at={"file": "model/past_controls-test-00000.parquet", "column": "steer"}, findings=4)
def derived_column_of_another_type(d: ReleaseDraft) -> None:
    def widen(rows: pa.Table) -> pa.Table:
        place = rows.schema.get_field_index("steer")
        return rows.set_column(
            place, rows.schema.field(place).with_type(pa.float64()), rows["steer"].cast(pa.float64())
        )

    d.map_table("past_controls", widen, folder="model")


@boundary("BD-LYR-003", "BD-LYR-004", "BD-LYR-006", "BD-LYR-009")
def derived_columns_in_reverse_order(d: ReleaseDraft) -> None:
    for layer in BUILT:
        for name in d.tables[layer]:
            d.map_table(name, lambda rows: rows.select(rows.column_names[::-1]), folder=layer)


@boundary("BD-LYR-003", "BD-LYR-009")
def columns_of_one_partition_in_reverse_order(d: ReleaseDraft) -> None:
    def reverse(content: bytes) -> bytes:
        rows = decode_table(content, "surroundings")
        return parquet_bytes(rows.select(rows.column_names[::-1]))

    rewrite(d, "model/surroundings-calibration-00000.parquet", reverse)


@boundary("BD-LYR-003", "BD-LYR-006", "BD-LYR-007", "BD-LYR-008", "BD-LYR-009")
def derived_text_as_dictionary(d: ReleaseDraft) -> None:
    def encode(rows: pa.Table) -> pa.Table:
        for place, field in enumerate(rows.schema):
            if pa.types.is_string(field.type):
                values = rows[field.name].dictionary_encode()
                rows = rows.set_column(place, field.with_type(values.type), values)
        return rows

    for layer in BUILT:
        for name in d.tables[layer]:
            d.map_table(name, encode, folder=layer)


# BD-LYR-004


@mutant("BD-LYR-004", at={"file": STATE, "column": "speed_mps"}, findings=4)
def derived_unit_in_other_words(d: ReleaseDraft) -> None:
    d.map_table("state", lambda rows: _with_metadata(rows, "speed_mps", unit="km/h"), folder="model")


@mutant("BD-LYR-004", at={"file": "model/surroundings-val-00000.parquet", "column": "separation_m"}, findings=4)
def privileged_column_called_a_sensor(d: ReleaseDraft) -> None:
    d.map_table("surroundings", lambda rows: _with_metadata(rows, "separation_m", track="sensor"), folder="model")


@mutant("BD-LYR-004", at={"file": STATE, "column": "speed_mps"}, findings=4)
def outcomes_in_the_metadata_of_a_column(d: ReleaseDraft) -> None:
    d.map_table("state", lambda rows: _with_metadata(rows, "speed_mps", note="12.5 11.0 3.4"), folder="model")


@mutant("BD-LYR-004", at={"file": STATE}, findings=4)
def outcomes_in_the_metadata_of_a_file(d: ReleaseDraft) -> None:
    d.map_table("state", lambda rows: rows.replace_schema_metadata({"outcomes": "12.5 11.0 3.4"}), folder="model")


# BD-LYR-005


@mutant("BD-LYR-005", at={"file": SPLIT, "pointer": "/"})
def document_with_a_further_property(d: ReleaseDraft) -> None:
    d.documents[SPLIT]["drawn_on"] = "2026-01-01"


@mutant("BD-LYR-005", at={"file": POPULATION})
def document_with_nan(d: ReleaseDraft) -> None:
    rewrite(d, POPULATION, lambda content: content.replace(b'"num_policies": 13', b'"num_policies": NaN'))


@mutant("BD-LYR-005", at={"file": VARIANTS})
def document_cut_off(d: ReleaseDraft) -> None:
    rewrite(d, VARIANTS, lambda content: content[: len(content) // 2])


@mutant("BD-LYR-005", at={"file": "quality/ledger.json"})
def key_of_a_document_twice(d: ReleaseDraft) -> None:
    rewrite(d, LEDGER, lambda content: content.replace(b'"entries"', b'"entries": [],\n  "entries"', 1))


@mutant("BD-LYR-005", at={"file": "canonical/source.json", "pointer": "/num_groups"})
def count_below_zero(d: ReleaseDraft) -> None:
    d.documents["canonical/source.json"]["num_groups"] = -21


@boundary("BD-LYR-005")
def documents_in_other_layout(d: ReleaseDraft) -> None:
    for path in (POPULATION, VARIANTS, SPLIT):
        rewrite(d, path, lambda content: json.dumps(dict(reversed(json.loads(content).items()))).encode())
