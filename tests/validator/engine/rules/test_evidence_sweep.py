"""Evidence spoiled at random places: exactly the spoiled rows are found, and nothing that is within tolerance."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests import synthetic
from tests.each import each

from branchdrive.contract.descriptor import Descriptor
from branchdrive.driving.risk import risk_evidence
from branchdrive.engine.examine import examine
from branchdrive.raw.shard_view import ShardView

DESCRIPTOR = Descriptor.model_validate(synthetic.descriptor())
SHARD, QUIET_SHARD = synthetic.SHARDS
TOLERANCE = 1e-6

VALUES = {
    "separation_m": "BD-EVD-001",
    "ttc_s": "BD-EVD-002",
    "nearest_vehicle_gap_m": "BD-EVD-003",
    "nearest_vehicle_rel_speed_mps": "BD-EVD-003",
    "nearest_pedestrian_gap_m": "BD-EVD-003",
}
MASKED = {
    "separation": ("BD-EVD-001", ("separation_m", "separation_actor_id")),
    "ttc": ("BD-EVD-002", ("ttc_s", "ttc_actor_id")),
    "nearest_vehicle": ("BD-EVD-003", ("nearest_vehicle_gap_m", "nearest_vehicle_rel_speed_mps")),
    "nearest_pedestrian": ("BD-EVD-003", ("nearest_pedestrian_gap_m",)),
}


@cache
def evidence(shard: str = SHARD) -> pa.Table:
    """Evidence of the base to the last bit, which is recorded on a grid."""
    tables = synthetic.base_tables()[shard]
    parts = []
    for attempt in tables["rollouts"].to_pylist():
        own = {
            name: tables[name].filter(pc.equal(tables[name]["rollout_id"], attempt["rollout_id"]))
            for name in ("observations", "actors", "evidence")
        }
        exact = risk_evidence(
            *({c: own[name][c].to_numpy() for c in own[name].column_names} for name in ("observations", "actors")),
            ego_length_m=attempt["ego_length_m"], ego_width_m=attempt["ego_width_m"],
            route_x_m=np.array(attempt["route_x_m"]), route_y_m=np.array(attempt["route_y_m"]),
        )  # fmt: skip
        rows = own["evidence"]
        for name in VALUES:
            field = rows.schema.field(name)
            values = pa.array(np.ma.getdata(exact[name]) + 0.0, field.type, mask=np.ma.getmaskarray(exact[name]))
            rows = rows.set_column(rows.schema.get_field_index(name), field, values)
        parts.append(rows)
    return pa.concat_tables(parts)


def with_cells(changes: dict[str, dict[int, Any]], shard: str = SHARD) -> pa.Table:
    rows = evidence(shard)
    for column, cells in changes.items():
        values = rows[column].to_pylist()
        for row, value in cells.items():
            values[row] = value
        rows = rows.set_column(
            rows.schema.get_field_index(column),
            rows.schema.field(column),
            pa.array(values, rows.schema.field(column).type),
        )
    return rows


def found(rows: pa.Table, shard: str = SHARD) -> dict[str, dict[str, int]]:
    """Violating rows per rollout, by evidence rule."""
    tables = {**synthetic.base_tables()[shard], "evidence": rows}
    tallies, _ = examine(ShardView(tables, DESCRIPTOR))
    assert not [message for tally in tallies.values() for message in tally.errors]
    return {
        rule_id: {str(f.location["rollout_id"]): f.count for f in tally.findings}
        for rule_id, tally in tallies.items()
        if tally.num_findings
    }


def counted(places: np.ndarray[Any, Any], shard: str = SHARD) -> dict[str, int]:
    ids, counts = np.unique([evidence(shard)["rollout_id"][int(row)].as_py() for row in places], return_counts=True)
    return {str(rollout_id): int(count) for rollout_id, count in zip(ids, counts, strict=True)}


@each("seed", [11, 23, 37])
@each("sign", [1, -1])
@each("column", VALUES)
def test_values_just_outside_the_tolerance(column: str, sign: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = evidence()[column].to_pylist()
    # Room on both sides: no value falls below 0, and none reaches another actor's.
    usable = [row for row, value in enumerate(values) if value is not None and abs(value) > 0.01]
    places = rng.choice(usable, 60, replace=False)
    inside, outside = places[:30], places[30:]
    step = {int(row): sign * TOLERANCE * (1 + abs(values[row])) for row in places}
    changed = {int(row): values[row] + 0.98 * step[int(row)] for row in inside}
    assert found(with_cells({column: changed})) == {}
    changed |= {int(row): values[row] + 1.02 * step[int(row)] for row in outside}
    assert found(with_cells({column: changed})) == {VALUES[column]: counted(outside)}


@each("seed", [11, 23])
@each("name", MASKED)
def test_masks_switched_off(name: str, seed: int) -> None:
    rule, columns = MASKED[name]
    masks = evidence()[f"{name}_available"].to_pylist()
    on = np.random.default_rng(seed).choice(np.flatnonzero(masks), 40, replace=False)
    changes: dict[str, dict[int, Any]] = {f"{name}_available": dict.fromkeys(map(int, on), False)}
    changes |= {column: dict.fromkeys(map(int, on), None) for column in columns}
    assert found(with_cells(changes)) == {rule: counted(on)}


@each("value", [0.0, 1e-9, 7.0, 49.0])
@each("name", MASKED)
def test_masks_switched_on(name: str, value: float) -> None:
    rule, columns = MASKED[name]
    masks = np.array(evidence(QUIET_SHARD)[f"{name}_available"].to_pylist())
    off = np.random.default_rng(5).choice(np.flatnonzero(~masks), 20, replace=False)
    changes: dict[str, dict[int, Any]] = {f"{name}_available": dict.fromkeys(map(int, off), True)}
    for column in columns:
        changes[column] = dict.fromkeys(map(int, off), 1 if column.endswith("_id") else value)
    assert found(with_cells(changes, QUIET_SHARD), QUIET_SHARD) == {rule: counted(off, QUIET_SHARD)}


@pytest.mark.parametrize("name", ["separation", "ttc"])
def test_every_other_actor_of_a_frame(name: str) -> None:
    """Naming any actor but that of the minimum is found, in every frame of a rollout."""
    column = f"{name}_actor_id"
    own = evidence()[column].to_pylist()
    rows = [row for row, actor_id in enumerate(own) if actor_id is not None][:60]
    for shift in range(1, 7):
        changed = {row: (own[row] - 1 + shift) % 7 + 1 for row in rows}
        assert found(with_cells({column: changed})) == {MASKED[name][0]: counted(np.array(rows))}


@pytest.mark.parametrize("tolerance", [0.0, 1e-4, 1e-3])
def test_declared_tolerance_is_the_one_that_counts(tolerance: float) -> None:
    descriptor = Descriptor.model_validate({**synthetic.descriptor(), "tolerances": {"evidence": tolerance}})
    values = evidence()["separation_m"].to_pylist()
    row = next(i for i, value in enumerate(values) if value and value > 5)
    for step, is_sound in ((0.98 * tolerance, True), (1.02 * tolerance + 1e-12, False)):
        changed = values[row] + step * (1 + values[row])
        tables = {**synthetic.base_tables()[SHARD], "evidence": with_cells({"separation_m": {row: changed}})}
        tally = examine(ShardView(tables, descriptor))[0]["BD-EVD-001"]
        assert (tally.num_findings == 0) == is_sound
