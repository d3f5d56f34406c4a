"""Defects and limits of the canonical layer: records, attempts and their counts."""

from __future__ import annotations

from tests.synthetic_release import LOST
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import SOURCE, ReleaseDraft

LATER = {"g1": "g1.brake_0.50.a2", "g2": "g2.brake_0.50.a2"}
"""Second good attempts of an action: one drove a little otherwise, the other is a copy."""


NEVER = {"group_id": LOST["bank"], "action_key": "steer_left_0.10"}
"""The action that was never executed."""


ALL = tuple(f"BD-CAN-{number:03d}" for number in range(1, 13))


@boundary(*ALL)
def release_without_retries(d: ReleaseDraft) -> None:
    for rollout_id in (*LATER.values(), "g10.brake_0.50.a2", "g12.brake_0.50.a2", "g12.nominal.a2"):
        d.drop_attempt(rollout_id)
    d.rebuild()


@boundary(*ALL, base="detached")
def detached_release_beside_its_raw_dataset(d: ReleaseDraft) -> None:
    d.reseal("source")


@boundary("BD-CAN-002", "BD-CAN-003", "BD-CAN-010", "BD-CAN-011", "BD-QUA-002")
def action_whose_every_attempt_broke_a_rule(d: ReleaseDraft) -> None:
    d.set("controls", "applied_steer", 0.9, rollout_id="g9.brake_0.50.a2", tick=30)
    d.rebuild()


# BD-CAN-001


@mutant("BD-CAN-001", at={"table": "records", **NEVER})
def record_of_a_missing_action_left_out(d: ReleaseDraft) -> None:
    d.drop("records", **NEVER)
    d.reseal("source", keep=("model",))


@mutant("BD-CAN-001", at={"table": "records", "group_id": LOST["bank"], "action_key": "brake_0.99"})
def record_of_an_action_outside_the_bank(d: ReleaseDraft) -> None:
    d.duplicate("records", {"action_key": "brake_0.99"}, **NEVER)
    d.sort("records")
    d.reseal("source", keep=("model",))


@mutant("BD-CAN-001", at={"table": "records", "group_id": "g99", "action_key": "nominal"}, findings=13)
def records_of_a_group_that_raw_does_not_have(d: ReleaseDraft) -> None:
    rows = d.take("records", **NEVER)
    absent = [name for name in rows.column_names if rows[name][0].as_py() is None]
    d.duplicate("records", {"group_id": "g99", "state": "missing", "present": False}, group_id=LOST["bank"])
    d.set("records", "branched", False, group_id="g99")
    d.set("records", tuple(absent), None, group_id="g99")
    d.sort("records")
    d.reseal("source", keep=("model",))


# BD-CAN-002


def _choose_later(d: ReleaseDraft, group: str) -> None:
    later = LATER[group]
    first = later.replace(".a2", ".a1")
    d.set("records", "rollout_id", later, rollout_id=first)
    d.set("records", "attempt", 2, rollout_id=later)
    d.set("attempts", "disposition", "superseded", rollout_id=first)
    d.set("attempts", "disposition", "selected", rollout_id=later)
    d.set("candidates", "rollout_id", later, rollout_id=first)
    d.reseal("source", keep=("model",))


@mutant("BD-CAN-002", at={"table": "records", "group_id": "g1", "action_key": "brake_0.50", "column": "rollout_id"})
def better_retry_chosen(d: ReleaseDraft) -> None:
    _choose_later(d, "g1")


@mutant("BD-CAN-002", at={"table": "records", "group_id": "g2", "action_key": "brake_0.50", "column": "rollout_id"})
def copy_chosen_in_place_of_the_first(d: ReleaseDraft) -> None:
    _choose_later(d, "g2")


# BD-CAN-003


@mutant("BD-CAN-003", at={"table": "records", "group_id": LOST["controls"], "action_key": "brake_0.50"})
def noncompliant_attempt_selected(d: ReleaseDraft) -> None:
    rollout_id = f"{LOST['controls']}.brake_0.50.a1"
    d.set("records", "state", "selected", rollout_id=rollout_id)
    d.set("attempts", "disposition", "selected", rollout_id=rollout_id)
    d.reseal("source")


