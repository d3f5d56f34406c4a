"""Defects and limits of the tables of the model layer: contexts, histories, candidates, targets and images."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from tests.synthetic_release import NOISY
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import LEAKAGE, ReleaseDraft

from branchdrive.contract.comparison import TOLERANCE
from branchdrive.contract.descriptor import Descriptor
from branchdrive.model.features import features_document

TRAIN, VAL, TEST = "g0", "g18", "g12"
"""A context of each partition; no scaling depends on the last two."""


PER_GROUP = ("contexts", "state", "past_controls", "expert", "surroundings", "candidates", "scalars", "trajectories")


ALL = tuple(f"BD-MOD-{number:03d}" for number in range(1, 22))


JUDGED_ALONE = ("BD-MOD-001", "BD-MOD-002", "BD-MOD-003", "BD-MOD-004", "BD-MOD-009", "BD-MOD-010", "BD-MOD-015",
                "BD-MOD-017", "BD-MOD-018", "BD-MOD-019", "BD-MOD-020", "BD-MOD-021")  # fmt: skip


def swap(d: ReleaseDraft, table: str, columns: tuple[str, ...], one: dict[str, Any], other: dict[str, Any]) -> None:
    """Exchange values of two rows."""
    for column in columns:
        values = [d.value(table, column, **key) for key in (one, other)]
        for key, value in zip((other, one), values, strict=True):
            d.set(table, column, value, **key)


def shift(d: ReleaseDraft, table: str, group: str, ticks: int) -> int:
    """Give every row of a history the values of the row so many ticks later, where there is one; rows that changed."""
    rows = d.take(table, group_id=group).to_pylist()
    by_offset = {row["offset_ticks"]: row for row in rows}
    changed = 0
    for row in rows:
        later = by_offset.get(row["offset_ticks"] + ticks)
        if later is None:
            continue
        changed += any(later[name] != row[name] for name in row if name != "offset_ticks")
        for column in row:
            if column not in ("group_id", "offset_ticks"):
                d.set(table, column, later[column], group_id=group, offset_ticks=row["offset_ticks"])
    return changed


# Limits


@boundary(*ALL)
def release_with_every_array(d: ReleaseDraft) -> None:
    assert len(d.frame("contexts")["group_id"]) == 15


@boundary(*JUDGED_ALONE, base="alone")
def model_layer_without_raw(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary(*(rule for rule in ALL if rule not in JUDGED_ALONE), base="alone", status="skipped")
def model_layer_while_raw_is_not_at_hand(d: ReleaseDraft) -> None:
    assert d.raw is None


@boundary(*ALL, base="detached")
def model_layer_with_raw_beside(d: ReleaseDraft) -> None:
    assert d.raw is not None


def within(value: float, share: float = 0.9) -> float:
    return value + share * TOLERANCE * (1 + abs(value))


@boundary("BD-MOD-005")
def state_within_the_tolerance(d: ReleaseDraft) -> None:
    d.set("state", ("rel_x_m", "mean_yaw_rate_radps"), within, group_id=TEST)


@boundary("BD-MOD-011")
def branch_pose_within_the_tolerance(d: ReleaseDraft) -> None:
    d.set("candidates", ("offset_x_m", "offset_y_m", "offset_yaw_rad"), within, group_id=TEST)


@boundary("BD-MOD-012", "BD-MOD-013")
def targets_within_the_tolerance(d: ReleaseDraft) -> None:
    d.set("scalars", ("mean_jerk_mps3", "max_accel_mps2"), within, group_id=TEST)


@boundary("BD-MOD-014", "BD-MOD-015")
def trajectories_within_the_tolerance(d: ReleaseDraft) -> None:
    d.set("trajectories", ("x_m", "y_m", "sin_yaw"), within, group_id=TEST)


def without_evidence(d: ReleaseDraft) -> None:
    """Claim no evidence, which the audit of leakage took for granted."""
    d.descriptor["streams"] = [name for name in d.descriptor["streams"] if name != "actor_risk_evidence"]
    d.documents["model/features.json"] = features_document(Descriptor.model_validate(d.descriptor))
    d.documents.pop(LEAKAGE, None)
    d.reseal("card")


@boundary("BD-MOD-003", base="alone")
def no_surroundings_without_evidence(d: ReleaseDraft) -> None:
    d.map_table("surroundings", lambda rows: rows.slice(0, 0), folder="model")
    without_evidence(d)


def own_encoding(d: ReleaseDraft, vectors: Any) -> None:
    """Declare an encoding of the dataset's own, with the width and digest of `vectors` in the order of the bank."""
    matrix = np.asarray(vectors, "<f4")
    digest = hashlib.sha256(matrix.tobytes()).hexdigest()
    d.descriptor["action_encoding"] = {"name": "own", "width": matrix.shape[1], "sha256": digest}
    d.documents["model/features.json"] = features_document(Descriptor.model_validate(d.descriptor))
    place = {policy["key"]: row for row, policy in enumerate(d.descriptor["action_bank"]["policies"])}
    frame = d.frame("actions")
    cells = np.empty(len(place), object)
    for row, key in enumerate(frame["action_key"].tolist()):
        cells[row] = matrix[place[key]].astype(np.float64)
    d.put("actions", {**frame, "encoding": np.ma.masked_array(cells, np.zeros(len(place), bool))})
    d.reseal("card")


