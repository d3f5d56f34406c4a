"""Defects and limits of tables as files: decoding, columns, metadata, presence."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from tests.synthetic import descriptor
from tests.validator.engine.rules.case import (
    SHARD_0,
    SHARD_1,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import STREAMS
from branchdrive.testing.media import media_document

CONTROLS = f"{SHARD_1}/controls.parquet"


def _rewrite(d: Draft, path: str, change: Any) -> None:
    def edit(root: Path) -> None:
        (root / path).write_bytes(change((root / path).read_bytes()))

    d.before_seal(edit)


# BD-TAB-001


@mutant("BD-TAB-001", at={"file": CONTROLS})
def truncated_before_sealing(d: Draft) -> None:
    _rewrite(d, CONTROLS, lambda content: content[: len(content) // 2])


@mutant("BD-TAB-001", at={"file": CONTROLS})
def empty(d: Draft) -> None:
    _rewrite(d, CONTROLS, lambda _: b"")


@mutant("BD-TAB-001", at={"file": CONTROLS})
def no_parquet(d: Draft) -> None:
    _rewrite(d, CONTROLS, lambda content: b"rollout_id,tick\n" * 100)


@mutant("BD-TAB-001", at={"file": CONTROLS})
def page_overwritten(d: Draft) -> None:
    _rewrite(d, CONTROLS, lambda content: content[:4] + bytes(200) + content[204:])


@mutant("BD-TAB-001", at={"file": CONTROLS})
def text_that_is_not_utf8(d: Draft) -> None:
    def spoil(rows: pa.Table) -> pa.Table:
        raw = pa.array([b"\xff"] * len(rows), pa.binary())
        broken = pa.StringArray.from_buffers(len(raw), *raw.buffers()[1:])
        return rows.set_column(rows.schema.get_field_index("source"), rows.schema.field("source"), broken)

    d.map_table("controls", spoil, folder=SHARD_1)


def other_settings(content: bytes) -> bytes:
    """The same table in another compression, page format and size of row groups."""
    sink = io.BytesIO()
    table = pq.read_table(io.BytesIO(content))
    pq.write_table(table, sink, compression="gzip", row_group_size=97, write_statistics=False, data_page_version="2.0")
    return sink.getvalue()


@boundary("BD-TAB-001", "BD-TAB-002", "BD-TAB-003", "BD-TAB-007")
def other_compression_encoding_and_row_groups(d: Draft) -> None:
    for name in d.tables[SHARD_1]:
        _rewrite(d, f"{SHARD_1}/{name}.parquet", other_settings)


@boundary("BD-TAB-001", "BD-FRM-001", base="media")
def table_without_rows_in_one_shard(d: Draft) -> None:
    d.descriptor = media_document(descriptor(), "rgb_top_down")
    d.set("frames", "camera", "top_down", camera="front")
    d.drop("frames", camera=list(STREAMS["rgb_surround"].cameras))
    d.map_table("frames", lambda rows: rows.slice(0, 0), folder=SHARD_1)


# BD-TAB-002


@mutant("BD-TAB-002", at={"file": CONTROLS, "column": "applied_brake"})
def column_missing(d: Draft) -> None:
    d.map_table("controls", lambda rows: rows.drop_columns("applied_brake"), folder=SHARD_1)


@mutant("BD-TAB-002", at={"file": CONTROLS, "column": "host"})
def column_undeclared(d: Draft) -> None:
    d.map_table("controls", lambda rows: rows.append_column("host", pa.array(["a"] * len(rows))), folder=SHARD_1)


@mutant("BD-TAB-002", at={"file": CONTROLS, "column": "applied_brake"})
def column_of_another_type(d: Draft) -> None:
    def widen(rows: pa.Table) -> pa.Table:
        place = rows.schema.get_field_index("applied_brake")
        field = rows.schema.field(place).with_type(pa.float64())
        return rows.set_column(place, field, rows["applied_brake"].cast(pa.float64()))

    d.map_table("controls", widen, folder=SHARD_1)


@mutant("BD-TAB-002", at={"file": f"{SHARD_1}/rollouts.parquet", "column": "repetition"})
def numbers_as_dictionary_encoded_text(d: Draft) -> None:
    def encode(rows: pa.Table) -> pa.Table:
        place = rows.schema.get_field_index("repetition")
        values = rows["repetition"].cast(pa.string()).dictionary_encode()
        return rows.set_column(place, rows.schema.field(place).with_type(values.type), values)

    d.map_table("rollouts", encode, folder=SHARD_1)


@boundary("BD-TAB-002")
def columns_in_reverse_order(d: Draft) -> None:
    for folder, shard in d.tables.items():
        for name in shard:
            d.map_table(name, lambda rows: rows.select(rows.column_names[::-1]), folder=folder)


@boundary("BD-TAB-002")
def dictionary_encoded_text(d: Draft) -> None:
    def encode(rows: pa.Table) -> pa.Table:
        for place, field in enumerate(rows.schema):
            if pa.types.is_string(field.type):
                values = rows[field.name].dictionary_encode()
                rows = rows.set_column(place, field.with_type(values.type), values)
        return rows

    for name in d.tables[SHARD_0]:
        d.map_table(name, encode, folder=SHARD_0)


# BD-TAB-003


def _with_metadata(d: Draft, column: str, change: Any) -> None:
    def edit(rows: pa.Table) -> pa.Table:
        place = rows.schema.get_field_index(column)
        field = rows.schema.field(place)
        return rows.set_column(place, field.with_metadata(change(dict(field.metadata))), rows[column])

    d.map_table("observations", edit, folder=SHARD_1)


OBSERVATIONS = f"{SHARD_1}/observations.parquet"


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "x_m"})
def another_unit(d: Draft) -> None:
    _with_metadata(d, "x_m", lambda known: {**known, b"unit": b"cm"})


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "x_m"})
def another_frame(d: Draft) -> None:
    _with_metadata(d, "x_m", lambda known: {**known, b"frame": b"ego"})


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "target_speed_mps"})
def privileged_value_called_sensor(d: Draft) -> None:
    _with_metadata(d, "target_speed_mps", lambda known: {**known, b"track": b"sensor"})


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "vehicle_hazard"})
def unit_where_none_is_declared(d: Draft) -> None:
    _with_metadata(d, "vehicle_hazard", lambda known: {**known, b"unit": b"m"})


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "yaw_rad"}, findings=3)
def metadata_missing(d: Draft) -> None:
    _with_metadata(d, "yaw_rad", lambda _: {})


def _carried_by_the_file(d: Draft, change: Any) -> None:
    """Metadata in a member of the file's own, as programs write them that have no Arrow schema."""

    def edit(content: bytes) -> bytes:
        table = pq.read_table(io.BytesIO(content))
        document = {
            field.name: {key.decode(): text.decode() for key, text in field.metadata.items()} for field in table.schema
        }
        plain = table.cast(pa.schema([field.remove_metadata() for field in table.schema]))
        sink = io.BytesIO()
        with pq.ParquetWriter(sink, plain.schema, store_schema=False) as writer:
            writer.write_table(plain)
            writer.add_key_value_metadata({"branchdrive.columns": change(document)})
        return sink.getvalue()

    _rewrite(d, OBSERVATIONS, edit)


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "speed_mps"})
def another_unit_in_the_metadata_of_the_file(d: Draft) -> None:
    _carried_by_the_file(d, lambda known: json.dumps({**known, "speed_mps": {**known["speed_mps"], "unit": "km/h"}}))


