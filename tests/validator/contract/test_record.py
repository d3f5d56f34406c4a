"""Generated rows: the rollouts record, control logs and masked values keep what the contract declares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.mismatch import pointers

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.policy import ACTUATORS, Command
from branchdrive.testing import strategies
from branchdrive.testing.strategies import ControlLog

ROLLOUT_SCHEMA = "rollout.schema.json"
CONDITIONAL = [
    c for c in TABLES["rollouts"].columns if c.available and c.available.when not in ("optional", "recorded")
]
NEVER_NULL = [column for column in TABLES["rollouts"].columns if not column.nullable]


@given(strategies.rollout_records())
def test_rollout_meets_its_record_schema_and_its_table(record: dict[str, Any]) -> None:
    assert schema_mismatches(record, ROLLOUT_SCHEMA) == []
    table = pa.Table.from_pylist([record], schema=table_schema("rollouts"))
    table.validate(full=True)
    assert table.to_pylist() == [record]


@given(strategies.rollout_records(strategies.banks()))
def test_rollout_of_any_bank_executes_its_policy(record: dict[str, Any]) -> None:
    assert schema_mismatches(record, ROLLOUT_SCHEMA) == []
    assert (record["effective_duration_ticks"] == 0) == (record["role"] != "intervention")


@settings(max_examples=settings.default.max_examples // 6)
@given(strategies.rollout_records())
def test_record_schema_refuses_null_where_the_table_does(record: dict[str, Any]) -> None:
    for column in NEVER_NULL:
        assert f"/{column.name}" in pointers(schema_mismatches({**record, column.name: None}, ROLLOUT_SCHEMA))


@settings(max_examples=settings.default.max_examples // 3)
@given(strategies.rollout_records(), st.data())
def test_record_schema_refuses_a_value_at_the_wrong_time(record: dict[str, Any], data: st.DataObject) -> None:
    for column in CONDITIONAL:
        is_null = record[column.name] is None
        other = data.draw(strategies.column_values(column)) if is_null else None
        assert schema_mismatches({**record, column.name: other}, ROLLOUT_SCHEMA), column.name


@given(strategies.control_logs())
def test_control_log_keeps_the_active_window(log: ControlLog) -> None:
    columns = log.columns
    assert list(columns) == [column.name for column in TABLES["controls"].columns]
    assert columns["tick"].tolist() == list(range(log.num_ticks))
    active_ticks = columns["tick"][columns["active"]].tolist()
    assert active_ticks == list(range(log.branch_tick, log.branch_tick + log.policy.duration_ticks))
    assert np.array_equal(columns["source"] == "intervention", columns["active"])
    assert log.num_ticks > log.branch_tick + log.policy.duration_ticks


@given(strategies.control_logs())
def test_control_log_fits_its_table(log: ControlLog) -> None:
    schema = table_schema("controls")
    arrays = [pa.array(log.columns[field.name], field.type, from_pandas=False) for field in schema]
    table = pa.Table.from_arrays(arrays, schema=schema)
    table.validate(full=True)
    for column in TABLES["controls"].columns:
        stored = table[column.name]
        assert stored.null_count == (int(np.sum(~log.columns["active"])) if column.nullable else 0)
        values = [value for value in stored.to_pylist() if value is not None]
        if column.type == "float32":
            assert all(column.min <= value <= column.max for value in values)


@given(strategies.control_logs())
def test_control_log_follows_the_algebra_tick_by_tick(log: ControlLog) -> None:
    def at(tick: int, what: str) -> Command:
        return Command(*(log.columns[f"{what}_{actuator}"][tick] for actuator in ACTUATORS))

    for tick in (0, log.branch_tick - 1, log.branch_tick, log.num_ticks - 1):
        if log.columns["active"][tick]:
            commanded = log.policy.command(at(tick, "expert"), at(tick, "nominal"))
            assert at(tick, "intended") == commanded
            assert at(tick, "applied") == commanded
        else:
            assert at(tick, "applied") == at(tick, "expert")


@given(strategies.control_logs(strategies.policies()))
def test_control_log_of_any_policy_can_be_drawn(log: ControlLog) -> None:
    assert int(log.columns["active"].sum()) == log.policy.duration_ticks


@given(strategies.masked_values())
def test_masked_value_meets_its_schema(document: dict[str, Any]) -> None:
    assert schema_mismatches(document, "mask.schema.json") == []
    assert schema_mismatches({**document, "mask": 1 - document["mask"]}, "mask.schema.json")
    assert schema_mismatches({**document, "mask": bool(document["mask"])}, "mask.schema.json")


@given(st.integers(0, 8).flatmap(lambda n: st.tuples(st.just(n), strategies.masks(n))))
def test_mask_has_a_bit_per_row(drawn: tuple[int, Any]) -> None:
    num_rows, mask = drawn
    assert mask.dtype == np.bool_
    assert mask.shape == (num_rows,)
