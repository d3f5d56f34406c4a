"""Defects and limits of discrepancies, thresholds, validity, retention and the ledger."""

from __future__ import annotations

import numpy as np
from tests.synthetic_release import LOST, MOVED, SEED
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import LEDGER, RETENTION, SPLIT, THRESHOLDS, ReleaseDraft
from tests.validator.quality.whole import retention_document, threshold_document

from branchdrive.contract.layout import FILTERING_FILE
from branchdrive.quality.ledger import with_round
from branchdrive.tables.frame import Frame, take

REPLAY = {"rollout_id": "g13.nominal_replay.a1"}
"""A pair that decides nothing."""


NOISY = "g16"
"""The group that fails the core variables."""


ALL = tuple(f"BD-FID-{number:03d}" for number in range(1, 13))


@boundary(*ALL, base="detached")
def fidelity_of_a_detached_release(d: ReleaseDraft) -> None:
    d.reseal("split")


@boundary("BD-FID-003", "BD-FID-004", "BD-FID-005", "BD-FID-007", "BD-FID-008", "BD-FID-009")
def groups_without_pedestrians_in_range(d: ReleaseDraft) -> None:
    folder = d.folder_of("g2.nominal.a1")
    ids = d.take("rollouts", group_id=["g2", "g5"])["rollout_id"].to_pylist()
    here = [rollout_id for rollout_id in ids if d.folder_of(rollout_id) == folder]
    d.drop("actors", rollout_id=here, actor_class="pedestrian")
    d.set("observations", "pedestrian_hazard", False, rollout_id=here)
    for rollout_id in here:
        d.refresh_evidence(rollout_id)
    d.rebuild()


@boundary("BD-FID-005", "BD-FID-007")
def discrepancy_at_its_threshold(d: ReleaseDraft) -> None:
    """The training group that sets a threshold is within it."""
    pairs = d.frame("pairs")
    values = {v["name"]: v["value"] for v in d.documents[THRESHOLDS]["variables"]}
    row = int(np.flatnonzero(pairs["position_m"] == values["position_m"])[0])
    assert pairs["core_pass"][row]


@boundary("BD-FID-003", "BD-FID-004", "BD-MOD-005")
def numbers_of_another_machine(d: ReleaseDraft) -> None:
    """Last bits of what raw gives may differ; what follows from stored numbers follows exactly."""
    for column in ("position_m", "vehicle_gap_m"):
        d.set("pairs", column, lambda value: None if value is None else value * (1 + 1e-9))
    d.set("state", "rel_x_m", lambda value: value * (1 + 1e-12))
    d.reseal("thresholds", keep=("near_duplicates", "model"))


# BD-FID-001


@mutant("BD-FID-001", at={"table": "pairs", **REPLAY})
def nominal_replay_left_out(d: ReleaseDraft) -> None:
    d.drop("pairs", **REPLAY)


@mutant("BD-FID-001", at={"table": "pairs", "rollout_id": "g3.nominal_replay.a1"})
def pair_of_a_lost_group(d: ReleaseDraft) -> None:
    d.duplicate("pairs", {"group_id": LOST["bank"], "rollout_id": "g3.nominal_replay.a1"}, **REPLAY)
    d.sort("pairs")


# BD-FID-002


@mutant("BD-FID-002", at={"table": "pairs", **REPLAY, "column": "action_key"})
def replay_with_the_key_of_an_intervention(d: ReleaseDraft) -> None:
    d.set("pairs", "action_key", "brake_0.50", **REPLAY)


@mutant("BD-FID-002", at={"table": "pairs", **REPLAY, "column": "group_id"})
def replay_in_another_group(d: ReleaseDraft) -> None:
    d.set("pairs", "group_id", "g12", **REPLAY)


# BD-FID-003


@mutant("BD-FID-003", at={"table": "pairs", **REPLAY, "column": "position_m"})
def noise_of_a_replay_understated(d: ReleaseDraft) -> None:
    d.set("pairs", "position_m", 0.0, **REPLAY)


@mutant("BD-FID-003", at={"table": "pairs", "rollout_id": f"{NOISY}.brake_0.50.a1"}, findings=12)
def noisy_group_smoothed_over(d: ReleaseDraft) -> None:
    for column in ("position_m", "heading_deg", "speed_mps", "steer", "throttle", "brake"):
        d.set("pairs", column, lambda value: value / 100, group_id=NOISY, kind="intervention")
    d.reseal("passes")
    assert d.value("group_quality", "core_valid", group_id=NOISY)


