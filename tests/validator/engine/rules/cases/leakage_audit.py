"""Defects and limits of the leakage audit: what it saw, and what follows from its numbers."""

from __future__ import annotations

from typing import Any

from tests.validator.engine.rules.case import NO_SUBJECT, boundary, mutant
from tests.validator.engine.rules.release import LEAKAGE, ReleaseDraft

from branchdrive.contract.rule import CATALOGUE
from branchdrive.leakage.gate import Outcome, gate_verdict
from branchdrive.leakage.protocol import STATISTICS, AuditProtocol
from branchdrive.leakage.score import judged_battery
from branchdrive.leakage.sensitivity import PATTERNS
from branchdrive.statistics.holm import holm

ALL = tuple(rule_id for rule_id in CATALOGUE if rule_id.startswith("BD-LKG") and rule_id not in NO_SUBJECT)


STRUCTURAL = tuple(f"BD-LKG-{number:03}" for number in (8, 9, 10, 13, 14, 15, 16))
"""Rules on stored tables."""


AUDITED = tuple(rule_id for rule_id in ALL if rule_id not in STRUCTURAL)
"""Rules on the document of the audit."""


NEED_RAW = ("BD-LKG-002", "BD-LKG-003", "BD-LKG-012")


def audit(d: ReleaseDraft) -> dict[str, Any]:
    """The document of the audit."""
    return d.documents[LEAKAGE]


def way(d: ReleaseDraft, index: int) -> dict[str, Any]:
    """One way of the battery."""
    found: dict[str, Any] = audit(d)["battery"]["ways"][index]
    return found


def conclude(d: ReleaseDraft, p_values: list[float]) -> None:
    """Give the gate these p-values, 1 where none is named, and what honestly follows from them."""
    p_values = [*p_values, *[1.0] * (len(STATISTICS) - len(p_values))]
    gate, protocol = audit(d)["gate"], AuditProtocol.from_json(audit(d)["protocol"]).gate
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
    conclude(d, [1 / 10_000, 0.5, 0.25, 0.75])
    assert audit(d)["gate"]["verdict"] == "fail"


def state(d: ReleaseDraft, p_values: list[float]) -> None:
    """Give the gate these p-values and the verdict that follows, and leave the effect size as it is."""
    effect = audit(d)["gate"]["minimum_detectable_effect"]
    kept = list(effect["critical"])
    conclude(d, p_values)
    effect["critical"] = kept
    d.reseal("card")


def judge(d: ReleaseDraft) -> None:
    """Give the battery the statuses that follow from its scores."""
    battery = audit(d)["battery"]
    audit(d)["battery"] = judged_battery(battery["ways"], AuditProtocol.from_json(audit(d)["protocol"]).battery)
    audit(d)["not_run"] = [
        {"test": f"{way['name']}/{result['name']}", "reason": result["reason"]}
        for way in battery["ways"]
        for kind in ("controls", "tests")
        for result in way[kind]
        if result["score"] is None
    ]
    d.reseal("card")


def claim_effect(d: ReleaseDraft) -> None:
    """Claim that every offset was found."""
    effect = audit(d)["gate"]["minimum_detectable_effect"]
    for found in effect["detections"]:
        found.update(shares=[1.0] * 6, gate_share=1.0)
    effect["smallest_sd"] = {"one": 0.1, "dense": 0.1, "tenth": 0.8, "thirtieth": 0.8}
    d.reseal("card")


# Limits


@boundary(*ALL)
def audit_of_the_core_valid_groups(d: ReleaseDraft) -> None:
    assert audit(d)["gate"]["verdict"] == "pass"


@boundary(*AUDITED, status="skipped")
def release_without_an_audit(d: ReleaseDraft) -> None:
    d.documents.pop(LEAKAGE)
    d.reseal("card")


