"""One defect in several places: what violates a rule is counted, however few of the places a report keeps.

An attempt is counted once, however many of its rows are wrong; rows are counted one by one.
"""

from __future__ import annotations

import math
from pathlib import Path

from tests.synthetic import BRANCH_TICK, MEDIA_FILE
from tests.validator.engine.rules.case import ACCELERATE, BRAKE, REPLAY, SHARD_0, SHARD_1, STEER_LEFT, mutant
from tests.validator.engine.rules.draft import Draft

FURTHER = "g2.brake_0.50.a1"
"""An attempt of the other shard."""

BOTH = [BRAKE, FURTHER]
MIDDLE = BRANCH_TICK + 25
AT = {"rollout_id": BRAKE}
AT_FURTHER = {"rollout_id": FURTHER}


def _flip(root: Path, path: str) -> None:
    content = bytearray((root / path).read_bytes())
    content[7] ^= 1
    (root / path).write_bytes(content)


# Files


@mutant("BD-LAY-002", base="media", at={"file": f"{SHARD_1}/{MEDIA_FILE}"}, findings=2)
def media_of_two_shards_flipped(d: Draft) -> None:
    d.after_seal(lambda root: [_flip(root, f"{shard}/{MEDIA_FILE}") for shard in (SHARD_0, SHARD_1)])


@mutant("BD-LAY-004", base="media", at={"file": f"{SHARD_1}/late.bin"}, findings=2)
def files_of_two_shards_that_came_late(d: Draft) -> None:
    d.after_seal(lambda root: [(root / shard / "late.bin").write_bytes(b"late") for shard in (SHARD_0, SHARD_1)])


@mutant("BD-TAB-002", at={"file": f"{SHARD_1}/controls.parquet", "column": "applied_steer"}, findings=2)
def two_columns_missing(d: Draft) -> None:
    d.map_table("controls", lambda rows: rows.drop_columns(["applied_brake", "applied_steer"]), folder=SHARD_1)


# Rows