@mutant("BD-CAN-003", at={"table": "records", "group_id": "g13", "action_key": "brake_0.50", "column": "state"})
def good_attempt_called_ineligible(d: ReleaseDraft) -> None:
    d.set("records", "state", "ineligible", rollout_id="g13.brake_0.50.a1")
    d.set("attempts", "disposition", "kept", rollout_id="g13.brake_0.50.a1")
    d.reseal("source")


# BD-CAN-004


@mutant("BD-CAN-004", at={"group_id": LOST["bank"], "action_key": "brake_0.50", "column": "kind"})
def intervention_called_a_link(d: ReleaseDraft) -> None:
    d.set("records", "kind", "nominal_link", group_id=LOST["bank"], action_key="brake_0.50")
    d.reseal("source")


@mutant("BD-CAN-004", at={"table": "records", "group_id": LOST["bank"], "action_key": "nominal", "column": "kind"})
def nominal_called_physical(d: ReleaseDraft) -> None:
    d.set("records", "kind", "physical", group_id=LOST["bank"], action_key="nominal")
    d.reseal("source")


@mutant("BD-CAN-004", at={"group_id": "g12", "action_key": "nominal", "column": "nominal_rollout_id"})
def link_to_another_nominal(d: ReleaseDraft) -> None:
    d.set("records", "nominal_rollout_id", "g12.nominal.a2", group_id="g12", action_key="nominal")


# BD-CAN-005


@mutant("BD-CAN-005", at={"group_id": "g12", "action_key": "brake_0.50", "column": "nominal_rollout_id"})
def intervention_against_another_nominal(d: ReleaseDraft) -> None:
    d.set("records", "nominal_rollout_id", "g12.nominal.a2", group_id="g12", action_key="brake_0.50")


# BD-CAN-006


@mutant("BD-CAN-006", at={"table": "records", "group_id": "g13", "action_key": "brake_0.50", "column": "seed"})
def seed_of_a_record_made_equal(d: ReleaseDraft) -> None:
    d.set("records", "seed", 7, group_id="g13", action_key="brake_0.50")


@mutant("BD-CAN-006", at={"group_id": LOST["eligibility"], "action_key": "brake_0.50", "column": "seed"})
def disagreement_of_seeds_hidden(d: ReleaseDraft) -> None:
    seed = d.value("records", "seed", group_id=LOST["eligibility"], action_key="nominal")
    d.set("records", "seed", seed, group_id=LOST["eligibility"], action_key="brake_0.50")


@mutant("BD-CAN-006", at={"group_id": "g13", "action_key": "nominal", "column": "shard"})
def record_in_another_shard(d: ReleaseDraft) -> None:
    d.set("records", "shard", "raw/shard-00000", group_id="g13", action_key="nominal")


@mutant("BD-CAN-006", at={"group_id": "g13", "action_key": "nominal", "column": "provenance"})
def provenance_improved(d: ReleaseDraft) -> None:
    d.set("records", "provenance", "measured on a road", group_id="g13", action_key="nominal")


@mutant("BD-CAN-006", at={"group_id": LOST["controls"], "column": "nominal_rollout_id"})
def kept_attempt_with_an_invented_nominal(d: ReleaseDraft) -> None:
    rollout_id = f"{LOST['controls']}.brake_0.50.a1"
    d.set("records", "nominal_rollout_id", "g7.nominal.a9", rollout_id=rollout_id)


# BD-CAN-007


@mutant("BD-CAN-007", at={"group_id": "g13", "action_key": "brake_0.50", "column": "magnitude"})
def magnitude_of_another_action(d: ReleaseDraft) -> None:
    d.set("records", "magnitude", 0.3, group_id="g13", action_key="brake_0.50")


@mutant("BD-CAN-007", at={"column": "steer_rule", "action_key": "accelerate_0.50"}, findings=21)
def rule_other_than_the_banks_throughout(d: ReleaseDraft) -> None:
    d.set("records", "steer_rule", "online_expert", action_key="accelerate_0.50")


