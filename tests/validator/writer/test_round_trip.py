from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.validator.writer.invented import (
    ATTEMPTS,
    branch_fields,
    control_rows,
    generator,
    identity_fields,
    make_descriptor,
    result_fields,
    write_dataset,
)
from tests.validator.writer.rows import Row, rollout_fields, streams

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.validate import validate
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import Rollout
from branchdrive.writer.rollout_writer import RolloutWriter
from branchdrive.writer.writer import DatasetWriter

APPENDERS = {
    "controls": RolloutWriter.append_ticks,
    "observations": RolloutWriter.append_observations,
    "actors": RolloutWriter.append_actors,
    "evidence": RolloutWriter.append_evidence,
}


def append(rollout: RolloutWriter, table: str, rows: list[Row], form: str) -> None:
    """Append rows one by one as scalars, or all at once as lists or as masked numpy arrays."""
    if form == "scalars":
        for row in rows:
            APPENDERS[table](rollout, **{name: value for name, value in row.items() if value is not None})
        return
    columns: dict[str, Any] = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
    if form == "arrays":
        for column in TABLES[table].columns:
            if column.type != "string" and column.name in columns:
                mask = [value is None for value in columns[column.name]]
                filled = [column.type != "bool" and 0 if value is None else value for value in columns[column.name]]
                columns[column.name] = np.ma.MaskedArray(np.array(filled, dtype=column.type), mask=mask)
    if columns:
        APPENDERS[table](rollout, **columns)


def as_read(value: Any, kind: str) -> Any:
    """What a value should be when it is read back from a column."""
    if kind == "float32" and value is not None:
        return float(np.float32(value))
    return list(map(float, value)) if kind.startswith("list") else value


@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(st.data())
def test_what_is_written_is_read_back(data: st.DataObject) -> None:
    descriptor = make_descriptor()
    with tempfile.TemporaryDirectory() as folder:
        expected: dict[str, tuple[Rollout, Row, dict[str, list[Row]]]] = {}
        with DatasetWriter(folder, descriptor) as writer:
            with writer.begin_group("g") as group:
                for role, action_key in ATTEMPTS:
                    begin, finish = data.draw(rollout_fields(role, action_key, "g.nominal.v1.a1"))
                    tables = data.draw(streams())
                    rollout = group.begin_rollout(**begin)
                    for table, rows in tables.items():
                        append(rollout, table, rows, data.draw(st.sampled_from(["scalars", "lists", "arrays"])))
                    expected[rollout.rollout_id] = rollout.finish(**finish), begin | finish, tables
            writer.finalize()
        group_read = open_dataset(Path(folder)).group("g")

    assert [rollout.rollout_id for rollout in group_read.rollouts] == list(expected)
    for found in group_read.rollouts:
        written, fields, tables = expected[found.rollout_id]
        assert found == written
        for column in TABLES["rollouts"].columns:
            if column.name in fields:
                assert found.record[column.name] == as_read(fields[column.name], column.type)
        for table, rows in tables.items():
            assert found.tables[table].schema.equals(table_schema(table), check_metadata=True)
            for column in TABLES[table].columns:
                if column.name != "rollout_id":
                    assert found.tables[table].column(column.name).to_pylist() == [
                        as_read(row[column.name], column.type) for row in rows
                    ]


def test_counts_and_identities_are_filled_in(tmp_path: Path) -> None:
    write_dataset(tmp_path, 1)
    records = open_dataset(tmp_path).rollouts().to_pylist()
    expected = ["g0.brake_0.50.v1.a1", "g0.nominal.v1.a1", "g0.nominal_replay.v1.a1"]
    assert [record["rollout_id"] for record in records] == expected
    assert {(record["num_ticks"], record["num_observations"], record["attempt"]) for record in records} == {(12, 3, 1)}


def test_arrays_can_be_reused_after_they_were_appended(tmp_path: Path) -> None:
    columns = control_rows(generator(), 3, np.zeros(3, bool))
    expected = np.concatenate([columns["expert_steer"], columns["expert_steer"] / 2])
    with DatasetWriter(tmp_path, make_descriptor(has_evidence=False)) as writer, writer.begin_group("g") as group:
        rollout = group.begin_rollout(**identity_fields("nominal", "nominal", None))
        rollout.append_ticks(**columns)
        columns["tick"] += 3
        columns["expert_steer"] /= 2
        rollout.append_ticks(**columns)
        finished = rollout.finish(**result_fields(), **branch_fields("g.nominal.v1.a1"))
    assert finished.column("controls", "tick").tolist() == [0, 1, 2, 3, 4, 5]
    assert finished.column("controls", "expert_steer").tolist() == expected.tolist()


def test_what_is_written_is_valid(tmp_path: Path) -> None:
    write_dataset(tmp_path, 2)  # too few attempts for what most of them show
    report = validate(tmp_path)
    assert (report.verdict, [finding for finding in report.findings if CATALOGUE[finding.rule].decides]) == (
        "valid",
        [],
    )


def test_zeros_are_stored_without_a_sign(tmp_path: Path) -> None:
    columns = control_rows(generator(), 3, np.zeros(3, bool))
    columns |= {"expert_steer": np.full(3, -0.0), "expert_brake": [-0.0, 0.0, 0.5]}
    identity = identity_fields("nominal", "nominal", None) | {"route_y_m": [-0.0, -1.0], "route_x_m": [0.0, 1.0]}
    with DatasetWriter(tmp_path, make_descriptor(has_evidence=False)) as writer, writer.begin_group("g") as group:
        rollout = group.begin_rollout(**identity)
        rollout.append_ticks(**columns)
        finished = rollout.finish(**result_fields(), **branch_fields("g.nominal.v1.a1"))
    for name in ("expert_steer", "expert_brake"):
        assert not np.signbit(finished.column("controls", name)).any()
    assert np.signbit(finished.record["route_y_m"]).tolist() == [False, True]


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_rows_are_stored_sorted_and_repeated_ticks_keep_their_order(tmp_path: Path, order: list[int]) -> None:
    columns = control_rows(generator(), 3, np.zeros(3, bool)) | {"tick": np.array([5, 5, 7])}
    with DatasetWriter(tmp_path, make_descriptor(has_evidence=False)) as writer, writer.begin_group("g") as group:
        rollout = group.begin_rollout(**identity_fields("nominal", "nominal", None))
        for i in order:
            rollout.append_ticks(**{name: value[i : i + 1] for name, value in columns.items()})
        finished = rollout.finish(**result_fields(), **branch_fields("g.nominal.v1.a1"))
    in_order = [i for i in order if i < 2] + [2]
    assert finished.column("controls", "expert_steer").tolist() == columns["expert_steer"][in_order].tolist()