@mutant("BD-VAL-001", at={**AT, "tick": 5}, findings=5)
def numbers_missing_in_five_rows_of_two_attempts(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", math.nan, rollout_id=BRAKE, tick=[5, 10, 15])
    d.set("observations", "accel_lateral_mps2", math.nan, rollout_id=FURTHER, tick=[5, 10])


@mutant("BD-VAL-002", at={**AT_FURTHER, "tick": 0}, findings=402)
def every_brake_of_two_attempts_in_percent(d: Draft) -> None:
    d.set("controls", "expert_brake", 50.0, rollout_id=BOTH)


@mutant("BD-BOX-001", at={**AT_FURTHER, "column": "ego_width_m"}, findings=2)
def two_egos_without_width(d: Draft) -> None:
    d.set("rollouts", "ego_width_m", 0.0, rollout_id=BOTH)


@mutant("BD-NUL-001", at={**AT_FURTHER, "tick": BRANCH_TICK}, findings=2)
def two_speeds_missing(d: Draft) -> None:
    d.set("observations", "speed_mps", None, rollout_id=BOTH, tick=BRANCH_TICK)


@mutant("BD-NUL-004", at={**AT_FURTHER, "column": "status_reason"}, findings=2)
def reasons_of_two_complete_attempts(d: Draft) -> None:
    d.set("rollouts", "status_reason", "went well", rollout_id=BOTH)


@mutant("BD-KEY-004", at={"table": "controls", "rollout_id": "nobody"}, findings=201)
def more_rows_of_nobody_than_a_report_keeps(d: Draft) -> None:
    d.duplicate("controls", {"rollout_id": "nobody"}, rollout_id=BRAKE)


@mutant("BD-KEY-005", at={**AT_FURTHER, "column": "nominal_rollout_id"}, findings=2)
def two_nominals_that_do_not_exist(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", "nobody", rollout_id=BOTH)


@mutant("BD-KEY-006", at={**AT_FURTHER, "tick": BRANCH_TICK}, findings=2)
def evidence_of_two_attempts_twice(d: Draft) -> None:
    d.duplicate("evidence", rollout_id=BOTH, tick=BRANCH_TICK)


@mutant("BD-FRM-002", base="media", at={**AT_FURTHER, "camera": "rear"}, findings=2)
def checksums_of_two_other_images(d: Draft) -> None:
    d.set("frames", "checksum", "0" * 16, rollout_id=BOTH, camera="rear", tick=BRANCH_TICK)


# Attempts


@mutant("BD-STA-001", at={"rollout_id": "g2.nominal_replay.a1"}, findings=2, lost=0)
def two_replays_that_the_collector_distrusts(d: Draft) -> None:
    for replay in (REPLAY, "g2.nominal_replay.a1"):
        d.set("rollouts", "status", "quarantined", rollout_id=replay)
        d.set("rollouts", "status_reason", "the server lagged", rollout_id=replay)


@mutant("BD-TIC-001", at={**AT_FURTHER, "tick": 11}, findings=2, lost=2)
def ticks_missing_in_two_attempts(d: Draft) -> None:
    for rollout_id in BOTH:
        d.drop("controls", rollout_id=rollout_id, tick=10)
        d.recount(rollout_id)


@mutant("BD-CTL-008", at={**AT_FURTHER, "tick": MIDDLE}, findings=3, lost=2)
def commands_of_three_attempts_not_applied(d: Draft) -> None:
    for rollout_id in (*BOTH, STEER_LEFT):
        ticks = range(MIDDLE, MIDDLE + 3)
        d.set("controls", "applied_brake", lambda brake: 0.9 - brake / 2, rollout_id=rollout_id, tick=ticks)


@mutant("BD-CTL-009", at={**AT_FURTHER, "tick": 3}, findings=2, lost=2)
def experts_of_two_attempts_not_obeyed(d: Draft) -> None:
    d.set("controls", "applied_steer", 0.25, rollout_id=BOTH, tick=3)


@mutant("BD-EVD-001", at={**AT_FURTHER, "tick": BRANCH_TICK}, findings=2, lost=2)
def separations_of_two_attempts_between_centres(d: Draft) -> None:
    d.set("evidence", "separation_m", lambda gap: gap + 4.0, rollout_id=BOTH, tick=BRANCH_TICK)


@mutant("BD-RTE-001", at={**AT_FURTHER, "tick": BRANCH_TICK}, findings=3, lost=2)
def progress_of_three_front_bumpers(d: Draft) -> None:
    attempts = [*BOTH, ACCELERATE]
    d.set("observations", "route_progress_m", lambda v: v + 2.25, rollout_id=attempts, tick=BRANCH_TICK)


@mutant("BD-MOT-001", at={**AT_FURTHER, "column": "x_m"}, findings=2, lost=2, base="bare")
def speeds_of_two_attempts_in_kilometres_per_hour(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda v: 3.6 * v, rollout_id=BOTH)


@mutant("BD-ACT-001", at={"rollout_id": ACCELERATE, "actor_id": 7}, findings=2)
def actor_that_grows_in_two_attempts(d: Draft) -> None:
    d.set("actors", "height_m", lambda v: v + 1, rollout_id=[BRAKE, ACCELERATE], actor_id=7, tick=BRANCH_TICK)


@mutant("BD-RES-001", at=AT_FURTHER, findings=2, lost=2)
def contacts_of_two_attempts_that_are_not_counted(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BOTH, tick=150)


@mutant("BD-TRG-001", at=AT_FURTHER, findings=2, lost=2)
def triggers_read_from_two_interventions(d: Draft) -> None:
    for rollout_id in BOTH:
        d.set("rollouts", "trigger_rollout_id", rollout_id, rollout_id=rollout_id)


# Groups


@mutant("BD-GRP-003", at={"group_id": "g2", "column": "seed"}, findings=2, lost=2)
def other_seeds_in_two_groups(d: Draft) -> None:
    d.set("rollouts", "seed", lambda seed: seed + 1, rollout_id=[*BOTH, STEER_LEFT])


@mutant("BD-BNK-001", at={"group_id": "g2"}, findings=2, lost=2)
def actions_missing_in_two_groups(d: Draft) -> None:
    for rollout_id in BOTH:
        d.drop_attempt(rollout_id)