@mutant("BD-CAN-007", at={**NEVER, "column": "duration_ticks"})
def duration_of_an_action_never_executed(d: ReleaseDraft) -> None:
    d.set("records", "duration_ticks", 49, **NEVER)


@mutant("BD-CAN-007", at={"group_id": LOST["bank"], "action_key": "brake_0.99"}, base="alone")
def action_outside_the_bank(d: ReleaseDraft) -> None:
    d.duplicate("records", {"action_key": "brake_0.99"}, **NEVER)
    d.sort("records")
    d.reseal("source", keep=("model",))


# BD-CAN-008


@mutant("BD-CAN-008", at={"table": "attempts", "rollout_id": "g10.brake_0.50.a2"})
def attempt_left_unexplained(d: ReleaseDraft) -> None:
    d.drop("attempts", rollout_id="g10.brake_0.50.a2")
    d.reseal("source")


@mutant("BD-CAN-008", at={"table": "attempts", "rollout_id": "g10.brake_0.50.a3"})
def attempt_that_raw_does_not_have(d: ReleaseDraft) -> None:
    d.duplicate("attempts", {"rollout_id": "g10.brake_0.50.a3", "attempt": 3}, rollout_id="g10.brake_0.50.a2")
    d.sort("attempts")
    d.reseal("source")


# BD-CAN-009


@mutant("BD-CAN-009", at={"table": "attempts", "rollout_id": "g2.brake_0.50.a2", "column": "attempt"})
def attempt_number_changed(d: ReleaseDraft) -> None:
    d.set("attempts", "attempt", 3, rollout_id="g2.brake_0.50.a2")


@mutant("BD-CAN-009", at={"table": "attempts", "rollout_id": "g8.brake_0.50.a1", "column": "status"})
def partial_attempt_called_complete(d: ReleaseDraft) -> None:
    d.set("attempts", "status", "complete", rollout_id="g8.brake_0.50.a1")


# BD-CAN-010


@mutant("BD-CAN-010", at={"table": "attempts", "rollout_id": "g9.brake_0.50.a1", "column": "disposition"})
def noncompliant_attempt_called_superseded(d: ReleaseDraft) -> None:
    d.set("attempts", "disposition", "superseded", rollout_id="g9.brake_0.50.a1")
    d.reseal("source")


@mutant("BD-CAN-010", at={"table": "attempts", "rollout_id": "g12.brake_0.50.a2", "column": "disposition"})
def foreign_nominal_called_superseded(d: ReleaseDraft) -> None:
    d.set("attempts", "disposition", "superseded", rollout_id="g12.brake_0.50.a2")
    d.reseal("source")


# BD-CAN-011


@mutant("BD-CAN-011", at={"table": "attempts", "rollout_id": "g13.brake_0.50.a1"})
def attempt_of_a_record_called_superseded(d: ReleaseDraft) -> None:
    d.set("attempts", "disposition", "superseded", rollout_id="g13.brake_0.50.a1")
    d.reseal("source")


@mutant("BD-CAN-011", at={"table": "attempts", "rollout_id": "g2.brake_0.50.a2"})
def two_attempts_selected(d: ReleaseDraft) -> None:
    d.set("attempts", "disposition", "selected", rollout_id="g2.brake_0.50.a2")
    d.reseal("source")


# BD-CAN-012


@mutant("BD-CAN-012", at={"file": SOURCE, "pointer": "/dispositions/partial"})
def attempts_that_do_not_add_up(d: ReleaseDraft) -> None:
    d.documents[SOURCE]["dispositions"]["partial"] += 1
    d.reseal("card")


@mutant("BD-CAN-012", at={"file": SOURCE, "pointer": "/num_groups"})
def groups_counted_without_the_lost(d: ReleaseDraft) -> None:
    d.documents[SOURCE]["num_groups"] -= 1
    d.reseal("card")


@mutant("BD-CAN-012", at={"file": SOURCE, "pointer": "/records/missing"}, findings=2)
def missing_records_counted_as_physical(d: ReleaseDraft) -> None:
    d.documents[SOURCE]["records"]["physical"] += 1
    d.documents[SOURCE]["records"]["missing"] -= 1
    d.reseal("card")
