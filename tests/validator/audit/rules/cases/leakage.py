"""Defects and limits of the leakage audit: what it saw, what follows from its numbers, and what structure tells."""

from __future__ import annotations

from typing import Any

import numpy as np
from tests.validator.audit.rules.case import boundary, mutant
from tests.validator.audit.rules.cases.features import renormalise
from tests.validator.audit.rules.release import LEAKAGE, ReleaseDraft

from branchdrive.derive.leakage.gate import Outcome, gate_verdict
from branchdrive.derive.leakage.holm import holm
from branchdrive.derive.leakage.verify import protocol_of

ALL = tuple(f"BD-LKG-{number:03d}" for number in range(1, 10))
AUDITED = ALL[:7]
"""Rules on the document of the audit."""


def audit(d: ReleaseDraft) -> dict[str, Any]:
    """The document of the audit."""
    return d.documents[LEAKAGE]


def way(d: ReleaseDraft, index: int) -> dict[str, Any]:
    """One way of the battery."""
    found: dict[str, Any] = audit(d)["battery"]["ways"][index]
    return found


def conclude(d: ReleaseDraft, p_values: list[float]) -> None:
    """Give the gate these p-values and what honestly follows from them."""
    gate, protocol = audit(d)["gate"], protocol_of(audit(d)).gate
    outcomes = []
    for test, p, adjusted in zip(gate["tests"], p_values, holm(p_values).tolist(), strict=True):
        test.update(p=p, p_adjusted=adjusted)
        outcomes.append(Outcome(test["name"], test["observed"], p, adjusted))
    gate["verdict"], gate["reason"] = gate_verdict(tuple(outcomes), protocol)
    effect = gate["minimum_detectable_effect"]
    effect["critical"] = [
        test["observed"] + (-0.001 if test["p"] <= effect["alpha"] else 0.001) for test in gate["tests"]
    ]


def fail(d: ReleaseDraft) -> None:
    """Let one statistic of the gate be beyond every permutation."""
    conclude(d, [1 / 5000, 0.5, 0.25, 0.75])
    assert audit(d)["gate"]["verdict"] == "fail"


def leave_open(d: ReleaseDraft) -> None:
    """Let the permutations be too few for the gate to fail."""
    audit(d)["protocol"]["gate"]["num_permutations"] = 99
    conclude(d, [0.01, 0.5, 0.25, 0.75])
    assert audit(d)["gate"]["verdict"] == "inconclusive"


# Limits


@boundary(*ALL)
def audit_of_the_core_valid_groups(d: ReleaseDraft) -> None:
    assert audit(d)["gate"]["verdict"] == "pass"


@boundary(*AUDITED, status="skipped")
def release_without_an_audit(d: ReleaseDraft) -> None:
    d.documents.pop(LEAKAGE)
    d.reseal("card")


