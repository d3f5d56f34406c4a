"""Defects and limits of compliance, completeness, stages, populations and variants."""

from __future__ import annotations

from tests.synthetic_release import LOST, SEED
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import POPULATION, VARIANTS, ReleaseDraft

from branchdrive.contract.columns import TICK_TABLES
from branchdrive.quality.variants import Variant
from branchdrive.release.stage import BuildOptions

NONCOMPLIANT = {"rollout_id": "g9.brake_0.50.a1"}


REPLAYS = [f"g13.nominal_replay.a{attempt}" for attempt in (1, 2)]


ALL = tuple(f"BD-QUA-{number:03d}" for number in range(1, 13))


@boundary(*ALL, "BD-FID-001", "BD-FID-002")
def group_without_nominal_replays(d: ReleaseDraft) -> None:
    for rollout_id in REPLAYS:
        d.drop_attempt(rollout_id)
    d.rebuild()


@boundary("BD-QUA-012")
def populations_declared_beside_the_frozen_one(d: ReleaseDraft) -> None:
    declared = (
        Variant("noisy", "Eligible groups whatever their replays", {"eligible": True}),
        Variant("lost", "Groups that are lost", {"lost": True, "core_valid": False}),
    )
    d.rebuild(BuildOptions(seed=SEED, variants=declared))


@boundary("BD-QUA-010", "BD-QUA-011", "BD-QUA-012", "BD-QUA-013", base="alone")
def release_without_its_raw_layer(d: ReleaseDraft) -> None:
    d.reseal("source")


# BD-QUA-001


@mutant("BD-QUA-001", at={"table": "attempt_quality", "rollout_id": "g8.brake_0.50.a1"})
def attempt_without_quality(d: ReleaseDraft) -> None:
    d.drop("attempt_quality", rollout_id="g8.brake_0.50.a1")


@mutant("BD-QUA-001", at={"table": "attempt_quality", "rollout_id": "g8.brake_0.50.a3"})
def quality_of_no_attempt(d: ReleaseDraft) -> None:
    d.duplicate("attempt_quality", {"rollout_id": "g8.brake_0.50.a3"}, rollout_id="g8.brake_0.50.a1")
    d.sort("attempt_quality")


# BD-QUA-002


@mutant("BD-QUA-002", at={"table": "attempt_quality", **NONCOMPLIANT, "column": "compliant"})
def noncompliant_attempt_called_compliant(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "compliant", True, **NONCOMPLIANT)
    d.set("attempt_quality", "fails", False, **NONCOMPLIANT)
    d.set("attempt_quality", "failed_rules", None, **NONCOMPLIANT)


@mutant("BD-QUA-002", at={"table": "attempt_quality", **NONCOMPLIANT, "column": "failed_rules"})
def attempt_with_another_reason(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "failed_rules", "BD-CTL-008", **NONCOMPLIANT)


@mutant("BD-QUA-002", at={"table": "attempt_quality", **NONCOMPLIANT, "column": "compliant"})
def compliance_that_contradicts_its_reason(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "compliant", True, **NONCOMPLIANT)


# BD-QUA-003


@mutant("BD-QUA-003", at={"rollout_id": "g13.nominal.a1", "column": "missing_future_controls"})
def window_called_incomplete(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "missing_future_controls", 1, rollout_id="g13.nominal.a1")


@mutant("BD-QUA-003", at={"rollout_id": "g13.nominal.a1", "column": "group_id"})
def attempt_of_another_group(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "group_id", "g12", rollout_id="g13.nominal.a1")


@boundary("BD-QUA-001", "BD-QUA-003", "BD-QUA-006", "BD-QUA-007", "BD-CAN-010")
def attempt_that_was_cut_short(d: ReleaseDraft) -> None:
    for table in TICK_TABLES:
        d.drop(table, rollout_id="g8.brake_0.50.a1", tick=range(107, 201))
    d.recount("g8.brake_0.50.a1")
    d.rebuild()
    assert d.value("attempt_quality", "missing_future_controls", rollout_id="g8.brake_0.50.a1") == 44


# BD-QUA-004


@mutant("BD-QUA-004", at={"rollout_id": "g13.brake_0.50.a1", "column": "has_media"})
def media_that_are_not_there(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "has_media", True, rollout_id="g13.brake_0.50.a1")


@mutant("BD-QUA-004", at={"rollout_id": "g13.brake_0.50.a1", "column": "has_evidence"})
def evidence_denied(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "has_evidence", False, rollout_id="g13.brake_0.50.a1")


# BD-QUA-005


@mutant("BD-QUA-005", at={"table": "group_quality", "group_id": LOST["bank"]})
def lost_group_left_out(d: ReleaseDraft) -> None:
    d.drop("group_quality", group_id=LOST["bank"])
    d.reseal("population", keep=("leakage",))


@mutant("BD-QUA-005", at={"table": "group_quality", "group_id": "g99"})
def group_invented(d: ReleaseDraft) -> None:
    d.duplicate("group_quality", {"group_id": "g99"}, group_id=LOST["bank"])
    d.sort("group_quality")
    d.reseal("population", keep=("leakage",))


# BD-QUA-006


