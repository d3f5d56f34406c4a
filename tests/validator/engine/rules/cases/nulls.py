"""Defects and limits of nulls, masks and conditions; `test_columns` goes through every column."""

from __future__ import annotations

from tests.synthetic import BRANCH_TICK, WINDOW_TICKS
from tests.validator.engine.rules.case import (
    ACCELERATE,
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    REPLAY,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import RECORDABLE


def _place(table: str, column: str, rollout_id: str = BRAKE, **more: int) -> dict[str, str | int]:
    return {"table": table, "column": column, "rollout_id": rollout_id, **more}


# BD-NUL-001


@mutant("BD-NUL-001", at=_place("observations", "speed_mps", tick=BRANCH_TICK))
def speed_missing(d: Draft) -> None:
    d.set("observations", "speed_mps", None, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-NUL-001", at=_place("evidence", "collision", tick=0))
def flag_missing(d: Draft) -> None:
    d.set("evidence", "collision", None, rollout_id=BRAKE, tick=0)


@mutant("BD-NUL-001", at=_place("rollouts", "environment"))
def text_missing(d: Draft) -> None:
    d.set("rollouts", "environment", None, rollout_id=BRAKE)


@mutant("BD-NUL-001", at=_place("evidence", "ttc_available", tick=0))
def mask_missing(d: Draft) -> None:
    # The governed values go as well: they must not be there without their mask.
    d.set("evidence", ("ttc_available", "ttc_s", "ttc_actor_id"), None, rollout_id=BRAKE, tick=0)


@boundary("BD-NUL-001")
def columns_declared_nullable_in_the_file(d: Draft) -> None:
    d.set("observations", ("speed_mps", "command"), lambda value: value, rollout_id=BRAKE)


# BD-NUL-002


@mutant("BD-NUL-002", at=_place("evidence", "separation_m", tick=BRANCH_TICK))
def value_missing_under_its_mask(d: Draft) -> None:
    d.set("evidence", "separation_m", None, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-NUL-002", at=_place("evidence", "nearest_pedestrian_gap_m", tick=0))
def zero_stands_for_absence(d: Draft) -> None:
    d.set("evidence", "nearest_pedestrian_gap_m", 0.0, rollout_id=BRAKE, tick=0)


@mutant("BD-NUL-002", at=_place("evidence", "traffic_light", tick=0))
def mask_off_over_a_value(d: Draft) -> None:
    d.set("evidence", "traffic_light_available", False, rollout_id=BRAKE, tick=0)


@boundary("BD-NUL-002")
def zero_is_a_value(d: Draft) -> None:
    d.set("actors", ("x_m", "y_m"), 0.0, rollout_id=BRAKE, tick=5, actor_id=4)
    d.refresh_evidence(BRAKE)


# BD-NUL-003


@mutant("BD-NUL-003", at=_place("controls", "nominal_brake", tick=BRANCH_TICK))
def stored_nominal_left_out_where_it_is_not_read(d: Draft) -> None:
    d.set("controls", "nominal_brake", None, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-NUL-003", at=_place("controls", "intended_steer", tick=BRANCH_TICK - 1))
def intended_before_the_window(d: Draft) -> None:
    d.set("controls", "intended_steer", 0.0, rollout_id=BRAKE, tick=BRANCH_TICK - 1)


@mutant("BD-NUL-003", at=_place("controls", "intended_throttle", NOMINAL, tick=0), findings=201)
def intended_throughout_the_nominal(d: Draft) -> None:
    d.set("controls", "intended_throttle", 0.5, rollout_id=NOMINAL)


@boundary("BD-NUL-003", "BD-CTL-013")
def nominal_without_any_policy_value(d: Draft) -> None:
    columns = tuple(
        f"{kind}_{actuator}" for kind in ("nominal", "intended") for actuator in ("steer", "throttle", "brake")
    )
    d.set("controls", columns, None, rollout_id=NOMINAL)


# BD-NUL-004


@mutant("BD-NUL-004", at=_place("rollouts", "status_reason"))
def reason_of_a_complete_attempt(d: Draft) -> None:
    d.set("rollouts", "status_reason", "went well", rollout_id=BRAKE)


@mutant("BD-NUL-004", at=_place("rollouts", "status_reason", REPLAY))
def no_reason_for_a_partial_attempt(d: Draft) -> None:
    d.set("rollouts", "status", "partial", rollout_id=REPLAY)


@mutant("BD-NUL-004", at=_place("rollouts", "nominal_rollout_id", NOMINAL))
def nominal_that_names_itself(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", NOMINAL, rollout_id=NOMINAL)


@mutant("BD-NUL-004", at=_place("rollouts", "nominal_rollout_id", REPLAY))
def replay_of_nothing(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", None, rollout_id=REPLAY)


@mutant("BD-NUL-004", at=_place("rollouts", "trigger_confidence"))
def branch_without_its_evidence(d: Draft) -> None:
    d.set("rollouts", "trigger_confidence", None, rollout_id=BRAKE)


@mutant("BD-NUL-004", at=_place("rollouts", "effective_steer_value", ACCELERATE))
def value_of_a_zero_rule(d: Draft) -> None:
    d.set("rollouts", "effective_steer_value", 0.0, rollout_id=ACCELERATE)


@boundary("BD-NUL-004")
def results_that_nobody_monitored(d: Draft) -> None:
    subjects = ("vehicle_collisions", "pedestrian_collisions", "static_collisions", "red_light_infractions")
    d.set("rollouts", tuple(f"result_num_{subject}" for subject in subjects), None)
    d.set("evidence", "lane_id", None)


# BD-NUL-006


@mutant("BD-NUL-006", at=_place("observations", "speed_limit_mps", tick=BRANCH_TICK))
def limit_missing_at_one_observation(d: Draft) -> None:
    d.set("observations", "speed_limit_mps", None, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-NUL-006", at=_place("rollouts", "ego_height_m", NOMINAL), findings=46)
def height_missing_and_not_declared(d: Draft) -> None:
    d.set("rollouts", "ego_height_m", None)


@mutant("BD-NUL-006", at={"table": "observations", "column": "command"}, findings=1886)
def unrecorded_command_has_values(d: Draft) -> None:
    d.descriptor["unrecorded"] = ["observations.command"]


@mutant("BD-NUL-006", at=_place("observations", "vehicle_hazard", tick=0))
def unrecorded_hazard_has_one_value(d: Draft) -> None:
    d.descriptor["unrecorded"] = ["observations.vehicle_hazard"]
    d.set("observations", "vehicle_hazard", None)
    d.set("observations", "vehicle_hazard", False, rollout_id=BRAKE, tick=0)


@boundary("BD-NUL-006", "BD-BOX-001", "BD-VAL-001", "BD-VAL-003", "BD-GRP-005")
def world_that_offers_nothing_it_may_lack(d: Draft) -> None:
    d.descriptor["unrecorded"] = list(RECORDABLE)
    d.descriptor["driver"] = {"kind": "log"}
    for place in RECORDABLE:
        table, column = place.split(".")
        d.set(table, column, None)


# BD-NUL-005


@mutant("BD-NUL-005", at=_place("evidence", "ttc_s", tick=BRANCH_TICK))
def sentinel_for_no_collision(d: Draft) -> None:
    d.set("evidence", "ttc_s", 999.0, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-NUL-005", at=_place("evidence", "ttc_s", tick=BRANCH_TICK + WINDOW_TICKS))
def sentinel_just_above_the_impossible(d: Draft) -> None:
    d.set("evidence", "ttc_s", 500.0000001, rollout_id=BRAKE, tick=BRANCH_TICK + WINDOW_TICKS)


@boundary("BD-NUL-005", "BD-EVD-002")
def slowest_closing_at_the_edge_of_range(d: Draft) -> None:
    # One actor, 50 m ahead and closing at 0.1 m/s: 500 s, of which either mask is right.
    d.drop("actors", rollout_id=BRAKE, tick=5, actor_id=[2, 3, 4, 5, 6, 7])
    d.set("evidence", "num_actors", 1, rollout_id=BRAKE, tick=5)
    length = 4.0
    d.set("observations", ("x_m", "y_m", "yaw_rad"), 0.0, rollout_id=BRAKE, tick=5)
    d.set("observations", "speed_mps", 0.125, rollout_id=BRAKE, tick=5)
    d.set("actors", "length_m", length, rollout_id=BRAKE, tick=5)
    d.set("actors", ("y_m", "yaw_rad", "vel_y_mps"), 0.0, rollout_id=BRAKE, tick=5)
    d.set("actors", "x_m", 50.0 + (4.5 + length) / 2, rollout_id=BRAKE, tick=5)
    d.set("actors", "vel_x_mps", 0.125 - 0.1, rollout_id=BRAKE, tick=5)
    d.refresh_evidence(BRAKE)
    d.set("rollouts", "result_num_static_collisions", 1, rollout_id=BRAKE)
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=5)
    d.set("evidence", "ttc_available", True, rollout_id=BRAKE, tick=5)
    d.set("evidence", "ttc_s", 500.0, rollout_id=BRAKE, tick=5)
    d.set("evidence", "ttc_actor_id", 1, rollout_id=BRAKE, tick=5)


# Several places: what violates a rule is counted


@mutant("BD-NUL-001", at={"rollout_id": FURTHER, "tick": BRANCH_TICK}, findings=2)
def two_speeds_missing(d: Draft) -> None:
    d.set("observations", "speed_mps", None, rollout_id=BOTH, tick=BRANCH_TICK)


@mutant("BD-NUL-004", at={"rollout_id": FURTHER, "column": "status_reason"}, findings=2)
def reasons_of_two_complete_attempts(d: Draft) -> None:
    d.set("rollouts", "status_reason", "went well", rollout_id=BOTH)
