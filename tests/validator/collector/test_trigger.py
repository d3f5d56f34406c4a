"""Triggers find the expert's manoeuvre in a finished nominal rollout and place the branch before it."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive.collector.trigger import Branch, ExpertTrace, Signal, Trigger
from branchdrive.contract.columns import TABLES

BRAKE = Trigger("brake 1", (Signal("brake", 0.05),))
RELEASE = Trigger("release 1", (Signal("throttle_release", 0.02), Signal("brake", 0.05)))
SHIFT = Trigger("shift 1", (Signal("lane_shift", 0.1), Signal("brake", 0.05)))
TICKS = 400


def trace(
    *, brake_from: int | None = None, brake_to: int = TICKS, release_at: int = TICKS, shift_from: int = TICKS,
    hazard_tick: int = 100, ticks: int = TICKS, reacts_from: int = 0,
) -> ExpertTrace:  # fmt: skip
    time = np.arange(ticks)
    throttle = np.where(time < release_at, 0.3, 0.0).astype(np.float32)
    braking = (time >= brake_from) & (time < brake_to) if brake_from is not None else np.zeros(ticks, bool)
    shift = np.where(time >= shift_from, -0.5, 0.0)
    brake = np.where(braking, 0.4, 0.0).astype(np.float32)
    return ExpertTrace(throttle, brake, shift, time >= reacts_from, hazard_tick)


def found(trigger: Trigger, expert: ExpertTrace) -> Branch:
    branch = trigger.evaluate(expert)
    assert branch is not None
    return branch


@pytest.mark.parametrize(("onset", "branch_tick"), [(150, 145), (151, 150), (154, 150), (155, 150), (156, 155)])
def test_the_branch_is_the_last_observation_before_the_manoeuvre(onset: int, branch_tick: int) -> None:
    branch = found(BRAKE, trace(brake_from=onset))
    assert (branch.tick, branch.branch_tick, branch.branch_frame) == (onset, branch_tick, branch_tick // 5)


def test_evidence_is_recorded() -> None:
    branch = found(BRAKE, trace(brake_from=150, brake_to=158))
    assert (branch.definition, branch.signal, branch.threshold, branch.confidence) == ("brake 1", "brake", 0.05, 0.8)
    assert branch.value == pytest.approx(0.4)


def test_a_release_counts_only_before_braking() -> None:
    assert found(RELEASE, trace(release_at=140, brake_from=150)).signal == "throttle_release"
    assert found(RELEASE, trace(release_at=140, brake_from=200)).signal == "brake"


def test_the_earliest_signal_wins() -> None:
    assert found(SHIFT, trace(shift_from=180, brake_from=190)).signal == "lane_shift"
    assert found(SHIFT, trace(shift_from=180, brake_from=170)).signal == "brake"


def test_pedals_count_only_where_the_expert_reacts() -> None:
    assert found(BRAKE, trace(brake_from=150, reacts_from=170)).tick == 170
    assert found(RELEASE, trace(release_at=140, brake_from=150, reacts_from=145)).tick == 145
    assert BRAKE.evaluate(trace(brake_from=150, brake_to=200, reacts_from=200)) is None
    assert found(SHIFT, trace(shift_from=180, reacts_from=TICKS)).tick == 180


@pytest.mark.parametrize(
    "expert",
    [
        trace(),
        trace(brake_from=150, hazard_tick=-1),
        trace(brake_from=90),
        trace(brake_from=150, brake_to=153),
        trace(brake_from=79, hazard_tick=0),
        trace(brake_from=150, ticks=215),
    ],
    ids=["nothing", "no hazard", "before the hazard", "only for a moment", "no history", "no future"],
)
def test_no_branch_without_a_manoeuvre_and_its_windows(expert: ExpertTrace) -> None:
    assert BRAKE.evaluate(expert) is None


def test_a_branch_is_recorded_in_the_columns_of_the_rollouts_table() -> None:
    columns = found(BRAKE, trace(brake_from=150)).columns("group.nominal.a1")
    declared = {column.name for column in TABLES["rollouts"].columns}
    assert columns.keys() == {name for name in declared if name.startswith(("branch_", "trigger_"))}
    assert (columns["branch_tick"], columns["branch_frame"]) == (145, 29)
    assert (columns["trigger_tick"], columns["trigger_rollout_id"]) == (150, "group.nominal.a1")