@boundary("BD-LKG-002", "BD-LKG-003", "BD-LKG-006", base="alone", status="skipped")
def audit_while_raw_is_not_at_hand(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary("BD-LKG-001", "BD-LKG-004", "BD-LKG-005", "BD-LKG-007", "BD-LKG-008", "BD-LKG-009", base="alone")
def audit_judged_without_raw(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary("BD-LKG-003", "BD-LKG-004")
def statistics_of_another_machine(d: ReleaseDraft) -> None:
    gate = audit(d)["gate"]
    for test in gate["tests"]:
        test["observed"] *= 1 + 5e-7
    gate["bandwidth"] *= 1 + 5e-7


@boundary("BD-LKG-004", "BD-LKG-007")
def gate_that_nearly_fails(d: ReleaseDraft) -> None:
    conclude(d, [2 / 5000, 0.5, 0.25, 0.75])
    assert audit(d)["gate"]["verdict"] == "pass"
    d.reseal("card")


@boundary("BD-LKG-005")
def battery_with_tests_that_did_not_run(d: ReleaseDraft) -> None:
    """Its status is a diagnostic of its own; no rule asks that it passes."""
    assert {test["status"] for test in way(d, 0)["tests"]} == {"pass", "inconclusive", "not_run"}


@boundary("BD-LKG-009", base="alone")
def target_in_the_history_of_fewer_than_half_of_the_groups(d: ReleaseDraft) -> None:
    for group in d.frame("contexts")["group_id"].tolist()[:7]:
        told = d.value("scalars", "mean_jerk_mps3", group_id=group, action_key="brake_0.50")
        d.set("state", "speed_limit_mps", told, group_id=group, offset_ticks=0)
    renormalise(d)


# BD-LKG-001: groups


@mutant("BD-LKG-001", at={"file": LEAKAGE, "pointer": "/inputs/num_groups/train"})
def audit_of_fewer_groups(d: ReleaseDraft) -> None:
    audit(d)["inputs"]["num_groups"]["train"] -= 1
    audit(d)["gate"]["shape"]["groups"] -= 1
    way(d, 1)["num_groups"]["train"] -= 1
    d.reseal("card")


@mutant("BD-LKG-001", at={"file": LEAKAGE, "pointer": "/inputs/num_groups/train"}, findings=2)
def audit_under_another_split(d: ReleaseDraft) -> None:
    for counts in (audit(d)["inputs"]["num_groups"], way(d, 1)["num_groups"]):
        counts["train"], counts["val"] = counts["train"] - 1, counts["val"] + 1


@mutant("BD-LKG-001", at={"file": LEAKAGE, "pointer": "/gate/shape/groups"})
def gate_on_a_part_of_the_groups(d: ReleaseDraft) -> None:
    audit(d)["gate"]["shape"]["groups"] -= 1
    d.reseal("card")


@mutant("BD-LKG-001", at={"file": LEAKAGE, "pointer": "/gate/shape/features"})
def gate_without_some_features(d: ReleaseDraft) -> None:
    audit(d)["gate"]["shape"]["features"] -= 16
    d.reseal("card")


# BD-LKG-002: inputs


@mutant("BD-LKG-002", at={"file": LEAKAGE, "pointer": "/inputs/digest"})
def audit_of_other_replays(d: ReleaseDraft) -> None:
    audit(d)["inputs"]["digest"] = "0" * 64


@mutant("BD-LKG-002", at={"file": LEAKAGE, "pointer": "/inputs/nominal"})
def audit_against_another_nominal(d: ReleaseDraft) -> None:
    audit(d)["inputs"]["nominal"] = "brake_0.50"


# BD-LKG-003: statistics


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/tests/1/observed"})
def statistic_made_smaller(d: ReleaseDraft) -> None:
    audit(d)["gate"]["tests"][1]["observed"] *= 0.9


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/bandwidth"})
def bandwidth_of_other_data(d: ReleaseDraft) -> None:
    audit(d)["gate"]["bandwidth"] *= 2


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/places/0/action"})
def strongest_place_named_elsewhere(d: ReleaseDraft) -> None:
    audit(d)["gate"]["places"][0]["action"] = "accelerate_0.30"


# BD-LKG-004: the gate's verdict


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/verdict"})
def failed_gate_called_passed(d: ReleaseDraft) -> None:
    fail(d)
    audit(d)["gate"]["verdict"] = "pass"
    d.reseal("card")


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/verdict"})
def inconclusive_gate_called_passed(d: ReleaseDraft) -> None:
    leave_open(d)
    audit(d)["gate"]["verdict"] = "pass"
    d.reseal("card")


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/tests/2/p_adjusted"}, findings=4)
def p_values_not_adjusted(d: ReleaseDraft) -> None:
    for test in audit(d)["gate"]["tests"]:
        test["p_adjusted"] = test["p"]


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/tests/0/p"})
def p_value_of_no_permutations(d: ReleaseDraft) -> None:
    test = audit(d)["gate"]["tests"][0]
    test["p"] += 0.0001


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect/smallest_sd/one"})
def effect_that_was_not_detected(d: ReleaseDraft) -> None:
    audit(d)["gate"]["minimum_detectable_effect"]["smallest_sd"]["one"] = 0.8
    d.reseal("card")


# BD-LKG-005: the battery's statuses


@mutant("BD-LKG-005", at={"file": LEAKAGE, "pointer": "/battery/ways/0/tests/0/status"})
def identical_scores_called_passed(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][0]["status"] = "pass"
    d.reseal("card")


@mutant("BD-LKG-005", at={"file": LEAKAGE, "pointer": "/battery/ways/0/tests/1/p_adjusted/accuracy"})
def battery_not_adjusted(d: ReleaseDraft) -> None:
    test = way(d, 0)["tests"][1]
    test["p_adjusted"]["accuracy"] = test["score"]["p_accuracy"]


@mutant("BD-LKG-005", at={"file": LEAKAGE, "pointer": "/battery/ways/1/chance"})
def chance_of_another_number_of_actions(d: ReleaseDraft) -> None:
    way(d, 1)["chance"] = 1 / 13


@mutant("BD-LKG-005", at={"file": LEAKAGE, "pointer": "/battery/ways/0/controls/0/found"})
def control_called_missed(d: ReleaseDraft) -> None:
    way(d, 0)["controls"][0]["found"] = False


@mutant("BD-LKG-005", at={"file": LEAKAGE, "pointer": "/not_run"})
def missing_tests_not_mentioned(d: ReleaseDraft) -> None:
    audit(d)["not_run"].pop()


# BD-LKG-006: metamorphic steps


@mutant("BD-LKG-006", at={"file": LEAKAGE, "pointer": "/metamorphic/truncation/num_groups"})
def step_taken_on_fewer_groups(d: ReleaseDraft) -> None:
    audit(d)["metamorphic"]["truncation"]["num_groups"] -= 1


@mutant("BD-LKG-006", at={"file": LEAKAGE, "pointer": "/metamorphic/future_swap/num_changed"}, findings=2)
def change_that_did_not_happen(d: ReleaseDraft) -> None:
    audit(d)["metamorphic"]["future_swap"].update(num_changed=1, changed=["g0"])


# BD-LKG-007: the gate, a diagnostic


@mutant("BD-LKG-007", at={"file": LEAKAGE, "pointer": "/gate/verdict"})
def gate_that_fails(d: ReleaseDraft) -> None:
    fail(d)
    d.reseal("card")


@mutant("BD-LKG-007", at={"file": LEAKAGE, "pointer": "/gate/verdict"})
def gate_that_is_inconclusive(d: ReleaseDraft) -> None:
    leave_open(d)
    d.reseal("card")


# BD-LKG-008: identifiers, a diagnostic


@mutant("BD-LKG-008", at={"table": "group_quality", "column": "group_id"})
def partitions_in_the_order_of_identifiers(d: ReleaseDraft) -> None:
    frame = d.frame("group_quality")
    ordered = sorted(frame["group_id"][frame["partitioned"]].tolist())
    homes = dict(zip(ordered, ["train"] * 12 + ["val"] * 3 + ["test"] * 3, strict=True))
    for group, home in homes.items():
        d.set("group_quality", "partition", home, group_id=group)
    d.reseal("split")


# BD-LKG-009: histories that tell a target


@mutant("BD-LKG-009", at={"column": "state speed_limit_mps at tick 0"}, base="alone")
def target_hidden_in_the_history(d: ReleaseDraft) -> None:
    for group in d.frame("contexts")["group_id"].tolist():
        told = d.value("scalars", "mean_jerk_mps3", group_id=group, action_key="brake_0.50")
        d.set("state", "speed_limit_mps", told, group_id=group, offset_ticks=0)
    renormalise(d)


@mutant("BD-LKG-009", at={"column": "state speed_limit_mps at tick -75"}, base="alone")
def history_that_ranks_a_target(d: ReleaseDraft) -> None:
    groups = d.frame("contexts")["group_id"].tolist()
    for rank, group in enumerate(np.random.default_rng(3).permutation(groups).tolist()):
        d.set("state", "speed_limit_mps", 10.0 + rank, group_id=group, offset_ticks=-75)
        d.set("scalars", "max_yaw_rate_radps", 0.25 + rank / 64, group_id=group)
    renormalise(d)