@mutant("BD-TAB-003", at={"file": OBSERVATIONS, "column": "yaw_rad"}, findings=3)
def column_that_the_metadata_of_the_file_lacks(d: Draft) -> None:
    _carried_by_the_file(d, lambda known: json.dumps({name: known[name] for name in known if name != "yaw_rad"}))


@mutant("BD-TAB-003", at={"file": OBSERVATIONS})
def metadata_of_the_file_that_is_no_document(d: Draft) -> None:
    _carried_by_the_file(d, lambda _: "metres")


@boundary("BD-TAB-003")
def metadata_carried_by_the_file(d: Draft) -> None:
    _carried_by_the_file(d, json.dumps)


@boundary("BD-TAB-002", "BD-TAB-003")
def no_metadata_at_all(d: Draft) -> None:
    def edit(content: bytes) -> bytes:
        sink = io.BytesIO()
        pq.write_table(pq.read_table(io.BytesIO(content)), sink, store_schema=False)
        return sink.getvalue()

    for name in d.tables[SHARD_1]:
        _rewrite(d, f"{SHARD_1}/{name}.parquet", edit)


@boundary("BD-TAB-003")
def other_description_and_more_metadata(d: Draft) -> None:
    _with_metadata(d, "x_m", lambda known: {**known, b"description": b"other words", b"note": b"\xff"})


