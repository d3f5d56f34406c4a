"""Defects and limits of candidates, their actions, targets and trajectories, and of the media index."""

from __future__ import annotations

import numpy as np
from tests.validator.engine.rules.case import mutant
from tests.validator.engine.rules.cases.model_inputs import bent, noise, own_encoding, swap
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.contract.descriptor import Descriptor
from branchdrive.model.features import features_document

TEST = "g12"
"""A context of the test partition, on which no scaling depends."""


# BD-MOD-009 .. BD-MOD-011: candidates


@mutant("BD-MOD-009", at={"table": "actions", "action_key": "brake_0.30", "column": "encoding"}, findings=2)
def encodings_permuted(d: ReleaseDraft) -> None:
    frame = d.frame("actions")
    keys, vectors = frame["action_key"].tolist(), frame["encoding"].copy()
    one, other = keys.index("brake_0.30"), keys.index("brake_0.50")
    vectors[one], vectors[other] = frame["encoding"][other], frame["encoding"][one]
    d.put("actions", {**frame, "encoding": vectors})


@mutant("BD-MOD-009", at={"table": "actions", "action_key": "brake_0.30", "column": "position"}, findings=2)
def candidates_renumbered(d: ReleaseDraft) -> None:
    swap(d, "actions", ("position",), {"action_key": "brake_0.30"}, {"action_key": "brake_0.50"})


@mutant("BD-MOD-009", at={"table": "actions", "action_key": "brake_0.50", "column": "family"})
def family_of_another_actuator(d: ReleaseDraft) -> None:
    d.set("actions", "family", d.value("actions", "family", action_key="nominal"), action_key="brake_0.50")


@mutant("BD-MOD-009", at={"table": "actions", "column": "encoding"}, base="alone")
def own_encoding_with_another_last_bit(d: ReleaseDraft) -> None:
    matrix = noise(d)
    own_encoding(d, matrix)
    told = {**d.descriptor["action_encoding"]}
    matrix[3, 2] += 1e-6
    own_encoding(d, matrix)
    d.descriptor["action_encoding"] = told
    d.documents["model/features.json"] = features_document(Descriptor.model_validate(d.descriptor))
    d.reseal("card")


@mutant("BD-MOD-009", at={"table": "actions", "column": "encoding"}, base="alone")
def own_encoding_of_another_width(d: ReleaseDraft) -> None:
    own_encoding(d, noise(d))
    d.descriptor["action_encoding"]["width"] = 6
    d.documents["model/features.json"] = features_document(Descriptor.model_validate(d.descriptor))
    d.reseal("card")


@mutant("BD-MOD-009", at={"table": "actions", "column": "encoding"}, base="alone")
def own_encoding_without_a_policy(d: ReleaseDraft) -> None:
    own_encoding(d, noise(d))
    d.set("actions", "encoding", None, action_key="brake_0.50")
    d.set("actions", "encoded", False, action_key="brake_0.50")


@mutant("BD-MOD-009", at={"table": "actions", "column": "encoding"}, base="alone")
def own_encoding_of_more_digits(d: ReleaseDraft) -> None:
    own_encoding(d, noise(d))
    d.set("actions", "encoding", lambda vector: [bent(vector[0]), *vector[1:]], action_key="brake_0.50")


@mutant("BD-MOD-010", at={"table": "candidates", "group_id": TEST, "column": "rollout_id"}, findings=2)
def candidates_swapped(d: ReleaseDraft) -> None:
    one, other = ({"group_id": TEST, "action_key": key} for key in ("brake_0.30", "accelerate_0.30"))
    swap(d, "candidates", ("rollout_id",), one, other)


@mutant("BD-MOD-010", at={"table": "candidates", "group_id": "g9", "action_key": "brake_0.50"})
def candidate_that_broke_a_rule(d: ReleaseDraft) -> None:
    d.set("candidates", "rollout_id", "g9.brake_0.50.a1", group_id="g9", action_key="brake_0.50")


@mutant("BD-MOD-011", at={"table": "candidates", "group_id": TEST, "column": "offset_x_m"})
def branch_pose_off_by_a_millimetre(d: ReleaseDraft) -> None:
    d.set("candidates", "offset_x_m", lambda v: v + 1e-3, group_id=TEST, action_key="brake_0.50")


