from __future__ import annotations

import pickle
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from tests.validator.writer.invented import make_descriptor, write_rollout

from branchdrive.contract.columns import RECORDABLE, TABLES
from branchdrive.errors import ContractError
from branchdrive.raw.rollout import Rollout, canonical_key
from branchdrive.writer.buffer import RowBuffer
from branchdrive.writer.writer import DatasetWriter


@pytest.fixture(scope="module")
def rollout(tmp_path_factory: pytest.TempPathFactory) -> Rollout:
    """An intervention whose policy is active at its last ticks."""
    root = tmp_path_factory.mktemp("dataset")
    with DatasetWriter(root, make_descriptor()) as writer, writer.begin_group("g") as group:
        return write_rollout(group, "intervention", "brake_0.50", num_ticks=100)


@pytest.mark.parametrize(
    ("table", "column", "dtype"),
    [
        ("controls", "tick", np.int32),
        ("controls", "active", np.bool_),
        ("controls", "applied_steer", np.float32),
        ("observations", "x_m", np.float64),
        ("observations", "command", object),
    ],
)
def test_a_column_that_is_never_null_is_a_plain_array(rollout: Rollout, table: str, column: str, dtype: type) -> None:
    values = rollout.column(table, column)
    assert type(values) is np.ndarray
    assert values.dtype == dtype
    assert values.tolist() == rollout.tables[table].column(column).to_pylist()


@pytest.mark.parametrize(
    ("table", "column", "dtype"),
    [
        ("controls", "intended_brake", np.float32),
        ("evidence", "separation_m", np.float64),
        ("evidence", "separation_actor_id", np.int32),
        ("evidence", "traffic_light", object),
    ],
)
def test_a_column_that_may_be_null_is_masked_exactly_at_nulls(
    rollout: Rollout, table: str, column: str, dtype: type
) -> None:
    values = rollout.column(table, column)
    assert isinstance(values, np.ma.MaskedArray)
    assert values.dtype == dtype
    assert values.tolist() == rollout.tables[table].column(column).to_pylist()
    assert 0 < values.count() < values.size


def test_a_real_number_that_lost_its_mask_is_no_number(rollout: Rollout) -> None:
    for table, column in (("controls", "intended_brake"), ("evidence", "separation_m")):
        values = rollout.column(table, column)
        assert (np.isnan(np.asarray(values)) == np.ma.getmaskarray(values)).all()


def test_a_world_that_offers_a_column_must_give_it() -> None:
    rows = {"tick": 0, "actor_id": 1, "actor_class": "vehicle"}
    for name in ("x_m", "y_m", "yaw_rad", "length_m", "width_m", "vel_x_mps", "vel_y_mps"):
        rows[name] = 1.0
    with pytest.raises(ContractError, match=r"missing columns \['height_m'\].*`unrecorded`"):
        RowBuffer(TABLES["actors"], ()).append(rows)
    flat = RowBuffer(TABLES["actors"], RECORDABLE)
    flat.append(rows)
    assert flat.to_table("r")["height_m"].to_pylist() == [None]


def test_a_column_of_no_world_is_masked_throughout(tmp_path: Path) -> None:
    descriptor = make_descriptor()
    bare = descriptor.model_copy(update={"unrecorded": RECORDABLE})
    with DatasetWriter(tmp_path, bare) as writer, writer.begin_group("g") as group:
        found = write_rollout(group, "nominal", "nominal", without=RECORDABLE, num_ticks=60)
    assert found.record["ego_height_m"] is None
    for table, column in (("observations", "speed_limit_mps"), ("actors", "height_m")):
        assert np.isnan(np.asarray(found.column(table, column))).all()
    for column in ("command", "vehicle_hazard"):
        assert np.ma.getmaskarray(found.column("observations", column)).all()


def test_a_rollout_shows_identity_and_shapes(rollout: Rollout) -> None:
    assert repr(rollout) == (
        "Rollout('g.brake_0.50.v1.a1', intervention 'brake_0.50', attempt 1, complete, "
        "RolloutTables(controls [100, 16], observations [20, 22], actors [19, 12], evidence [20, 19]))"
    )


def test_a_rollout_travels_between_processes(rollout: Rollout) -> None:
    assert pickle.loads(pickle.dumps(rollout)) == rollout


def test_rollouts_are_ordered_by_role_bank_and_attempt() -> None:
    ordered = [
        ("nominal", "nominal", "v1", 1),
        ("nominal", "nominal", "v1", 2),
        ("intervention", "accelerate_0.30", "v1", 1),
        ("intervention", "brake_0.30", "v1", 1),
        ("intervention", "brake_0.30", "v1", 2),
        ("intervention", "brake_0.30", "v2", 1),
        ("intervention", "unknown", "v1", 1),
        ("nominal_replay", "nominal", "v1", 1),
    ]
    names = ("role", "action_key", "protocol_variant", "attempt")
    records = [dict(zip(names, values, strict=True)) | {"rollout_id": str(i)} for i, values in enumerate(ordered)]
    for shuffled in list(permutations(records))[::997]:
        assert sorted(shuffled, key=lambda record: canonical_key(record, make_descriptor())) == records