def noise(d: ReleaseDraft) -> Any:
    """A matrix that no formula gives, ``[policies, 5]``."""
    return np.random.default_rng(0).normal(size=(len(d.descriptor["action_bank"]["policies"]), 5))


@boundary("BD-MOD-009", "BD-MOD-017", base="alone")
def encoding_of_the_datasets_own(d: ReleaseDraft) -> None:
    own_encoding(d, noise(d))


@boundary("BD-MOD-009", base="alone", status="skipped")
def encoding_that_no_builder_could_compute(d: ReleaseDraft) -> None:
    own_encoding(d, noise(d))
    d.set("actions", "encoding", None)
    d.set("actions", "encoded", False)


# BD-MOD-001, BD-MOD-002: contexts


@mutant("BD-MOD-001", at={"table": "contexts", "group_id": TEST})
def group_of_the_test_partition_left_out(d: ReleaseDraft) -> None:
    for table in (*PER_GROUP, "media_index"):
        d.drop(table, group_id=TEST)


@mutant("BD-MOD-001", at={"table": "contexts", "group_id": "g16"})
def group_that_fails_replay_taken_in(d: ReleaseDraft) -> None:
    assert "g16" in NOISY
    d.set("group_quality", "core_valid", True, group_id="g16")
    d.reseal("model")
    d.set("group_quality", "core_valid", False, group_id="g16")
    d.reseal("card")


@mutant("BD-MOD-002", at={"table": "contexts", "group_id": TEST, "column": "partition"})
def context_of_another_partition(d: ReleaseDraft) -> None:
    d.set("contexts", "partition", "val", group_id=TEST)
    d.sort("contexts")


@mutant("BD-MOD-002", at={"table": "contexts", "group_id": "g10", "column": "extended_valid"})
def context_called_extended_valid(d: ReleaseDraft) -> None:
    d.set("contexts", "extended_valid", True, group_id="g10")


@mutant("BD-MOD-002", at={"table": "contexts", "group_id": TEST, "column": "nominal_rollout_id"})
def context_of_another_nominal(d: ReleaseDraft) -> None:
    d.set("contexts", "nominal_rollout_id", "g12.nominal.a2", group_id=TEST)


# BD-MOD-021: partitions of rows


@mutant("BD-MOD-021", at={"file": "model/trajectories-train-00000.parquet", "column": "partition", "group_id": TEST})
def row_of_a_test_group_among_the_training_rows(d: ReleaseDraft) -> None:
    d.set("trajectories", "partition", "train", group_id=TEST, action_key="nominal", step=3)
    d.sort("trajectories")