@boundary("BD-LKG-002", "BD-LKG-003", "BD-LKG-012", base="alone", status="skipped")
def audit_while_raw_is_not_at_hand(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary(*(rule for rule in ALL if rule not in NEED_RAW), base="alone")
def audit_judged_without_raw(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary("BD-LKG-003", "BD-LKG-004")
def statistics_of_another_machine(d: ReleaseDraft) -> None:
    gate = audit(d)["gate"]
    for test in gate["tests"]:
        test["observed"] *= 1 + 5e-7
    gate["bandwidth"] *= 1 + 5e-7


@boundary("BD-LKG-004", "BD-LKG-007", base="alone")
def gate_that_nearly_fails(d: ReleaseDraft) -> None:
    conclude(d, [3 / 10_000, 0.5, 0.25, 0.75])
    assert audit(d)["gate"]["verdict"] == "pass"
    d.reseal("card")


@boundary("BD-LKG-005")
def battery_with_tests_that_did_not_run(d: ReleaseDraft) -> None:
    """Its status is a diagnostic of its own; no rule asks that it passes."""
    assert {test["status"] for test in way(d, 0)["tests"]} == {"pass", "inconclusive", "not_run"}


@boundary("BD-LKG-003", "BD-LKG-004")
def p_values_of_one_permutation_more(d: ReleaseDraft) -> None:
    state(d, [test["p"] + 1 / 10_000 for test in audit(d)["gate"]["tests"]])


@boundary("BD-LKG-005", "BD-LKG-011", base="alone")
def recurrent_tests_of_a_classifier(d: ReleaseDraft) -> None:
    """A classifier is named, and ran in all recurrent tests."""
    audit(d)["protocol"]["sequence_classifier"] = {"name": "gru"}
    for index in range(2):
        model, *others = way(d, index)["tests"][1:]
        for other in others:
            other.update(score=dict(model["score"]), training={"num_epochs": 3, "best_epoch": 1})
    judge(d)


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


@mutant("BD-LKG-001", at={"file": LEAKAGE, "pointer": "/gate/shape/columns"})
def gate_without_recorded_columns(d: ReleaseDraft) -> None:
    audit(d)["gate"]["shape"]["columns"] = 0
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


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/tests/0/p"}, findings=6)
def p_values_of_one_everywhere(d: ReleaseDraft) -> None:
    state(d, [1.0] * 6)


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/tests/3/p"})
def p_value_of_other_permutations(d: ReleaseDraft) -> None:
    p_values = [test["p"] for test in audit(d)["gate"]["tests"]]
    state(d, [*p_values[:3], 0.75, *p_values[4:]])


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/places/0/p"})
def place_made_remarkable(d: ReleaseDraft) -> None:
    audit(d)["gate"]["places"][0]["p"] = 0.01


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/codes/0/columns/0/variable"})
def strongest_code_named_elsewhere(d: ReleaseDraft) -> None:
    audit(d)["gate"]["codes"][0]["columns"][0]["variable"] = "collision"


@mutant("BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect/critical/1"}, findings=7)
def critical_value_that_many_exceed(d: ReleaseDraft) -> None:
    gate = audit(d)["gate"]
    gate["minimum_detectable_effect"]["critical"][1] = gate["tests"][1]["observed"] + 0.001


@mutant(
    "BD-LKG-003",
    at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect/detections/0/gate_share"},
    findings=26,
)
def offsets_found_that_were_missed(d: ReleaseDraft) -> None:
    claim_effect(d)


@mutant(
    "BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect/detections/4/shares/3"}, findings=28
)
def offsets_found_beyond_any_statistic(d: ReleaseDraft) -> None:
    claim_effect(d)
    audit(d)["gate"]["minimum_detectable_effect"]["critical"] = [1e6] * 6


@mutant(
    "BD-LKG-003", at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect/detections/7/gate_share"}, findings=7
)
def offset_missed_that_is_found(d: ReleaseDraft) -> None:
    effect = audit(d)["gate"]["minimum_detectable_effect"]
    for found in effect["detections"]:
        found.update(shares=[0.0] * 6, gate_share=0.0)
    effect["smallest_sd"] = dict.fromkeys(PATTERNS)
    d.reseal("card")


# BD-LKG-007: the gate, a diagnostic


@mutant("BD-LKG-007", at={"file": LEAKAGE, "pointer": "/gate/verdict"}, base="alone")
def gate_that_fails(d: ReleaseDraft) -> None:
    fail(d)
    d.reseal("card")


# BD-LKG-011: the protocol


@mutant("BD-LKG-011", at={"file": LEAKAGE, "pointer": "/protocol/gate/alpha"})
def gate_at_a_level_of_its_own(d: ReleaseDraft) -> None:
    gate = audit(d)["gate"]
    audit(d)["protocol"]["gate"]["alpha"] = 0.01
    gate["minimum_detectable_effect"]["alpha"] = 0.01 / 6
    state(d, [test["p"] for test in gate["tests"]])


@mutant("BD-LKG-011", at={"file": LEAKAGE, "pointer": "/protocol/gate/penalty"})
def ridge_that_sees_nothing(d: ReleaseDraft) -> None:
    audit(d)["protocol"]["gate"]["penalty"] = 1e12


@mutant("BD-LKG-011", at={"file": LEAKAGE, "pointer": "/protocol/gate/offsets_sd"}, findings=2)
def offsets_that_everybody_finds(d: ReleaseDraft) -> None:
    for name in ("offsets_sd", "sparse_offsets_sd"):
        audit(d)["protocol"]["gate"][name] = [50.0]
    effect = audit(d)["gate"]["minimum_detectable_effect"]
    effect["detections"] = [
        {"pattern": pattern, "offset_sd": 50.0, "shares": [1.0] * 6, "gate_share": 1.0} for pattern in PATTERNS
    ]
    effect["smallest_sd"] = dict.fromkeys(PATTERNS, 50.0)
    d.reseal("card")


@mutant("BD-LKG-011", at={"file": LEAKAGE, "pointer": "/protocol/gate/num_permutations"})
def more_permutations_than_were_agreed(d: ReleaseDraft) -> None:
    gate = audit(d)["gate"]
    audit(d)["protocol"]["gate"]["num_permutations"] = 19_999
    state(d, [test["p"] for test in gate["tests"]])


@mutant("BD-LKG-011", at={"file": LEAKAGE, "pointer": "/protocol/parity/control_alpha"})
def controls_that_are_found_by_chance(d: ReleaseDraft) -> None:
    audit(d)["protocol"]["parity"]["control_alpha"] = 0.01