@mutant("BD-FID-003", at={"table": "pairs", "rollout_id": "g0.brake_0.50.a1", "column": "speed_mps"})
def training_noise_overstated(d: ReleaseDraft) -> None:
    d.set("pairs", "speed_mps", 1.0, rollout_id="g0.brake_0.50.a1")
    d.reseal("thresholds")


@mutant("BD-FID-003", at={"table": "pairs", "rollout_id": "g18.brake_0.50.a1", "column": "tick_offset"})
def group_dropped_by_a_millionth_of_a_tick(d: ReleaseDraft) -> None:
    d.set("pairs", "tick_offset", 9e-10, rollout_id="g18.brake_0.50.a1")
    d.reseal("passes")
    assert not d.value("group_quality", "core_valid", group_id="g18")


@mutant("BD-FID-003", at={"table": "pairs", **REPLAY, "column": "position_m"})
def position_just_outside_of_the_tolerance(d: ReleaseDraft) -> None:
    d.set("pairs", "position_m", lambda value: value + 1.1e-9 * (1 + value), **REPLAY)


# BD-FID-004


@mutant("BD-FID-004", at={"table": "pairs", "rollout_id": "g18.brake_0.50.a1", "column": "actor_count_share"})
def group_dropped_by_the_share_of_nobody(d: ReleaseDraft) -> None:
    d.set("pairs", "actor_count_share", 9e-10, rollout_id="g18.brake_0.50.a1")
    d.reseal("passes")
    assert not d.value("group_quality", "extended_valid", group_id="g18")


@mutant("BD-FID-004", at={"table": "pairs", "rollout_id": f"{MOVED}.accelerate_0.80.a1", "column": "vehicle_gap_m"})
def moved_actors_put_back(d: ReleaseDraft) -> None:
    d.set("pairs", ("vehicle_gap_m", "vehicle_rel_speed_mps"), 0.001, rollout_id=f"{MOVED}.accelerate_0.80.a1")
    d.reseal("passes")
    assert d.value("group_quality", "extended_valid", group_id=MOVED)


@mutant("BD-FID-004", at={"table": "pairs", **REPLAY, "column": "vehicle_comparable"})
def traffic_called_incomparable(d: ReleaseDraft) -> None:
    d.set("pairs", "vehicle_comparable", False, **REPLAY)
    d.set("pairs", ("vehicle_gap_m", "vehicle_rel_speed_mps"), None, **REPLAY)
    d.reseal("passes")


@mutant("BD-FID-004", at={"table": "pairs", **REPLAY, "column": "has_pedestrian"})
def pedestrian_overlooked(d: ReleaseDraft) -> None:
    d.set("pairs", "has_pedestrian", lambda there: not there, **REPLAY)


# BD-FID-005


def _fit(d: ReleaseDraft, groups: Frame) -> None:
    fitted = threshold_document(d.frame("pairs"), groups)
    kept = {name: d.documents[THRESHOLDS][name] for name in ("split_digest", "num_groups", "pedestrian_support")}
    d.documents[THRESHOLDS] = {**fitted, **kept}
    d.reseal("passes")


@mutant("BD-FID-005", at={"file": THRESHOLDS, "pointer": "/variables/0/value"}, findings=6)
def thresholds_of_all_partitions(d: ReleaseDraft) -> None:
    groups = d.frame("group_quality")
    homes = np.ma.masked_array(np.full(len(groups["group_id"]), "train", object), groups["partition"].mask)
    _fit(d, {**groups, "partition": homes})
    assert d.value("group_quality", "core_valid", group_id=NOISY)


@mutant("BD-FID-005", at={"file": THRESHOLDS, "pointer": "/variables/0/value"}, findings=4)
def thresholds_of_groups_that_are_not_eligible(d: ReleaseDraft) -> None:
    groups = d.frame("group_quality")
    _fit(d, {**groups, "eligible": groups["integrity_complete"]})


@mutant("BD-FID-005", at={"file": THRESHOLDS, "pointer": "/variables/2/value"})
def threshold_loosened_by_hand(d: ReleaseDraft) -> None:
    d.documents[THRESHOLDS]["variables"][2]["value"] *= 2
    d.reseal("passes")


@mutant("BD-FID-005", at={"file": THRESHOLDS, "pointer": "/variables/5/floor"})
def floor_raised_by_hand(d: ReleaseDraft) -> None:
    d.documents[THRESHOLDS]["variables"][5]["floor"] = 0.01
    d.reseal("passes")


@mutant("BD-FID-005", at={"file": THRESHOLDS, "pointer": "/variables/5/value"})
def threshold_below_its_floor(d: ReleaseDraft) -> None:
    assert d.documents[THRESHOLDS]["variables"][5]["value"] == 0.001
    d.documents[THRESHOLDS]["variables"][5]["value"] = 0.0
    d.reseal("passes")