@mutant("BD-MOD-021", at={"table": "past_controls", "column": "partition", "group_id": TEST}, findings=80)
def history_of_a_group_in_a_partition_without_groups(d: ReleaseDraft) -> None:
    d.set("past_controls", "partition", "calibration", group_id=TEST)
    d.sort("past_controls")


# BD-MOD-003, BD-MOD-004: rows


@mutant("BD-MOD-003", at={"table": "state", "group_id": TEST, "offset_ticks": -75})
def oldest_state_missing(d: ReleaseDraft) -> None:
    d.drop("state", group_id=TEST, offset_ticks=-75)


@mutant("BD-MOD-003", at={"table": "past_controls", "group_id": TEST, "offset_ticks": -1})
def latest_control_missing(d: ReleaseDraft) -> None:
    d.drop("past_controls", group_id=TEST, offset_ticks=-1)


@mutant("BD-MOD-003", at={"table": "state", "group_id": TEST, "offset_ticks": -3})
def state_between_observations(d: ReleaseDraft) -> None:
    d.duplicate("state", {"offset_ticks": -3}, group_id=TEST, offset_ticks=0)
    d.sort("state")


@mutant("BD-MOD-004", at={"table": "candidates", "group_id": TEST, "action_key": "brake_0.50"})
def candidate_missing(d: ReleaseDraft) -> None:
    d.drop("candidates", group_id=TEST, action_key="brake_0.50")


@mutant("BD-MOD-004", at={"table": "scalars", "group_id": TEST, "action_key": "nominal"})
def targets_of_the_nominal_missing(d: ReleaseDraft) -> None:
    d.drop("scalars", group_id=TEST, action_key="nominal")


@mutant("BD-MOD-004", at={"table": "trajectories", "group_id": TEST, "action_key": "brake_0.50", "step": 10})
def last_step_missing(d: ReleaseDraft) -> None:
    d.drop("trajectories", group_id=TEST, action_key="brake_0.50", step=10)


@mutant("BD-MOD-003", at={"table": "surroundings", "group_id": TEST}, base="alone", findings=16)
def surroundings_without_evidence(d: ReleaseDraft) -> None:
    rows = d.take("surroundings", group_id=TEST)
    d.map_table("surroundings", lambda _: rows, folder="model")
    without_evidence(d)


# BD-MOD-005 .. BD-MOD-008: histories


def bent(value: float) -> float:
    """The next number, as a channel of one bit."""
    return float(np.nextafter(value, np.inf))


@mutant("BD-MOD-005", at={"table": "state", "group_id": TEST, "column": "speed_mps"}, findings=16)
def recorded_speeds_with_another_last_bit(d: ReleaseDraft) -> None:
    d.set("state", "speed_mps", bent, group_id=TEST)


@mutant("BD-MOD-005", at={"table": "state", "group_id": TEST, "column": "command_left"}, findings=16)
def command_between_yes_and_no(d: ReleaseDraft) -> None:
    d.set("state", "command_left", bent, group_id=TEST)


@mutant("BD-MOD-005", at={"table": "state", "group_id": TEST, "column": "rel_x_m"})
def computed_position_just_outside_of_the_tolerance(d: ReleaseDraft) -> None:
    d.set("state", "rel_x_m", lambda value: within(value, 1.1), group_id=TEST, offset_ticks=-75)


@mutant("BD-MOD-007", at={"table": "expert", "group_id": TEST, "column": "target_speed_mps"}, findings=16)
def target_speed_with_another_last_bit(d: ReleaseDraft) -> None:
    d.set("expert", "target_speed_mps", bent, group_id=TEST)


@mutant("BD-MOD-008", at={"table": "surroundings", "group_id": TEST, "column": "separation_m"})
def separation_with_another_last_bit(d: ReleaseDraft) -> None:
    d.set("surroundings", "separation_m", bent, group_id=TEST, offset_ticks=0)


