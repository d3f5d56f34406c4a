"""A group is collected whole, qualifies, and is resumed without simulating anything twice."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from branchdrive import DatasetWriter, check_rollout
from branchdrive_reference.collect.collection import collection_descriptor
from branchdrive_reference.collect.group import NUM_NOMINAL_REPLAYS, GroupReport, collect_group
from branchdrive_reference.collect.plan import GroupPlan, plan_group

SEED = 20
DESCRIPTOR = collection_descriptor(SEED)
ROLLOUTS = len(DESCRIPTOR.action_bank.policies) + NUM_NOMINAL_REPLAYS


class InterruptionError(Exception):
    """Stands for a killed process."""


def interrupt_after(count: int) -> object:
    left = [count]

    def between() -> None:
        if not left[0]:
            raise InterruptionError
        left[0] -= 1

    return between


def collect_one(root: Path, plan: GroupPlan, between: object = lambda: None) -> GroupReport:
    with DatasetWriter(root, DESCRIPTOR) as writer, writer.begin_group(plan.group_id, index=plan.index) as group:
        return collect_group(group, DESCRIPTOR, plan, between=between)  # type: ignore[arg-type]


def identity(root: Path) -> str:
    with DatasetWriter(root, DESCRIPTOR) as writer:
        return writer.finalize()


def test_every_rollout_of_a_group_complies(tmp_path: Path) -> None:
    plan = plan_group(SEED, 1)
    with DatasetWriter(tmp_path / "d", DESCRIPTOR) as writer:
        with writer.begin_group(plan.group_id, index=0) as group:
            report = collect_group(group, DESCRIPTOR, plan)
        rollouts = group.rollouts
    nominal = rollouts[0]
    assert (report.num_simulated, report.num_reused, report.unbranched_because) == (ROLLOUTS, 0, "")
    assert [r.record["role"] for r in rollouts] == ["nominal"] + ["intervention"] * 12 + ["nominal_replay"] * 2
    assert all(check_rollout(r, DESCRIPTOR, nominal=nominal) == [] for r in rollouts)
    assert {r.branch_tick for r in rollouts} == {nominal.branch_tick}
    for replay in rollouts[-NUM_NOMINAL_REPLAYS:]:
        for table in ("controls", "observations", "actors", "evidence"):
            assert replay.tables[table].drop_columns("rollout_id") == nominal.tables[table].drop_columns("rollout_id")


@pytest.mark.parametrize("finished", [0, 1, 6, 14])
def test_a_resumed_group_reuses_what_is_finished(tmp_path: Path, finished: int) -> None:
    plan = plan_group(SEED, 2)
    with pytest.raises(InterruptionError):
        collect_one(tmp_path / "resumed", plan, interrupt_after(finished))
    report = collect_one(tmp_path / "resumed", plan)
    assert (report.num_simulated, report.num_reused) == (ROLLOUTS - finished, finished)
    collect_one(tmp_path / "whole", plan)
    assert identity(tmp_path / "resumed") == identity(tmp_path / "whole")


def test_no_replay_is_spent_on_a_partial_nominal(tmp_path: Path) -> None:
    plan = plan_group(SEED, 0)
    short = dataclasses.replace(plan, spec=dataclasses.replace(plan.spec, timeout_ticks=100))
    report = collect_one(tmp_path / "d", short)
    assert report.num_simulated == 1
    assert "gave up at tick 100" in report.unbranched_because
