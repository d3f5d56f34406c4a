"""Every fault is found in the data by the rules that it is meant for, and by no other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import pytest
from tests.each import each

from branchdrive import open_dataset, validate
from branchdrive.collector.trigger import MARGIN_TICKS
from branchdrive.contract.bank import load_action_bank
from branchdrive.engine.report import Report
from branchdrive.raw.rollout import Rollout
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.collect.effect import MAX_SHIFT_TICKS, PROTOCOL_VARIANT
from branchdrive_reference.collect.fault import Fault

SEED = 3
BANK = load_action_bank()


@dataclass(frozen=True)
class Expected:
    """What a validator says about a group in which a fault happens wherever it can.

    Attributes:
        stage: Stage of the funnel at which the group is lost; empty if it qualifies.
        always: Rules that fail.
        sometimes: Rules that may fail, depending on how far the drawn faults go.
        num_rollouts: Attempts in the dataset.
    """

    stage: str
    always: frozenset[str]
    sometimes: frozenset[str] = frozenset()
    num_rollouts: int = 15


def rules(*names: str) -> frozenset[str]:
    return frozenset(f"BD-{name}" for name in names)


EXPECTED = {
    Fault.PARTIAL: Expected("bank", rules("STA-001", "BNK-001"), num_rollouts=3),
    Fault.QUARANTINED: Expected("bank", rules("STA-001", "BNK-001"), num_rollouts=3),
    Fault.EARLY_BRANCH: Expected("controls", rules("CTL-001", "CTL-002"), rules("RPN-003")),
    Fault.LATE_BRANCH: Expected("controls", rules("CTL-002", "CTL-012")),
    Fault.WRONG_DURATION: Expected("controls", rules("CTL-002"), rules("CTL-012")),
    Fault.TRUNCATED_LOG: Expected("controls", rules("CTL-012", "WIN-003", "WIN-004"), rules("CTL-002")),
    Fault.DROPPED_FRAME: Expected("integrity", rules("TIC-002", "WIN-004"), rules("WIN-002", "WIN-003", "RPN-003")),
    Fault.UNRETRIED: Expected("", rules()),
    Fault.DUPLICATE: Expected("", rules(), num_rollouts=30),
    Fault.ABANDONED: Expected("bank", rules("BNK-001"), num_rollouts=1),
    Fault.SEED_DISAGREEMENT: Expected("eligibility", rules("GRP-003"), rules("RPN-003")),
    Fault.ONLINE_STEERING: Expected("controls", rules("CTL-014", "GRP-007"), rules("CTL-005")),
}


@dataclass(frozen=True)
class Collected:
    """A dataset of one group, and what the validator says about it."""

    report: Report
    rollouts: tuple[Rollout, ...]

    def of(self, role: str) -> list[Rollout]:
        return [rollout for rollout in self.rollouts if rollout.record["role"] == role]


Collector: TypeAlias = Callable[[Fault], Collected]


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory, remembered_runs: None) -> Collector:
    """Datasets by the fault that happens in them wherever it can, collected when they are asked for."""

    @cache
    def collect_with(fault: Fault) -> Collected:
        root = tmp_path_factory.mktemp(fault) / "dataset"
        collect(root, num_groups=1, seed=SEED, faults={fault: 1.0})
        dataset = open_dataset(root)
        return Collected(validate(root), dataset.group(dataset.groups[0]).rollouts)

    return collect_with


def test_every_fault_has_its_expectation() -> None:
    assert set(EXPECTED) == set(Fault)
    assert MAX_SHIFT_TICKS < MARGIN_TICKS  # a late treatment ends before the nominal rollout does


@each("fault", Fault)
def test_a_fault_fails_its_rules_and_costs_its_stage(collected: Collector, fault: Fault) -> None:
    report, expected = collected(fault).report, EXPECTED[fault]
    failed = {tally.rule_id for tally in report.tallies if tally.num_findings}
    assert expected.always <= failed <= expected.always | expected.sometimes
    assert report.verdict == "valid"
    assert report.funnel is not None
    lost = {stage: count for stage, count in report.funnel.lost.items() if count}
    assert lost == ({expected.stage: 1} if expected.stage else {})
    assert len(collected(fault).rollouts) == expected.num_rollouts


@each("fault", Fault)
def test_an_attempt_tells_the_fault_that_was_injected(collected: Collector, fault: Fault) -> None:
    told = [r.record["action_key"] for r in collected(fault).rollouts if r.record["provenance"].endswith(fault)]
    interventions = [policy.key for policy in BANK.interventions]
    num_told = {
        Fault.PARTIAL: 3,
        Fault.QUARANTINED: 3,
        Fault.UNRETRIED: 0,
        Fault.DUPLICATE: 0,
        Fault.ABANDONED: 0,
        Fault.SEED_DISAGREEMENT: 1,
        Fault.ONLINE_STEERING: 3,
    }.get(fault, len(interventions))
    assert len(told) == num_told


def test_a_partial_attempt_was_executed_so_far_only(collected: Collector) -> None:
    records = [rollout.record for rollout in collected(Fault.PARTIAL).rollouts]
    assert [record["status"] for record in records] == ["partial"] * 3
    assert [record["status_reason"] for record in records] == [
        f"the simulator died at tick {record['num_ticks']}" for record in records
    ]
    assert len({record["num_ticks"] for record in records}) > 1


def test_a_quarantined_attempt_ran_to_its_end(collected: Collector) -> None:
    whole = collected(Fault.UNRETRIED).of("nominal")[0]
    for rollout in collected(Fault.QUARANTINED).rollouts:
        assert rollout.record["status"] == "quarantined"
        assert rollout.record["status_reason"].startswith("quarantined by the collector")
        assert rollout.record["num_ticks"] == whole.record["num_ticks"]


@pytest.mark.parametrize(("fault", "sign"), [(Fault.EARLY_BRANCH, -1), (Fault.LATE_BRANCH, 1)])
def test_a_treatment_is_shifted_by_up_to_ten_ticks(collected: Collector, fault: Fault, sign: int) -> None:
    shifts = set()
    for rollout in collected(fault).of("intervention"):
        active = rollout.column("controls", "active").nonzero()[0]
        assert len(active) == rollout.record["effective_duration_ticks"] == 50
        shifts.add(sign * (int(active[0]) - rollout.record["branch_tick"]))
    assert shifts <= set(range(1, 11))
    assert len(shifts) > 3


def test_a_duration_is_wrong_by_up_to_five_ticks(collected: Collector) -> None:
    errors = set()
    for rollout in collected(Fault.WRONG_DURATION).of("intervention"):
        assert rollout.record["effective_duration_ticks"] == 50
        errors.add(int(rollout.column("controls", "active").sum()) - 50)
    assert errors <= {-5, -4, -3, -2, -1, 1, 2, 3, 4, 5}
    assert len(errors) > 3


def test_a_truncated_log_stops_inside_the_window(collected: Collector) -> None:
    for rollout in collected(Fault.TRUNCATED_LOG).of("intervention"):
        branch_tick, num_ticks = rollout.record["branch_tick"], rollout.record["num_ticks"]
        assert rollout.record["status"] == "complete"
        assert branch_tick < num_ticks <= branch_tick + 50
        assert all(rollout.column(table, "tick").max() < num_ticks for table in ("observations", "evidence"))


def test_a_dropped_frame_leaves_no_trace_of_its_observation(collected: Collector) -> None:
    for rollout in collected(Fault.DROPPED_FRAME).of("intervention"):
        saved = set(range(0, rollout.record["num_ticks"], 5))
        (lost,) = saved - set(rollout.column("observations", "tick").tolist())
        assert -75 <= lost - rollout.record["branch_tick"] <= 50
        assert lost not in rollout.column("evidence", "tick")
        assert lost not in rollout.column("actors", "tick")


def test_a_duplicate_repeats_the_attempt(collected: Collector) -> None:
    by_number: dict[int, Counter[str]] = {1: Counter(), 2: Counter(), 3: Counter(), 4: Counter()}
    for rollout in collected(Fault.DUPLICATE).rollouts:
        by_number[rollout.record["attempt"]][rollout.record["role"]] += 1
    assert by_number[1] == by_number[2] == {"nominal": 1, "intervention": 12, "nominal_replay": 1}
    assert by_number[3] == by_number[4] == {"nominal_replay": 1}
    first, again = collected(Fault.DUPLICATE).of("nominal")
    assert first.column("observations", "x_m").tolist() == again.column("observations", "x_m").tolist()
    assert {r.record["nominal_rollout_id"] for r in collected(Fault.DUPLICATE).of("intervention")} == {first.rollout_id}


def test_another_seed_is_executed_and_recorded(collected: Collector) -> None:
    nominal = collected(Fault.SEED_DISAGREEMENT).of("nominal")[0]
    (odd,) = [r for r in collected(Fault.SEED_DISAGREEMENT).rollouts if r.record["seed"] != nominal.record["seed"]]
    assert odd.record["role"] == "intervention"
    places = [rollout.column("observations", "speed_mps")[:10].tolist() for rollout in (nominal, odd)]
    assert places[0] != places[1]


def test_online_steering_is_another_policy_and_says_so(collected: Collector) -> None:
    for rollout in collected(Fault.ONLINE_STEERING).of("intervention"):
        policy = BANK[rollout.record["action_key"]]
        is_steered = policy.family == "accelerate"
        assert (rollout.record["protocol_variant"] != PROTOCOL_VARIANT) == is_steered
        rule = "online_expert" if is_steered else policy.steer.rule
        assert rollout.record["effective_steer_rule"] == rule
        if is_steered:
            active = rollout.column("controls", "active")
            applied, expert = (rollout.column("controls", f"{name}_steer")[active] for name in ("applied", "expert"))
            assert applied.tolist() == expert.tolist()