@mutant("BD-QUA-006", at={"group_id": LOST["bank"], "column": "exact_bank"})
def incomplete_bank_called_complete(d: ReleaseDraft) -> None:
    d.set("group_quality", "exact_bank", True, group_id=LOST["bank"])
    d.reseal("population")


@mutant("BD-QUA-006", at={"group_id": LOST["eligibility"], "column": "eligible"})
def group_with_two_seeds_called_eligible(d: ReleaseDraft) -> None:
    d.set("group_quality", "eligible", True, group_id=LOST["eligibility"])
    d.set("group_quality", "lost", False, group_id=LOST["eligibility"])
    d.set("group_quality", "lost_rules", None, group_id=LOST["eligibility"])
    d.reseal("thresholds")


# BD-QUA-007


@mutant("BD-QUA-007", at={"group_id": LOST["bank"], "column": "lost_rules"})
def group_with_another_reason(d: ReleaseDraft) -> None:
    d.set("group_quality", "lost_rules", "BD-BNK-002", group_id=LOST["bank"])


@mutant("BD-QUA-007", at={"group_id": LOST["eligibility"], "column": "lost_rules"})
def group_with_a_further_reason(d: ReleaseDraft) -> None:
    d.set("group_quality", "lost_rules", "BD-GRP-001 BD-GRP-003", group_id=LOST["eligibility"])


# BD-QUA-008


@mutant("BD-QUA-008", at={"group_id": LOST["bank"], "column": "town"})
def town_of_another_group(d: ReleaseDraft) -> None:
    d.set("group_quality", "town", "Town12", group_id=LOST["bank"])


@mutant("BD-QUA-008", at={"group_id": LOST["bank"], "column": "scenario_type"})
def scenario_renamed(d: ReleaseDraft) -> None:
    d.set("group_quality", "scenario_type", "Overtaking", group_id=LOST["bank"])


# BD-QUA-009


@mutant("BD-QUA-009", at={"group_id": "g13", "column": "num_nominal_replays"})
def nominal_replay_too_many(d: ReleaseDraft) -> None:
    d.set("group_quality", "num_nominal_replays", 3, group_id="g13")


# BD-QUA-010


@mutant("BD-QUA-010", at={"group_id": LOST["bank"]}, base="alone")
def stage_left_out(d: ReleaseDraft) -> None:
    d.set("group_quality", "controls_valid", True, group_id=LOST["bank"])
    d.reseal("population")


@mutant("BD-QUA-010", at={"group_id": LOST["bank"]})
def group_neither_eligible_nor_lost(d: ReleaseDraft) -> None:
    d.set("group_quality", "lost", False, group_id=LOST["bank"])
    d.set("group_quality", "lost_rules", None, group_id=LOST["bank"])
    d.reseal("population")


# BD-QUA-011


@mutant("BD-QUA-011", at={"file": POPULATION, "pointer": "/stages/7/total"})
def frozen_population_of_one_more(d: ReleaseDraft) -> None:
    d.documents[POPULATION]["stages"][7]["total"] += 1
    d.reseal("card")


@mutant("BD-QUA-011", at={"file": POPULATION, "pointer": "/stages/1/trajectories"})
def trajectories_of_the_lost_counted_in(d: ReleaseDraft) -> None:
    d.documents[POPULATION]["stages"][1]["trajectories"] += 12
    d.reseal("card")


@mutant("BD-QUA-011", at={"file": POPULATION, "pointer": "/stages/4/groups/val"}, findings=2)
def group_counted_in_another_partition(d: ReleaseDraft) -> None:
    d.documents[POPULATION]["stages"][4]["groups"]["val"] -= 1
    d.documents[POPULATION]["stages"][4]["groups"]["test"] += 1
    d.reseal("card")


# BD-QUA-012


@mutant("BD-QUA-012", at={"file": VARIANTS, "pointer": "/frozen/num_groups"})
def variant_counted_into_the_frozen_population(d: ReleaseDraft) -> None:
    d.documents[VARIANTS]["frozen"]["num_groups"] += 1
    d.reseal("card")


@mutant("BD-QUA-012", at={"file": VARIANTS, "pointer": "/variants/0/digest"})
def variant_of_other_groups(d: ReleaseDraft) -> None:
    d.documents[VARIANTS]["variants"][0]["digest"] = "0" * 64
    d.reseal("card")


@mutant("BD-QUA-012", at={"file": VARIANTS, "pointer": "/variants"})
def variant_under_the_name_of_the_frozen_population(d: ReleaseDraft) -> None:
    first = d.documents[VARIANTS]["variants"][0]
    d.documents[VARIANTS]["variants"].append({**first, "name": "frozen"})
    d.reseal("card")


# BD-QUA-013


@mutant("BD-QUA-013", at={"table": "attempt_quality", "rollout_id": "g8.brake_0.50.a1"}, base="alone")
def attempt_in_the_canonical_layer_alone(d: ReleaseDraft) -> None:
    d.drop("attempt_quality", rollout_id="g8.brake_0.50.a1")


@mutant("BD-QUA-013", at={"table": "group_quality", "group_id": LOST["bank"]}, base="alone")
def group_in_the_canonical_layer_alone(d: ReleaseDraft) -> None:
    d.drop("group_quality", group_id=LOST["bank"])
    d.reseal("population", keep=("leakage",))