@mutant("BD-MOD-011", at={"table": "candidates", "group_id": TEST, "column": "offset_x_m"}, findings=12)
def branch_poses_called_identical(d: ReleaseDraft) -> None:
    d.set("candidates", ("offset_x_m", "offset_y_m", "offset_yaw_rad"), 0.0, group_id=TEST)


# BD-MOD-012 .. BD-MOD-015: targets


@mutant("BD-MOD-012", at={"table": "scalars", "group_id": TEST, "column": "min_separation_m"})
def separation_off_by_a_thousandth(d: ReleaseDraft) -> None:
    d.set("scalars", "min_separation_m", lambda v: v + 1e-3, group_id=TEST, action_key="brake_0.50")


@mutant("BD-MOD-012", at={"table": "scalars", "group_id": TEST}, findings=2)
def targets_swapped(d: ReleaseDraft) -> None:
    one, other = ({"group_id": TEST, "action_key": key} for key in ("brake_0.30", "accelerate_0.30"))
    swap(d, "scalars", ("mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"), one, other)


@mutant("BD-MOD-012", at={"table": "scalars", "group_id": TEST, "column": "max_yaw_rate_radps"}, findings=10)
def yaw_rates_in_degrees(d: ReleaseDraft) -> None:
    d.set("scalars", "max_yaw_rate_radps", lambda v: v * 180 / np.pi, group_id=TEST)


@mutant("BD-MOD-013", at={"table": "scalars", "group_id": TEST, "column": "mean_jerk_available"})
def mask_off(d: ReleaseDraft) -> None:
    where = {"group_id": TEST, "action_key": "brake_0.50"}
    d.set("scalars", "mean_jerk_available", False, **where)
    d.set("scalars", "mean_jerk_mps3", None, **where)


@mutant("BD-MOD-013", at={"table": "scalars", "group_id": TEST, "column": "min_ttc_available"}, findings=13)
def dangerous_group_without_times_to_collision(d: ReleaseDraft) -> None:
    d.set("scalars", "min_ttc_available", False, group_id=TEST)
    d.set("scalars", "min_ttc_s", None, group_id=TEST)


@mutant("BD-MOD-014", at={"table": "trajectories", "group_id": TEST, "step": 5, "column": "y_m"})
def position_off_by_a_millimetre(d: ReleaseDraft) -> None:
    d.set("trajectories", "y_m", lambda v: v + 1e-3, group_id=TEST, action_key="brake_0.50", step=5)


@mutant("BD-MOD-014", at={"table": "trajectories", "group_id": TEST, "column": "y_m"}, findings=10)
def trajectory_mirrored(d: ReleaseDraft) -> None:
    d.set("trajectories", "y_m", lambda v: -v, group_id=TEST, action_key="steer_left_0.10")


@mutant("BD-MOD-015", at={"table": "scalars", "group_id": TEST, "column": "displacement_m"}, base="alone")
def displacement_of_another_trajectory(d: ReleaseDraft) -> None:
    d.set("scalars", "displacement_m", lambda v: v + 1e-3, group_id=TEST, action_key="brake_0.50")


@mutant("BD-MOD-015", at={"table": "scalars", "group_id": TEST, "column": "displacement_m"}, base="alone", findings=13)
def trajectories_lengthened(d: ReleaseDraft) -> None:
    d.set("trajectories", "x_m", lambda v: v * 1.01, group_id=TEST, step=10)


# BD-MOD-016: images


@mutant("BD-MOD-016", at={"table": "media_index", "group_id": TEST, "camera": "top_down", "column": "offset_bytes"})
def index_that_points_elsewhere(d: ReleaseDraft) -> None:
    d.set("media_index", "offset_bytes", lambda v: v + 8, group_id=TEST, camera="top_down")


@mutant("BD-MOD-016", at={"table": "media_index", "group_id": TEST, "camera": "top_down", "column": "rollout_id"})
def images_of_an_intervention(d: ReleaseDraft) -> None:
    d.set("media_index", "rollout_id", "g12.brake_0.50.a1", group_id=TEST, camera="top_down")


@mutant("BD-MOD-016", at={"table": "media_index", "group_id": TEST, "camera": "top_down"})
def image_left_out(d: ReleaseDraft) -> None:
    d.drop("media_index", group_id=TEST, camera="top_down")
