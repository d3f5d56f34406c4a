"""Defects that two rules see, each from its side; alone, none of these could tell the rules apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests.audits import validate_once
from tests.mutation import Draft, new_draft
from tests.synthetic import BRANCH_TICK, WINDOW_TICKS
from tests.validator.engine.rules.case import BRAKE, NOMINAL, REPLAY, SHARD_0, STEER_LEFT

from branchdrive.contract.columns import TICK_TABLES

END = BRANCH_TICK + WINDOW_TICKS


@pytest.mark.parametrize(("step", "said"), [(1, "after: theirs are late"), (-1, "before: theirs are early"), (2, None)])
def test_poses_of_actors_of_another_observation_are_named(step: int, said: str | None, tmp_path: Path) -> None:
    def moved(rows: pa.Table) -> pa.Table:
        of_attempt = pc.equal(rows["rollout_id"], STEER_LEFT).to_numpy()
        for column in ("x_m", "y_m", "yaw_rad"):
            values = rows[column].to_numpy().copy()
            for actor in np.unique(rows["actor_id"].to_numpy()[of_attempt]):
                track = np.flatnonzero(of_attempt & (rows["actor_id"].to_numpy() == actor))
                values[track] = values[track[np.clip(np.arange(len(track)) - step, 0, len(track) - 1)]]
            place = rows.schema.get_field_index(column)
            rows = rows.set_column(place, rows.schema.field(place), pa.array(values, rows.schema.field(place).type))
        return rows

    draft = new_draft()
    draft.map_table("actors", moved, folder=SHARD_0)
    report = validate_once(draft.write(tmp_path / "dataset"))
    (found,) = [finding.found for finding in report.findings if finding.rule == "BD-EVD-001"]
    assert found.partition(", as by the poses that actors have in the observation ")[2] == (said or "")


def failed(draft: Draft, tmp_path: Path) -> dict[str, int]:
    report = validate_once(draft.write(tmp_path / "dataset"))
    assert report.errors == ()
    return {tally.rule_id: tally.num_findings for tally in report.tallies if tally.num_findings}


@pytest.mark.parametrize(
    ("tick", "window"),
    [
        (BRANCH_TICK - 81, None),
        (BRANCH_TICK - 80, "BD-WIN-001"),
        (BRANCH_TICK - 1, "BD-WIN-001"),
        (BRANCH_TICK, "BD-WIN-003"),
        (END, "BD-WIN-003"),
        (END + 1, None),
    ],
)
def test_a_lost_control_belongs_to_the_window_that_it_lies_in(tick: int, window: str | None, tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop("controls", rollout_id=REPLAY, tick=tick)
    draft.recount(REPLAY)
    assert failed(draft, tmp_path) == {"BD-TIC-001": 1} | ({window: 1} if window else {})


@pytest.mark.parametrize(
    ("tick", "windows"),
    [
        (BRANCH_TICK - 85, ()),
        (BRANCH_TICK - 80, ("BD-WIN-002",)),
        (BRANCH_TICK - 75, ("BD-WIN-002", "BD-WIN-004")),
        (BRANCH_TICK, ("BD-WIN-002", "BD-WIN-004")),
        (BRANCH_TICK + 5, ("BD-WIN-003", "BD-WIN-004")),
        (END, ("BD-WIN-003", "BD-WIN-004")),
        (END + 5, ()),
    ],
)
def test_a_lost_observation_belongs_to_the_windows_that_it_lies_in(
    tick: int, windows: tuple[str, ...], tmp_path: Path
) -> None:
    draft = new_draft()
    draft.drop_observation(REPLAY, tick)
    assert failed(draft, tmp_path) == {"BD-TIC-002": 1, **dict.fromkeys(windows, 1)}


@pytest.mark.parametrize("tick", [BRANCH_TICK - 75, BRANCH_TICK, END])
def test_evidence_alone_lost_from_the_window(tick: int, tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop("evidence", rollout_id=REPLAY, tick=tick)
    assert failed(draft, tmp_path) == {"BD-WIN-004": 1}


@pytest.mark.parametrize("tick", [BRANCH_TICK - 80, END + 5])
def test_evidence_alone_lost_beside_the_window(tick: int, tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop("evidence", rollout_id=REPLAY, tick=tick)
    assert failed(draft, tmp_path) == {}


def test_intervention_named_right_after_the_window(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("controls", "source", "intervention", rollout_id=BRAKE, tick=END)
    assert failed(draft, tmp_path) == {"BD-CTL-011": 1, "BD-CTL-012": 1}


def test_policy_kept_on_without_saying_who_drives(tmp_path: Path) -> None:
    """Active one tick longer, but named `online_expert` and driven by it: the window and the recovery are wrong."""
    draft = new_draft()
    here = {"rollout_id": BRAKE, "tick": END}
    draft.set("controls", "active", True, **here)
    for actuator in ("steer", "throttle", "brake"):
        stored = draft.value("controls", f"applied_{actuator}", rollout_id=NOMINAL, tick=END)
        draft.set("controls", f"nominal_{actuator}", stored, **here)
    expert_steer = draft.value("controls", "expert_steer", **here)
    draft.set("controls", ("intended_steer", "applied_steer"), expert_steer, **here)
    draft.set("controls", ("intended_throttle", "applied_throttle"), 0.0, **here)
    draft.set("controls", ("intended_brake", "applied_brake"), 0.5, **here)
    assert failed(draft, tmp_path) == {"BD-CTL-002": 1, "BD-CTL-011": 1, "BD-CTL-012": 1}


def test_recording_that_ends_one_tick_too_early(tmp_path: Path) -> None:
    draft = new_draft()
    for table in TICK_TABLES:
        draft.drop(table, rollout_id=BRAKE, tick=range(END, 201))
    draft.recount(BRAKE)
    assert failed(draft, tmp_path) == {"BD-CTL-012": 1, "BD-WIN-003": 1, "BD-WIN-004": 1}


def test_command_of_the_nominal_that_changed_after_it_was_stored(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("controls", "applied_throttle", 0.875, rollout_id=NOMINAL, tick=BRANCH_TICK)
    assert failed(draft, tmp_path) == {"BD-CTL-009": 1, "BD-CTL-010": 12}


@pytest.mark.parametrize("seed", [1, 2])
def test_identity_used_twice_in_one_shard(seed: int, tmp_path: Path) -> None:
    """All rows belong to the first of the two, so the counts of the second are wrong as well."""
    draft = new_draft()
    draft.duplicate("rollouts", {"attempt": 10 + seed}, rollout_id=REPLAY)
    assert failed(draft, tmp_path) == {"BD-KEY-001": 1, "BD-KEY-007": 2}


def _to_front(rows: pa.Table, rollout_id: str) -> pa.Table:
    first = pc.equal(rows["rollout_id"], rollout_id)
    return pa.concat_tables([rows.filter(first), rows.filter(pc.invert(first))])


def test_first_attempt_of_a_table_is_compared_like_any_other(tmp_path: Path) -> None:
    draft = new_draft()
    draft.copy_attempt(NOMINAL, "g0.nominal.a2", attempt=2, trigger_rollout_id="g0.nominal.a2")
    draft.set("rollouts", ("nominal_rollout_id", "trigger_rollout_id"), "g0.nominal.a2", rollout_id=STEER_LEFT)
    draft.set("rollouts", "town", "Town13", rollout_id=STEER_LEFT)
    draft.map_table("rollouts", lambda rows: _to_front(rows, STEER_LEFT), folder=SHARD_0)
    assert failed(draft, tmp_path) == {"BD-TAB-007": 1, "BD-BNK-002": 1, "BD-GRP-002": 1}


def test_rows_of_the_first_attempt_have_keys_like_any_other(tmp_path: Path) -> None:
    draft = new_draft()
    draft.map_table("rollouts", lambda rows: _to_front(rows, STEER_LEFT), folder=SHARD_0)
    draft.duplicate("evidence", rollout_id=STEER_LEFT, tick=0)
    draft.duplicate("actors", {"tick": 3}, rollout_id=STEER_LEFT, tick=0, actor_id=1)
    draft.duplicate("actors", rollout_id=STEER_LEFT, tick=0, actor_id=1)
    assert failed(draft, tmp_path) == {"BD-TAB-007": 1, "BD-KEY-006": 3}
