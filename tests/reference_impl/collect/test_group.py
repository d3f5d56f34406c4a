"""A group is collected whole, qualifies, and is resumed without simulating anything twice."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from tests.content_cache import remembered
from tests.reference_impl.rendering.small import SMALL
from tests.sampling import sampled

from branchdrive import DatasetWriter, Descriptor, check_rollout
from branchdrive.collector.report import GroupReport
from branchdrive.contract.columns import TICK_TABLES
from branchdrive_reference.collect.campaign import collection_descriptor, town_maps
from branchdrive_reference.collect.group import execute_group
from branchdrive_reference.collect.plan import PlannedGroup, plan_group
from branchdrive_reference.collect.script import NUM_NOMINAL_REPLAYS, GroupScript, group_script
from branchdrive_reference.rendering.plan import MediaPlan, with_media
from branchdrive_reference.simulation.rollout import run
from branchdrive_reference.simulation.spec import WorldSpec

SEED = 20
DESCRIPTOR = collection_descriptor(SEED)
FAULTY = collection_descriptor(SEED, faults={"partial": 0.15, "quarantined": 0.1, "duplicate": 0.2, "late_branch": 0.2})
pytestmark = pytest.mark.usefixtures("remembered_runs")
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


def collect_one(
    root: Path, plan: PlannedGroup, between: object = lambda: None, descriptor: Descriptor = DESCRIPTOR
) -> GroupReport:
    with DatasetWriter(root, descriptor) as writer, writer.begin_group(plan.group_id, index=plan.index) as group:
        return execute_group(group, descriptor, plan, between=between)  # type: ignore[arg-type]


def identity(root: Path, descriptor: Descriptor = DESCRIPTOR) -> str:
    with DatasetWriter(root, descriptor, maps=town_maps()) as writer:
        return writer.finalize()


def test_every_rollout_of_a_group_complies(tmp_path: Path) -> None:
    plan = plan_group(SEED, 1)
    with DatasetWriter(tmp_path / "d", DESCRIPTOR) as writer:
        with writer.begin_group(plan.group_id, index=0) as group:
            report = execute_group(group, DESCRIPTOR, plan)
        rollouts = group.rollouts
    nominal = rollouts[0]
    assert (report.num_simulated, report.num_reused, report.unbranched_because) == (ROLLOUTS, 0, "")
    assert [r.record["role"] for r in rollouts] == ["nominal"] + ["intervention"] * 12 + ["nominal_replay"] * 2
    assert all(check_rollout(r, DESCRIPTOR, nominal=nominal) == [] for r in rollouts)
    assert {r.branch_tick for r in rollouts} == {nominal.branch_tick}
    for replay in rollouts[-NUM_NOMINAL_REPLAYS:]:
        for table in TICK_TABLES:
            assert replay.tables[table].drop_columns("rollout_id") == nominal.tables[table].drop_columns("rollout_id")


@pytest.fixture(scope="module")
def whole_identity(tmp_path_factory: pytest.TempPathFactory, remembered_runs: None) -> str:
    root = tmp_path_factory.mktemp("alone") / "d"
    collect_one(root, plan_group(SEED, 1))
    return identity(root)


@pytest.mark.parametrize("finished", sampled([6, 0, 1, 14], every=3))
def test_a_resumed_group_reuses_what_is_finished(tmp_path: Path, whole_identity: str, finished: int) -> None:
    plan = plan_group(SEED, 1)
    with pytest.raises(InterruptionError):
        collect_one(tmp_path / "resumed", plan, interrupt_after(finished))
    report = collect_one(tmp_path / "resumed", plan)
    assert (report.num_simulated, report.num_reused) == (ROLLOUTS - finished, finished)
    assert identity(tmp_path / "resumed") == whole_identity


def test_no_replay_is_spent_on_a_partial_nominal(tmp_path: Path) -> None:
    plan = plan_group(SEED, 0)
    short = dataclasses.replace(plan, spec=dataclasses.replace(plan.spec, timeout_ticks=100))
    report = collect_one(tmp_path / "d", short)
    assert report.num_simulated == 1
    assert "gave up at tick 100" in report.unbranched_because


def test_a_recommendation_is_a_note_and_costs_no_group(tmp_path: Path) -> None:
    """Of a camera that is declared and has no image yet."""
    filmed = with_media(DESCRIPTOR, MediaPlan((SMALL,)))
    report = collect_one(tmp_path / "d", plan_group(SEED, 1), descriptor=filmed)
    assert (report.num_simulated, report.unbranched_because, report.refused_because) == (ROLLOUTS, "", "")
    assert report.note.startswith("BD-FRM-004 Does not hold: Other cameras than the surround views cover the window: ")


@pytest.fixture(scope="module")
def eventful() -> tuple[PlannedGroup, GroupScript]:
    """A group whose nominal needs a second attempt, and which is collected to its end."""
    for index in range(1000):
        script = group_script(FAULTY, index)
        if script.nominal[0].is_failure and not script.stopped_because and len(script.nominal) == 2:
            return plan_group(SEED, index), script
    raise AssertionError("no such group among a thousand")


@pytest.fixture(scope="module")
def eventful_identity(
    eventful: tuple[PlannedGroup, GroupScript], tmp_path_factory: pytest.TempPathFactory, remembered_runs: None
) -> str:
    root = tmp_path_factory.mktemp("whole") / "d"
    collect_one(root, eventful[0], descriptor=FAULTY)
    return identity(root, FAULTY)


def test_attempts_are_made_as_the_script_says(tmp_path: Path, eventful: tuple[PlannedGroup, GroupScript]) -> None:
    plan, script = eventful
    with DatasetWriter(tmp_path / "d", FAULTY) as writer:
        with writer.begin_group(plan.group_id, index=0) as group:
            report = execute_group(group, FAULTY, plan)
        made = {(r.record["role"], r.record["action_key"], r.record["attempt"]): r.record for r in group.rollouts}
    attempts = [*script.nominal, *script.replays]
    assert report.num_simulated == len(made) == len(attempts)
    statuses = {"partial": "partial", "quarantined": "quarantined"}
    for attempt in attempts:
        record = made[attempt.role, attempt.policy.key, attempt.number]
        assert record["status"] == statuses.get(attempt.fault or "", "complete")
        if attempt.role != "nominal":
            assert record["nominal_rollout_id"] == made["nominal", "nominal", 2]["rollout_id"]


@pytest.mark.parametrize("finished", sampled([2, 1, 9], every=3))
def test_a_resumed_group_goes_on_in_its_script(
    tmp_path: Path, eventful: tuple[PlannedGroup, GroupScript], eventful_identity: str, finished: int
) -> None:
    plan, script = eventful
    with pytest.raises(InterruptionError):
        collect_one(tmp_path / "d", plan, interrupt_after(finished), FAULTY)
    report = collect_one(tmp_path / "d", plan, descriptor=FAULTY)
    assert report.num_reused == finished
    assert report.num_simulated == len(script.nominal) + len(script.replays) - finished
    assert identity(tmp_path / "d", FAULTY) == eventful_identity


def test_a_group_that_faults_end_early_says_why(tmp_path: Path) -> None:
    descriptor = collection_descriptor(SEED, faults={"abandoned": 1.0})
    report = collect_one(tmp_path / "d", plan_group(SEED, 1), descriptor=descriptor)
    assert report.unbranched_because == ""
    assert report.stopped_because == f"abandoned after {report.num_simulated} of 13 policies"


class Run:
    """Stands for an execution; notes what was asked for."""

    def __init__(self) -> None:
        self.specs: list[WorldSpec] = []

    def __call__(self, spec: WorldSpec, *arguments: object, **options: object) -> object:
        self.specs.append(spec)
        exact = dataclasses.replace(spec, replay=0, replay_noise=0.0)
        return remembered(run)(exact, *arguments, **options)


@pytest.mark.parametrize("noise", [0.0, 1.5])
def test_replays_get_noise_of_their_own_and_nominal_passes_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, noise: float
) -> None:
    spy = Run()
    monkeypatch.setattr("branchdrive_reference.collect.effect.run", spy)
    collect_one(tmp_path / "d", plan_group(SEED, 1), descriptor=collection_descriptor(SEED, replay_noise=noise))
    nominal, *replays = spy.specs
    assert (nominal.replay, nominal.replay_noise) == (0, 0.0)
    assert {spec.replay_noise for spec in replays} == {noise}
    assert len({spec.replay for spec in replays}) == (len(replays) if noise else 1)
    assert all(spec.replay > 0 for spec in replays) == bool(noise)