@mutant("BD-FID-005", at={"file": THRESHOLDS, "pointer": "/num_groups"})
def thresholds_of_more_groups_by_word(d: ReleaseDraft) -> None:
    d.documents[THRESHOLDS]["num_groups"] += 1
    d.reseal("passes")


# BD-FID-006


@mutant("BD-FID-006", at={"file": THRESHOLDS, "pointer": "/split_digest"})
def thresholds_of_another_split(d: ReleaseDraft) -> None:
    d.documents[THRESHOLDS]["split_digest"] = "0" * 64
    d.reseal("passes")


@mutant("BD-FID-006", at={"file": RETENTION, "pointer": "/split_digest"})
def retention_of_another_split(d: ReleaseDraft) -> None:
    d.documents[RETENTION]["split_digest"] = "0" * 64
    d.reseal("card")


# BD-FID-007


@mutant("BD-FID-007", at={"table": "pairs", **REPLAY, "column": "core_pass"})
def replay_called_failed(d: ReleaseDraft) -> None:
    d.set("pairs", ("core_pass", "extended_pass"), False, **REPLAY)


@mutant("BD-FID-007", at={"table": "pairs", "rollout_id": f"{NOISY}.brake_1.00.a1", "column": "core_pass"}, findings=10)
def failing_pairs_waved_through(d: ReleaseDraft) -> None:
    d.set("pairs", ("core_pass", "extended_pass"), True, group_id=NOISY, kind="intervention")
    d.reseal("validity")


@mutant("BD-FID-007", at={"table": "pairs", "rollout_id": "g18.brake_0.50.a1", "column": "core_pass"})
def group_dropped_within_the_tolerance(d: ReleaseDraft) -> None:
    """A training group and another brake alike in a replay, so the last bits of one discrepancy fail the other."""
    for group in ("g2", "g18"):
        d.set("controls", ("expert_brake", "applied_brake"), 0.25, rollout_id=f"{group}.brake_0.50.a1", tick=60)
    d.rebuild()
    assert d.documents[THRESHOLDS]["variables"][5]["value"] == 0.25
    d.set("pairs", "brake", 0.25 + 9e-10, rollout_id="g18.brake_0.50.a1")
    d.reseal("passes")
    assert not d.value("group_quality", "core_valid", group_id="g18")


# BD-FID-008


@mutant("BD-FID-008", at={"table": "group_quality", "group_id": NOISY, "column": "core_valid"})
def noisy_group_called_valid(d: ReleaseDraft) -> None:
    d.set("group_quality", "core_valid", True, group_id=NOISY)
    d.reseal("near_duplicates")


@mutant("BD-FID-008", at={"table": "group_quality", "group_id": MOVED, "column": "extended_valid"})
def group_among_other_traffic_called_valid(d: ReleaseDraft) -> None:
    d.set("group_quality", "extended_valid", True, group_id=MOVED)
    d.reseal("near_duplicates")


@mutant("BD-FID-008", at={"table": "group_quality", "group_id": LOST["eligibility"], "column": "core_valid"})
def group_that_is_not_eligible_called_valid(d: ReleaseDraft) -> None:
    d.set("group_quality", "core_valid", True, group_id=LOST["eligibility"])
    d.reseal("near_duplicates")


# BD-FID-009


@mutant("BD-FID-009", at={"file": RETENTION, "pointer": "/rows/2/share"})
def retention_rounded_up(d: ReleaseDraft) -> None:
    assert d.documents[RETENTION]["rows"][2]["share"] < 1
    d.documents[RETENTION]["rows"][2]["share"] = 1.0
    d.reseal("card")


@mutant("BD-FID-009", at={"file": RETENTION, "pointer": "/rows/3/low"})
def interval_tightened(d: ReleaseDraft) -> None:
    d.documents[RETENTION]["rows"][3]["low"] += 0.25
    d.reseal("card")


@mutant("BD-FID-009", at={"file": RETENTION, "pointer": "/thresholds_digest"})
def retention_of_other_thresholds(d: ReleaseDraft) -> None:
    d.documents[RETENTION]["thresholds_digest"] = "0" * 64
    d.reseal("card")


