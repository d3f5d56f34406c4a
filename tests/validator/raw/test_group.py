from __future__ import annotations

import numpy as np
import pytest
from tests.validator.writer.invented import BRANCH_TICK, WHOLE_TICKS, make_descriptor, write_group, write_rollout

from branchdrive.contract.document import schema_mismatches
from branchdrive.errors import UsageError
from branchdrive.raw.group import APPLIED_CONTROLS, STATE_COLUMNS, BranchGroup
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import Rollout
from branchdrive.writer.writer import DatasetWriter


@pytest.fixture(scope="module")
def group(tmp_path_factory: pytest.TempPathFactory) -> BranchGroup:
    """A group with two attempts at one intervention, and a replay that ends too early."""
    root = tmp_path_factory.mktemp("dataset")
    with DatasetWriter(root, make_descriptor()) as writer:
        with writer.begin_group("g") as written:
            write_group(written, num_ticks=WHOLE_TICKS)
            write_rollout(written, "intervention", "brake_0.50", num_ticks=WHOLE_TICKS)
            write_rollout(written, "nominal_replay", "nominal", num_ticks=BRANCH_TICK)
            write_rollout(written, "intervention", "accelerate_0.30")
        writer.finalize()
    return open_dataset(root).group("g")


def at_ticks(rollout: Rollout, table: str, columns: tuple[str, ...], ticks: range) -> list[list[float]]:
    """Rows at `ticks` by plain search in Python."""
    rows = {row["tick"]: row for row in rollout.tables[table].to_pylist()}
    return [[rows[tick][name] for name in columns] for tick in ticks]


def test_attempts_are_found_by_role_and_action_key(group: BranchGroup) -> None:
    assert group.nominal.rollout_id == "g.nominal.v1.a1"
    assert list(group.interventions) == ["accelerate_0.30", "brake_0.50"]
    assert [r.rollout_id for r in group.interventions["brake_0.50"]] == ["g.brake_0.50.v1.a1", "g.brake_0.50.v1.a2"]
    assert [r.rollout_id for r in group.replays] == ["g.nominal_replay.v1.a1", "g.nominal_replay.v1.a2"]


def test_windows_hold_the_rows_around_the_branch(group: BranchGroup) -> None:
    rollout = group.interventions["brake_0.50"][0]
    history = group.history_observations(rollout)
    controls = group.control_history(rollout)
    future = group.future_observations(rollout)
    assert [history.shape, controls.shape, future.shape] == [
        (16, len(STATE_COLUMNS)),
        (80, 3),
        (10, len(STATE_COLUMNS)),
    ]
    assert [str(array.dtype) for array in (history, controls, future)] == ["float64", "float32", "float64"]
    t_b = BRANCH_TICK
    assert history.tolist() == at_ticks(rollout, "observations", STATE_COLUMNS, range(t_b - 75, t_b + 1, 5))
    assert controls.tolist() == at_ticks(rollout, "controls", APPLIED_CONTROLS, range(t_b - 80, t_b))
    assert future.tolist() == at_ticks(rollout, "observations", STATE_COLUMNS, range(t_b + 5, t_b + 51, 5))


def test_columns_can_be_chosen(group: BranchGroup) -> None:
    history = group.history_observations(group.nominal, ["tick", "x_m", "vehicle_hazard"])
    assert history[:, 0].tolist() == list(range(BRANCH_TICK - 75, BRANCH_TICK + 1, 5))
    assert set(history[:, 2]) <= {0.0, 1.0}


def test_controls_of_all_ticks_are_masked_where_they_may_be_null(group: BranchGroup) -> None:
    rollout = group.interventions["brake_0.50"][0]
    intended = group.controls(rollout, ["intended_steer", "intended_brake"])
    assert isinstance(intended, np.ma.MaskedArray)
    assert intended.shape == (WHOLE_TICKS, 2)
    assert np.array_equal(~np.ma.getmaskarray(intended)[:, 0], rollout.column("controls", "active"))
    applied = group.controls(rollout)
    assert type(applied) is np.ndarray
    assert applied.shape == (WHOLE_TICKS, 3)


def test_a_rollout_without_a_whole_window_has_no_array(group: BranchGroup) -> None:
    short = group.replays[1]
    assert group.control_history(short).shape == (80, 3)
    with pytest.raises(UsageError, match=r"lacks or repeats observations at ticks \[80\]"):
        group.history_observations(short)
    with pytest.raises(UsageError, match=r"ticks \[85, 90"):
        group.future_observations(short)


def test_text_columns_have_no_place_in_arrays(group: BranchGroup) -> None:
    with pytest.raises(UsageError, match=r"columns \['command'\] of `observations` are not numeric"):
        group.history_observations(group.nominal, ["x_m", "command"])
    with pytest.raises(UsageError, match=r"columns \['nothing'\]"):
        group.controls(group.nominal, ["nothing"])


def test_a_rollout_without_a_branch_has_no_windows(group: BranchGroup) -> None:
    record = {**group.nominal.record, "branch_tick": None}
    with pytest.raises(UsageError, match="no branch tick"):
        group.control_history(Rollout(record, group.nominal.tables))


def test_the_nominal_is_the_first_complete_one(group: BranchGroup) -> None:
    partial = Rollout({**group.nominal.record, "status": "partial"}, group.nominal.tables)
    assert BranchGroup("g", (partial, group.nominal)).nominal is group.nominal
    assert BranchGroup("g", (partial,)).nominal is partial
    with pytest.raises(UsageError, match="`g` has no nominal"):
        _ = BranchGroup("g", group.replays).nominal


def test_the_record_conforms_to_its_schema(group: BranchGroup) -> None:
    record = group.record()
    assert schema_mismatches(record, "branch-group.schema.json") == []
    assert [attempt["rollout_id"] for attempt in record["attempts"]] == [r.rollout_id for r in group.rollouts]


def test_a_group_shows_identities_counts_shapes_and_dtypes(group: BranchGroup) -> None:
    text = repr(group)
    assert "BranchGroup('g': 1 nominal, 3 intervention, 2 nominal_replay; 2 actions)" in text
    assert f"'g.brake_0.50.v1.a2' t_b={BRANCH_TICK}: controls [{WHOLE_TICKS}, 16], observations [27, 22]" in text
    assert f"history [16, {len(STATE_COLUMNS)}] float64, controls [80, 3] float32" in text