# BD-TAB-004


@mutant("BD-TAB-004", at={"file": CONTROLS})
def claimed_table_never_written(d: Draft) -> None:
    d.before_seal(lambda root: (root / CONTROLS).unlink())


@mutant("BD-TAB-004", base="bare", at={"file": f"{SHARD_1}/evidence.parquet"}, findings=4)
def claimed_stream_never_written(d: Draft) -> None:
    d.descriptor["streams"].append("actor_risk_evidence")


@mutant("BD-TAB-004", at={"file": "raw"})
def no_shard(d: Draft) -> None:
    d.tables = {}


@boundary("BD-TAB-004")
def single_shard(d: Draft) -> None:
    del d.tables[SHARD_0]


# BD-TAB-005


def _with_pairs(**metadata: str) -> Any:
    def change(content: bytes) -> bytes:
        sink = io.BytesIO()
        table = pq.read_table(io.BytesIO(content))
        pq.write_table(table.replace_schema_metadata({**(table.schema.metadata or {}), **metadata}), sink)
        return sink.getvalue()

    return change


@mutant("BD-TAB-005", at={"file": CONTROLS})
def metadata_with_a_path(d: Draft) -> None:
    _rewrite(d, CONTROLS, _with_pairs(source="/mnt/cluster/job-3/controls.csv"))


@mutant("BD-TAB-005", at={"file": CONTROLS})
def metadata_with_a_time(d: Draft) -> None:
    _rewrite(d, CONTROLS, _with_pairs(written="2026-03-01 12:30:00"))


@boundary("BD-TAB-005")
def metadata_of_pandas(d: Draft) -> None:
    pandas = '{"index_columns": [], "columns": [], "creator": {"library": "pyarrow", "version": "20.0.0"}}'
    _rewrite(d, CONTROLS, _with_pairs(pandas=pandas))


# BD-TAB-006


def _without_rows(d: Draft, folder: str) -> None:
    for name in d.tables[folder]:
        d.map_table(name, lambda rows: rows.slice(0, 0), folder=folder)


@mutant("BD-TAB-006", at={"table": "rollouts"})
def raw_layer_without_rows(d: Draft) -> None:
    _without_rows(d, SHARD_0)
    _without_rows(d, SHARD_1)


@boundary("BD-TAB-006", "BD-TAB-004")
def shard_without_rows_beside_another(d: Draft) -> None:
    d.tables["raw/shard-00042"] = {name: rows.slice(0, 0) for name, rows in d.tables[SHARD_0].items()}


# Several places: what violates a rule is counted


@mutant("BD-TAB-002", at={"file": f"{SHARD_1}/controls.parquet", "column": "applied_steer"}, findings=2)
def two_columns_missing(d: Draft) -> None:
    d.map_table("controls", lambda rows: rows.drop_columns(["applied_brake", "applied_steer"]), folder=SHARD_1)