@mutant("BD-FID-009", at={"file": RETENTION, "pointer": "/rows/0/num_groups"}, findings=20)
def retention_over_eligible_groups_alone(d: ReleaseDraft) -> None:
    groups, told = d.frame("group_quality"), d.documents[RETENTION]
    digests = {name: told[name] for name in ("split_digest", "thresholds_digest")}
    honest = take(groups, groups["eligible"])
    d.documents[RETENTION] = retention_document(d.frame("pairs"), honest, seed=SEED, **digests)
    d.reseal("card")


# BD-FID-010


def _digests(d: ReleaseDraft) -> dict[str, str]:
    return {"split_digest": d.documents[SPLIT]["digest"], "thresholds_digest": d.digest(THRESHOLDS)}


@mutant("BD-FID-010", at={"file": LEDGER, "pointer": "/entries"})
def ledger_without_the_access_of_test(d: ReleaseDraft) -> None:
    d.documents[LEDGER]["entries"].pop()
    d.reseal("card")


@mutant("BD-FID-010", at={"file": LEDGER, "pointer": "/entries"})
def ledger_without_an_entry(d: ReleaseDraft) -> None:
    d.documents[LEDGER]["entries"].clear()
    d.reseal("card")


@mutant("BD-FID-010", at={"file": LEDGER, "pointer": "/entries"})
def ledger_of_other_thresholds(d: ReleaseDraft) -> None:
    d.documents[LEDGER] = with_round(None, **{**_digests(d), "thresholds_digest": "0" * 64})
    d.reseal("card")


@mutant("BD-FID-010", at={"file": LEDGER, "pointer": "/entries"})
def ledger_of_another_split(d: ReleaseDraft) -> None:
    d.documents[LEDGER] = with_round(None, **{**_digests(d), "split_digest": "0" * 64})
    d.reseal("card")


@mutant("BD-FID-010", at={"file": LEDGER, "pointer": "/entries/0/event"}, findings=3)
def thresholds_fixed_after_validation(d: ReleaseDraft) -> None:
    entries = d.documents[LEDGER]["entries"]
    entries[0]["event"], entries[1]["event"] = entries[1]["event"], entries[0]["event"]
    d.reseal("card")


# BD-FID-011


@mutant("BD-FID-011", at={"file": RETENTION, "pointer": "/rows/4/share"}, base="alone", findings=2)
def test_partition_that_misses_its_targets(d: ReleaseDraft) -> None:
    d.set("pairs", "speed_mps", 1.0, group_id="g13")
    d.reseal("passes")


@boundary("BD-FID-011", base="alone")
def validation_partition_that_misses_its_targets(d: ReleaseDraft) -> None:
    d.set("pairs", "speed_mps", 1.0, group_id="g18")
    d.reseal("passes")


# BD-FID-012


@mutant("BD-FID-012", at={"file": LEDGER, "pointer": "/entries"})
def test_accessed_under_other_thresholds_before(d: ReleaseDraft) -> None:
    before = with_round(None, **{**_digests(d), "thresholds_digest": "0" * 64})
    d.documents[LEDGER] = with_round(before, **_digests(d))
    d.reseal("card")


@boundary("BD-FID-010", "BD-FID-012")
def thresholds_fixed_twice_before_test_was_accessed(d: ReleaseDraft) -> None:
    before = with_round(None, **{**_digests(d), "thresholds_digest": "0" * 64})["entries"][:2]
    d.documents[LEDGER] = with_round({"entries": before}, **_digests(d))
    d.reseal("card")


# BD-FID-013


@boundary("BD-FID-013", "BD-REL-003")
def figures_beside_thresholds_with_other_last_bits(d: ReleaseDraft) -> None:
    for variable in d.add_filtering()["variables"]:
        if variable["variation"]:
            variable["variation"] *= 1 + 1e-12
    d.reseal("card")


@mutant("BD-FID-013", at={"file": FILTERING_FILE, "pointer": "/variables/4/num_failing_alone"})
def pair_that_fails_by_one_variable_alone_and_is_not_counted(d: ReleaseDraft) -> None:
    d.add_filtering()["variables"][4]["num_failing_alone"] += 1
    d.reseal("card")


@mutant("BD-FID-013", at={"file": FILTERING_FILE, "pointer": "/variables/12/threshold"})
def nearest_vehicle_in_the_place_of_the_matched_one(d: ReleaseDraft) -> None:
    variables = d.add_filtering()["variables"]
    variables[12]["threshold"] = variables[7]["threshold"] + 0.5
    d.reseal("card")


@mutant("BD-FID-013", at={"file": FILTERING_FILE, "pointer": "/variables/0/filters"})
def threshold_that_is_said_to_filter(d: ReleaseDraft) -> None:
    position = d.add_filtering()["variables"][0]
    position["filters"] = not position["filters"]
    d.reseal("card")