@mutant("BD-MOD-012", at={"table": "scalars", "group_id": TEST, "column": "min_separation_m"})
def smallest_separation_with_another_last_bit(d: ReleaseDraft) -> None:
    d.set("scalars", "min_separation_m", bent, group_id=TEST, action_key="brake_0.50")


@mutant("BD-MOD-014", at={"table": "trajectories", "group_id": TEST, "column": "speed_mps"}, findings=10)
def future_speeds_with_another_last_bit(d: ReleaseDraft) -> None:
    d.set("trajectories", "speed_mps", bent, group_id=TEST, action_key="brake_0.50")


@mutant("BD-MOD-006", at={"table": "past_controls", "group_id": TEST, "column": "brake"}, findings=80)
def brake_of_negative_zero(d: ReleaseDraft) -> None:
    assert d.take("past_controls", group_id=TEST)["brake"].to_pylist() == [0.0] * 80
    d.set("past_controls", "brake", -0.0, group_id=TEST)


@mutant("BD-MOD-005", at={"table": "state", "group_id": TEST, "offset_ticks": 0, "column": "speed_mps"})
def speed_off_by_a_thousandth(d: ReleaseDraft) -> None:
    d.set("state", "speed_mps", lambda v: v + 1e-3, group_id=TEST, offset_ticks=0)


@mutant("BD-MOD-005", at={"table": "state", "group_id": TEST}, findings=15)
def states_of_an_observation_later(d: ReleaseDraft) -> None:
    assert shift(d, "state", TEST, 5) == 15


@mutant("BD-MOD-005", at={"table": "state", "group_id": TEST, "column": "route_offset_m"}, findings=16)
def states_in_another_frame(d: ReleaseDraft) -> None:
    d.set("state", "route_offset_m", lambda v: -v, group_id=TEST)


@mutant("BD-MOD-006", at={"table": "past_controls", "group_id": TEST}, findings=79)
def controls_of_a_tick_later(d: ReleaseDraft) -> None:
    assert shift(d, "past_controls", TEST, 1) == 79


@mutant("BD-MOD-006", at={"table": "past_controls", "group_id": TEST, "offset_ticks": -1, "column": "brake"})
def brake_before_the_branch(d: ReleaseDraft) -> None:
    d.set("past_controls", "brake", 0.5, group_id=TEST, offset_ticks=-1)


@mutant("BD-MOD-006", at={"table": "past_controls", "group_id": TEST, "offset_ticks": -1, "column": "throttle"})
def throttle_off_by_one_bit(d: ReleaseDraft) -> None:
    def next_up(value: float) -> float:
        return float(np.nextafter(np.float32(value), np.float32(2)))

    d.set("past_controls", "throttle", next_up, group_id=TEST, offset_ticks=-1)


@mutant("BD-MOD-007", at={"table": "expert", "group_id": TEST, "offset_ticks": 0, "column": "pedestrian_hazard"})
def hazard_of_the_future(d: ReleaseDraft) -> None:
    d.set("expert", "pedestrian_hazard", lambda v: not v, group_id=TEST, offset_ticks=0)


@mutant("BD-MOD-007", at={"table": "expert", "group_id": TEST, "column": "target_speed_mps"})
def target_speed_of_the_future(d: ReleaseDraft) -> None:
    d.set("expert", "target_speed_mps", lambda v: v - 4.0, group_id=TEST, offset_ticks=-5)


@mutant("BD-MOD-008", at={"table": "surroundings", "group_id": TEST, "offset_ticks": 0, "column": "num_actors"})
def actor_more(d: ReleaseDraft) -> None:
    d.set("surroundings", "num_actors", lambda v: v + 1, group_id=TEST, offset_ticks=0)


@mutant(
    "BD-MOD-008", at={"table": "surroundings", "group_id": TEST, "offset_ticks": 0, "column": "separation_available"}
)
def separation_hidden(d: ReleaseDraft) -> None:
    d.set("surroundings", "separation_available", False, group_id=TEST, offset_ticks=0)
    d.set("surroundings", "separation_m", None, group_id=TEST, offset_ticks=0)
