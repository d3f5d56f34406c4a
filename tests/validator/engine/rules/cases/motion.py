"""Defects and limits of the ego's motion."""

from __future__ import annotations

import numpy as np
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    STEER_LEFT,
    boundary,
    mutant,
)
from tests.validator.engine.rules.cases.tracks import COUNTS, observed_at
from tests.validator.engine.rules.draft import Draft

# BD-MOT-006

ON_A_BEND = "g1.steer_left_0.10.a1"


def _motion_of(column: str) -> dict[str, str]:
    return {"table": "observations", "column": column, "rollout_id": BRAKE}


@mutant("BD-MOT-006", at={**_motion_of("yaw_rate_radps"), "rollout_id": ON_A_BEND}, base="bare")
def yaw_rate_of_the_other_sense_in_an_attempt(d: Draft) -> None:
    """And so small that no single turn refutes it."""
    d.set("observations", "yaw_rate_radps", lambda rate: -0.2 * rate, rollout_id=ON_A_BEND)


@mutant("BD-MOT-006", at=_motion_of("accel_longitudinal_mps2"), base="bare")
def attempt_that_accelerates_for_nobody(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", 0.0, rollout_id=BRAKE)


@boundary("BD-MOT-006", base="bare")
def accelerations_of_a_third_of_the_speeds(d: Draft) -> None:
    d.set("observations", ("accel_longitudinal_mps2", "accel_lateral_mps2"), lambda a: a / 3, rollout_id=BRAKE)


@mutant("BD-MOT-006", at={**_motion_of("accel_lateral_mps2"), "rollout_id": ON_A_BEND}, base="bare")
def two_skids_in_an_attempt(d: Draft) -> None:
    skids = [BRANCH_TICK + 10, BRANCH_TICK + 15]
    d.set("observations", "accel_lateral_mps2", -7.5, rollout_id=ON_A_BEND, tick=skids)


@boundary("BD-MOT-006", base="bare")
def skid_of_one_observation(d: Draft) -> None:
    """It makes a slope of 0.2, and without it there is one of 1."""
    d.set("observations", "accel_lateral_mps2", -7.5, rollout_id=ON_A_BEND, tick=BRANCH_TICK + 15)


@boundary("BD-MOT-006", base="bare")
def yaw_rates_that_lag_behind_a_turn_from_the_branch_on(d: Draft) -> None:
    """A few observations in which turns begin and end make small values, and no contrary sign."""
    after = range(BRANCH_TICK, BRANCH_TICK + 45, 5)
    d.set("observations", "yaw_rate_radps", lambda rate: 0.1 * rate, rollout_id=ON_A_BEND, tick=after)


HISTORY = range(BRANCH_TICK - 75, BRANCH_TICK + 1, 5)


@mutant("BD-MOT-006", at={**_motion_of("accel_lateral_mps2"), "rollout_id": ON_A_BEND}, base="bare")
def accelerations_of_the_other_sense_up_to_the_branch(d: Draft) -> None:
    """What lies behind outweighs them, so that the slope of the attempt is right."""
    behind = range(BRANCH_TICK + 5, BRANCH_TICK + 101, 5)
    d.set("observations", "accel_lateral_mps2", lambda a: -a, rollout_id=ON_A_BEND, tick=HISTORY)
    d.set("observations", "accel_lateral_mps2", lambda a: 2 * a, rollout_id=ON_A_BEND, tick=behind)


@boundary("BD-MOT-006", base="bare")
def accelerations_that_nearly_cancel_up_to_the_branch(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", lambda a: -0.2 * a, rollout_id=ON_A_BEND, tick=HISTORY)


def give_before(d: Draft, column: str, share: float, **where: object) -> None:
    """Values that are, to a share, those of the observation before."""
    for rollout_id in d.take("rollouts", **where)["rollout_id"].to_pylist():
        values = d.take("observations", rollout_id=rollout_id)[column].to_numpy()
        late = (1 - share) * values + share * np.append(values[:1], values[:-1])
        d.fill("observations", {column: late.astype(np.float32)}, rollout_id=rollout_id)


@mutant("BD-MOT-006", at={**_motion_of("speed_mps"), "rollout_id": ON_A_BEND}, base="bare")
def speeds_of_the_observation_before_in_an_attempt(d: Draft) -> None:
    give_before(d, "speed_mps", 1.0, rollout_id=ON_A_BEND)


# BD-MOT


@mutant("BD-MOT-001", at=observed_at("x_m", 5), base="bare")
def speed_in_kilometres_per_hour(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda v: 3.6 * v, rollout_id=BRAKE)


@boundary("BD-MOT-001", base="bare")
def speed_at_the_bound(d: Draft) -> None:
    """Whatever the mean of the attempt says where nobody knows its contacts."""
    d.set("rollouts", COUNTS[2], None, rollout_id=STEER_LEFT)
    d.set("observations", "speed_mps", lambda v: v + 4.0, rollout_id=STEER_LEFT)


@mutant("BD-MOT-001", at=observed_at("x_m", 5), base="bare")
def speed_in_kilometres_per_hour_where_nobody_counts_contacts(d: Draft) -> None:
    d.set("rollouts", COUNTS[2], None, rollout_id=BRAKE)
    d.set("observations", "speed_mps", lambda v: 3.6 * v, rollout_id=BRAKE)


def _speeding(d: Draft, ticks: range) -> None:
    """Speeds that break the displacement there and at the next observation."""
    d.set("observations", "speed_mps", lambda v: v + 30.0, rollout_id=BRAKE, tick=ticks)


@mutant("BD-MOT-001", at=observed_at("x_m", 120), base="bare")
def speeds_that_no_contact_explains(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)
    _speeding(d, range(120, 160, 5))


@boundary("BD-MOT-001", base="bare")
def speeds_that_a_contact_explains(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)
    _speeding(d, range(120, 155, 5))


def _touch(d: Draft, rollout_id: str, *ticks: int) -> None:
    """Let an attempt touch something static."""
    d.set("evidence", "collision", True, rollout_id=rollout_id, tick=list(ticks))
    d.set("rollouts", COUNTS[2], 1, rollout_id=rollout_id)


@boundary("BD-MOT-001", "BD-MOT-003", "BD-MOT-004")
def speeds_that_are_wrong_within_two_seconds_of_a_contact(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda v: v + 30.0, rollout_id=BRAKE, tick=range(20, 60, 5))
    d.refresh_evidence(BRAKE)
    _touch(d, BRAKE, 20)


@mutant("BD-MOT-002", at=observed_at("yaw_rad", 150))
def yaw_rate_without_a_turn(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", 1.7, rollout_id=BRAKE, tick=[150, 155])


@boundary("BD-MOT-002")
def yaw_rate_of_a_swerve(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", 1.5, rollout_id=BRAKE, tick=150)


@mutant("BD-MOT-002", at=observed_at("yaw_rad", 65))
def yaw_rate_that_is_wrong_two_seconds_after_a_contact(d: Draft) -> None:
    _touch(d, BRAKE, 20)
    d.set("observations", "yaw_rate_radps", 1.2, rollout_id=BRAKE, tick=[60, 65])


@boundary("BD-MOT-002")
def yaw_rate_that_is_wrong_two_seconds_from_a_contact_on(d: Draft) -> None:
    _touch(d, BRAKE, 20)
    d.set("observations", "yaw_rate_radps", 1.2, rollout_id=BRAKE, tick=[55, 60])


@mutant("BD-MOT-003", at=observed_at("accel_longitudinal_mps2", 0))
def acceleration_of_the_tick_to_come(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", 0.5, rollout_id=BRAKE, tick=0)


@mutant("BD-MOT-003", at=observed_at("yaw_rate_radps", 0))
def yaw_rate_before_the_first_tick(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", 0.01, rollout_id=BRAKE, tick=0)


@mutant("BD-MOT-003", at=observed_at("accel_lateral_mps2", 50))
def acceleration_without_a_turn(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", -16.0, rollout_id=BRAKE, tick=50)


@mutant("BD-MOT-003", at=observed_at("accel_longitudinal_mps2", 50))
def acceleration_without_a_change_of_speed(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", 17.0, rollout_id=BRAKE, tick=50)


@boundary("BD-MOT-003")
def acceleration_of_an_emergency_stop(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", -13.0, rollout_id=BRAKE, tick=50)


@mutant("BD-MOT-004", at={"table": "evidence", "column": "collision", "rollout_id": BRAKE, "tick": 0})
def drive_that_begins_in_contact(d: Draft) -> None:
    _touch(d, BRAKE, 0)


@mutant("BD-MOT-004", at={"table": "evidence", "column": "collision", "rollout_id": BRAKE, "tick": 25})
def history_in_contact(d: Draft) -> None:
    """Of its observations, those from the 65th tick on are judged but for the last."""
    _touch(d, BRAKE, 25)


@boundary("BD-MOT-004")
def first_half_of_a_history_in_contact(d: Draft) -> None:
    _touch(d, BRAKE, 5, 10, 15, 20)


def _touch_all_but(d: Draft, number: int) -> None:
    """Let all attempts but the last ones touch something static, once, after the branch."""
    d.set("evidence", "collision", False)
    d.set("rollouts", COUNTS, 0)
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist()[: -number or None]:
        _touch(d, rollout_id, 150)


@mutant("BD-MOT-005", at={"table": "evidence", "column": "collision"})
def contacts_in_all_attempts(d: Draft) -> None:
    _touch_all_but(d, 0)


@boundary("BD-MOT-005")
def contacts_in_eight_of_nine_attempts(d: Draft) -> None:
    _touch_all_but(d, 8)


# Several places: what violates a rule is counted


@mutant("BD-MOT-001", at={"rollout_id": FURTHER, "column": "x_m"}, findings=2, lost=2, base="bare")
def speeds_of_two_attempts_in_kilometres_per_hour(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda v: 3.6 * v, rollout_id=BOTH)
