"""Defects and limits of what follows from the numbers of a leakage audit, and of scores that recompute."""

from __future__ import annotations

from tests.validator.engine.rules.case import mutant
from tests.validator.engine.rules.cases.leakage_audit import audit, fail, judge, way
from tests.validator.engine.rules.release import LEAKAGE, ReleaseDraft

# BD-LKG-004: the gate's verdict


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/verdict"}, base="alone")
def failed_gate_called_passed(d: ReleaseDraft) -> None:
    fail(d)
    audit(d)["gate"]["verdict"] = "pass"
    d.reseal("card")


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/verdict"}, base="alone", findings=2)
def inconclusive_gate_called_passed(d: ReleaseDraft) -> None:
    audit(d)["gate"].update(tests=[], places=[], bandwidth=None, minimum_detectable_effect=None)
    d.reseal("card")


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/reason"})
def reason_of_somebody_s_own(d: ReleaseDraft) -> None:
    audit(d)["gate"]["reason"] = "Nothing leaks."
    d.reseal("card")


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect"})
def gate_without_an_effect_size(d: ReleaseDraft) -> None:
    audit(d)["gate"]["minimum_detectable_effect"] = None
    d.reseal("card")


@mutant(
    "BD-LKG-004",
    at={"file": LEAKAGE, "pointer": "/gate/minimum_detectable_effect/critical/0"},
    findings=6,
    base="alone",
)
def critical_values_kept_to_oneself(d: ReleaseDraft) -> None:
    audit(d)["gate"]["minimum_detectable_effect"]["critical"] = [None] * 6


@mutant("BD-LKG-004", at={"pointer": "/gate/minimum_detectable_effect/detections/0/shares/0"}, base="alone")
def share_of_half_a_replicate(d: ReleaseDraft) -> None:
    audit(d)["gate"]["minimum_detectable_effect"]["detections"][0].update(shares=[0.1, 0.2, *[0.0] * 4], gate_share=0.2)


@mutant("BD-LKG-004", at={"pointer": "/gate/minimum_detectable_effect/detections/0/gate_share"}, base="alone")
def gate_that_finds_more_than_its_statistics(d: ReleaseDraft) -> None:
    audit(d)["gate"]["minimum_detectable_effect"]["detections"][0].update(shares=[0.2, *[0.0] * 5], gate_share=0.4)


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/places/0/p"})
def place_of_no_permutations(d: ReleaseDraft) -> None:
    audit(d)["gate"]["places"][0]["p"] += 0.00005


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/tests/2/p_adjusted"}, findings=6)
def p_values_not_adjusted(d: ReleaseDraft) -> None:
    for test in audit(d)["gate"]["tests"]:
        test["p_adjusted"] = test["p"]


@mutant("BD-LKG-004", at={"file": LEAKAGE, "pointer": "/gate/tests/0/p"})
def p_value_of_no_permutations(d: ReleaseDraft) -> None:
    test = audit(d)["gate"]["tests"][0]
    test["p"] += 0.00005


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


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/0/tests/1/score/accuracy"}, base="alone")
def accuracy_outside_of_its_interval(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][1]["score"]["accuracy"] = 0.99


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/0/tests/1/score/log_likelihood"}, base="alone")
def probability_above_one(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][1]["score"]["log_likelihood"] = 0.5


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/0/tests/1/score/p_accuracy"}, base="alone")
def score_of_no_permutations(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][1]["score"]["p_accuracy"] += 0.00005
    judge(d)


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/0/tests/0/score/accuracy"}, base="alone")
def identical_scores_above_chance(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][0]["score"].update(accuracy=0.5, accuracy_interval=[0.25, 0.75])
    judge(d)


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/1/tests/1/score"})
def regression_that_did_not_run(d: ReleaseDraft) -> None:
    way(d, 1)["tests"][1].update(score=None, reason="there was no time")
    judge(d)


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/1/controls/2/score"})
def control_that_did_not_run(d: ReleaseDraft) -> None:
    way(d, 1)["controls"][2].update(score=None, reason="there was no time")
    judge(d)


@mutant("BD-LKG-005", at={"pointer": "/battery/ways/0/tests/2/score"}, findings=6)
def recurrent_tests_left_out_though_there_is_a_classifier(d: ReleaseDraft) -> None:
    audit(d)["protocol"]["sequence_classifier"] = {"name": "gru"}
    d.reseal("card")


# BD-LKG-012: scores of the regressions


@mutant("BD-LKG-012", at={"file": LEAKAGE, "pointer": "/battery/ways/0/tests/1/score/accuracy"}, findings=3)
def accuracy_nearly_one_with_a_p_value_of_one(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][1]["score"].update(accuracy=0.99, accuracy_interval=[0.98, 1.0])
    judge(d)


@mutant("BD-LKG-012", at={"file": LEAKAGE, "pointer": "/battery/ways/0/tests/1/score/p_accuracy"})
def p_value_of_other_scores(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][1]["score"]["p_accuracy"] = 1.0
    judge(d)


@mutant("BD-LKG-012", at={"file": LEAKAGE, "pointer": "/battery/ways/0/tests/0/score/identical"})
def identical_availability_called_different(d: ReleaseDraft) -> None:
    way(d, 0)["tests"][0]["score"]["identical"] = False
    judge(d)


@mutant("BD-LKG-012", at={"file": LEAKAGE, "pointer": "/battery/ways/1/controls/0/score/log_likelihood"})
def control_that_scored_otherwise(d: ReleaseDraft) -> None:
    way(d, 1)["controls"][0]["score"]["log_likelihood"] *= 2
