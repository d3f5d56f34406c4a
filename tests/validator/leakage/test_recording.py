"""Recorded columns before the branch: what a number is, and that codes of every kind change one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests import synthetic
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.descriptor import Descriptor
from branchdrive.leakage.recording import recorded_numbers
from branchdrive.leakage.streams import COUNT, DIFFERENT, StreamColumn, Streams, num_different, ranked, stream_columns
from branchdrive.raw.shard_view import ShardView

BRAKE, FOLDER = "g0.brake_0.50.a1", "raw/shard-00000"


def numbers(d: Draft) -> dict[StreamColumn, float]:
    """Numbers of one attempt by column."""
    descriptor = Descriptor.model_validate(d.descriptor)
    view = ShardView(d.tables[FOLDER], descriptor)
    found = recorded_numbers(view, np.array([view.rollout_ids.index(BRAKE)]))
    return dict(zip(stream_columns(descriptor.tables), found[0].tolist(), strict=True))


def draft() -> Draft:
    return Draft(synthetic.base_tables(), synthetic.descriptor())


def changed_by(edit: Callable[[Draft], object]) -> set[StreamColumn]:
    d = draft()
    before = numbers(d)
    edit(d)
    after = numbers(d)
    return {column for column in before if not np.array_equal(before[column], after[column], equal_nan=True)}


def test_every_declared_column_has_a_number_at_every_time() -> None:
    found = numbers(draft())
    assert len(found) == 17 * 20 + 16 * 17 + 16 * 11 + 80 * 14 + 20 + 17 + 11 + 14
    d = draft()
    assert found["observations", "speed_mps", 0] == d.value(
        "observations", "speed_mps", rollout_id=BRAKE, tick=BRANCH_TICK
    )
    rows = d.take("actors", rollout_id=BRAKE, tick=BRANCH_TICK - 5)
    assert found["actors", COUNT, -5] == len(rows)
    assert found["actors", "actor_id", -5] == sum(rows["actor_id"].to_pylist())
    assert found["actors", "x_m", -5] == pytest.approx(sum(rows["x_m"].to_pylist()), abs=1e-4)


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("evidence", "traffic_light", "red"),
        ("evidence", "lane_id", "another lane"),
        ("evidence", "ttc_actor_id", 77),
        ("evidence", "collision", True),
        ("observations", "command", "change_left"),
        ("observations", "yaw_rad", 1.0),
    ],
)
def test_a_code_in_one_moment_changes_one_number(table: str, column: str, value: object) -> None:
    found = changed_by(lambda d: d.set(table, column, value, rollout_id=BRAKE, tick=BRANCH_TICK - 10))
    assert found - {(table, f"{column} {DIFFERENT}", None)} == {(table, column, -10)}


def test_a_value_that_repeats_lowers_the_number_of_different_ones() -> None:
    d = draft()
    for tick in range(BRANCH_TICK - 75, BRANCH_TICK + 5, 5):
        d.set("observations", "accel_lateral_mps2", 0.25 * tick, rollout_id=BRAKE, tick=tick)
    key = ("observations", f"accel_lateral_mps2 {DIFFERENT}", None)
    before = numbers(d)[key]
    for tick in (BRANCH_TICK - 40, BRANCH_TICK - 35):
        d.set("observations", "accel_lateral_mps2", 0.25 * (BRANCH_TICK - 5), rollout_id=BRAKE, tick=tick)
    assert numbers(d)[key] == before - 2


def test_a_null_and_both_zeros_are_two_values() -> None:
    values = np.array([[np.nan, np.nan, 0.0, -0.0], [np.nan, 1.0, 2.0, 1.0]])
    assert num_different(values).tolist() == [2.0, 3.0]


def test_what_follows_the_branch_changes_nothing() -> None:
    def edit(d: Draft) -> None:
        d.set("controls", "expert_steer", 0.5, rollout_id=BRAKE, tick=BRANCH_TICK)
        d.set("evidence", "collision", True, rollout_id=BRAKE, tick=BRANCH_TICK + 5)

    assert changed_by(edit) == set()


@pytest.mark.parametrize("table", ["actors", "evidence", "controls"])
def test_the_order_of_rows_changes_nothing(table: str) -> None:
    assert (
        changed_by(lambda d: d.map_table(table, lambda rows: rows.take(np.arange(len(rows))[::-1]), folder=FOLDER))
        == set()
    )


def test_what_is_not_there_is_below_and_far_from_every_number() -> None:
    ranks, spread = ranked(np.array([[[np.nan], [-5.0], [2.0]], [[np.nan], [np.nan], [np.nan]], [[1.0], [3.0], [1.0]]]))
    assert ranks[..., 0].tolist() == [[-2, 0, 2], [0, 0, 0], [-1, 2, -1]]
    assert spread[:, 0].tolist() == [np.inf, 0.0, 2.0]


def test_shapes_that_do_not_fit_are_refused() -> None:
    column = StreamColumn("evidence", "collision", 0)
    with pytest.raises(ValueError, match="`ranks` has shape"):
        Streams((), np.zeros((2, 3, 1), np.int16), np.zeros((2, 1), np.float32))
    with pytest.raises(ValueError, match="`spread` has shape"):
        Streams((column,), np.zeros((2, 3, 1), np.int16), np.zeros((2, 2), np.float32))
