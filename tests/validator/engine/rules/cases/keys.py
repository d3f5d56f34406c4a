"""Defects and limits of identities, references, counts and the order of rows."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from tests.synthetic import BRANCH_TICK, Tables, make_group
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    REPLAY,
    SHARD_0,
    SHARD_1,
    STEER_LEFT,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import TICK_TABLES

OTHER_NOMINAL = "g1.nominal.a1"


def _record(rollout_id: str, column: str) -> dict[str, Any]:
    return {"table": "rollouts", "column": column, "rollout_id": rollout_id}


def _renamed(tables: Tables, suffix: str) -> Tables:
    """The same attempts under other identities."""
    renamed = {}
    for name, rows in tables.items():
        for column in ("rollout_id", "nominal_rollout_id", "trigger_rollout_id"):
            if column in rows.column_names:
                place = rows.schema.get_field_index(column)
                rows = rows.set_column(
                    place, rows.schema.field(place), pc.binary_join_element_wise(rows[column], suffix, "")
                )
        renamed[name] = rows
    return renamed


# BD-KEY-001


@mutant("BD-KEY-001", at={"table": "rollouts", "rollout_id": REPLAY})
def identity_used_in_two_shards(d: Draft) -> None:
    for table in ("rollouts", *TICK_TABLES):
        d.set(table, "rollout_id", REPLAY, rollout_id="g2.nominal_replay.a1")


@mutant("BD-KEY-001", at={"table": "rollouts", "rollout_id": BRAKE})
def identity_of_a_candidate_used_in_two_shards(d: Draft) -> None:
    for table in ("rollouts", *TICK_TABLES):
        d.set(table, "rollout_id", BRAKE, rollout_id="g2.brake_0.50.a1")


@boundary("BD-KEY-001", "BD-KEY-004")
def identities_that_differ_in_their_last_character(d: Draft) -> None:
    d.copy_attempt(REPLAY, f"{REPLAY}.", attempt=3)
    d.copy_attempt(REPLAY, f"{REPLAY}-", attempt=4)


# BD-KEY-002


@mutant("BD-KEY-002", at=_record(REPLAY, "attempt"), findings=2)
def two_attempts_with_one_number(d: Draft) -> None:
    d.set("rollouts", "attempt", 1, rollout_id="g0.nominal_replay.a2")


@boundary("BD-KEY-002", "BD-BNK-001")
def retry_with_the_next_number(d: Draft) -> None:
    d.copy_attempt(BRAKE, "g0.brake_0.50.a2", attempt=2)


@boundary("BD-KEY-002")
def same_number_under_another_protocol(d: Draft) -> None:
    d.copy_attempt(BRAKE, "g0.brake_0.50.v2.a1", protocol_variant="v2")


# BD-KEY-003


@mutant("BD-KEY-003", at={"group_id": "g0"})
def group_repeated_in_another_shard(d: Draft) -> None:
    repeated = _renamed(make_group(0), ".again")
    place = repeated["rollouts"].schema.get_field_index("attempt")
    later = pc.add(repeated["rollouts"]["attempt"], 10).cast(pa.int32())
    repeated["rollouts"] = repeated["rollouts"].set_column(place, repeated["rollouts"].schema.field(place), later)
    for table, rows in repeated.items():
        d.append(table, rows, folder=SHARD_1)


@boundary("BD-KEY-003", "BD-KEY-004")
def groups_interleaved_in_one_shard(d: Draft) -> None:
    d.map_table("rollouts", lambda rows: rows.take(pc.sort_indices(rows["action_key"])), folder=SHARD_0)
    for table in TICK_TABLES:
        d.map_table(table, lambda rows: rows.take(pc.sort_indices(rows["tick"])), folder=SHARD_0)


# BD-KEY-004


@mutant("BD-KEY-004", at={"table": "controls", "rollout_id": "g0.ghost.a1", "tick": 3})
def control_of_nobody(d: Draft) -> None:
    d.duplicate("controls", {"rollout_id": "g0.ghost.a1"}, rollout_id=BRAKE, tick=3)


@mutant("BD-KEY-004", at={"table": "actors", "rollout_id": OTHER_NOMINAL, "actor_id": 2}, findings=1)
def actor_of_a_rollout_in_another_shard(d: Draft) -> None:
    row = d.take("actors", rollout_id=OTHER_NOMINAL, tick=50, actor_id=2)
    d.append("actors", row, folder=SHARD_1)


@mutant("BD-KEY-004", at={"table": "frames", "rollout_id": "g0.ghost.a1"}, base="media", findings=6)
def images_of_nobody(d: Draft) -> None:
    d.duplicate("frames", {"rollout_id": "g0.ghost.a1"}, rollout_id=NOMINAL, tick=BRANCH_TICK)


# BD-KEY-005


@mutant("BD-KEY-005", at=_record(BRAKE, "nominal_rollout_id"))
def nominal_that_does_not_exist(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", "g0.nominal.a9", rollout_id=BRAKE)


@mutant("BD-KEY-005", at=_record(BRAKE, "nominal_rollout_id"))
def nominal_of_another_group(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", OTHER_NOMINAL, rollout_id=BRAKE)


@mutant("BD-KEY-005", at=_record(BRAKE, "nominal_rollout_id"))
def nominal_that_is_an_intervention(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", STEER_LEFT, rollout_id=BRAKE)


@mutant("BD-KEY-005", at=_record(BRAKE, "nominal_rollout_id"))
def nominal_that_is_a_replay(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", REPLAY, rollout_id=BRAKE)


@boundary("BD-KEY-005", "BD-BNK-002")
def replay_of_a_second_nominal(d: Draft) -> None:
    d.copy_attempt(NOMINAL, "g0.nominal.a2", attempt=2, trigger_rollout_id="g0.nominal.a2")
    d.set("rollouts", ("nominal_rollout_id", "trigger_rollout_id"), "g0.nominal.a2", rollout_id=REPLAY)


# BD-KEY-006


@mutant("BD-KEY-006", at={"table": "evidence", "rollout_id": BRAKE, "tick": BRANCH_TICK})
def evidence_twice(d: Draft) -> None:
    d.duplicate("evidence", rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-KEY-006", at={"table": "actors", "rollout_id": BRAKE, "tick": BRANCH_TICK, "actor_id": 3})
def actor_twice(d: Draft) -> None:
    d.duplicate("actors", rollout_id=BRAKE, tick=BRANCH_TICK, actor_id=3)


@mutant("BD-KEY-006", at={"table": "evidence", "rollout_id": BRAKE, "tick": 3})
def evidence_between_observations(d: Draft) -> None:
    d.duplicate("evidence", {"tick": 3}, rollout_id=BRAKE, tick=5)


@mutant("BD-KEY-006", at={"table": "actors", "rollout_id": BRAKE, "tick": 1005, "actor_id": 3})
def actor_after_the_last_observation(d: Draft) -> None:
    d.duplicate("actors", {"tick": 1005}, rollout_id=BRAKE, tick=100, actor_id=3)


@boundary("BD-KEY-006")
def observation_without_evidence_and_actors(d: Draft) -> None:
    for table in ("evidence", "actors"):
        d.drop(table, rollout_id=BRAKE, tick=0)


@boundary("BD-KEY-006", "BD-EVD-001")
def actors_with_the_largest_identity(d: Draft) -> None:
    d.set("actors", "actor_id", 2**31 - 1, rollout_id=BRAKE, actor_id=1)
    d.refresh_evidence(BRAKE)


# BD-KEY-007


@mutant("BD-KEY-007", at=_record(BRAKE, "num_ticks"))
def control_row_lost(d: Draft) -> None:
    d.drop("controls", rollout_id=BRAKE, tick=200)


@mutant("BD-KEY-007", at=_record(BRAKE, "num_observations"))
def observations_miscounted(d: Draft) -> None:
    d.set("rollouts", "num_observations", lambda count: count + 1, rollout_id=BRAKE)


@boundary("BD-KEY-007", "BD-TIC-001", "BD-TIC-002", "BD-WIN-003")
def recording_that_ends_with_the_window(d: Draft) -> None:
    for table in TICK_TABLES:
        d.drop(table, rollout_id=BRAKE, tick=range(BRANCH_TICK + 51, 201))
    d.recount(BRAKE)


# BD-KEY-008


@mutant("BD-KEY-008", at=_record(REPLAY, "action_key"))
def replay_of_an_intervention(d: Draft) -> None:
    d.set("rollouts", "action_key", "brake_0.30", rollout_id=REPLAY)


@mutant("BD-KEY-008", at=_record(REPLAY, "action_key"))
def key_that_the_bank_lacks(d: Draft) -> None:
    d.set("rollouts", "action_key", "brake_0.40", rollout_id=REPLAY)


@mutant("BD-KEY-008", at=_record("g1.brake_0.50.a2", "action_key"))
def intervention_under_the_nominal_key(d: Draft) -> None:
    d.set("rollouts", "action_key", "nominal", rollout_id="g1.brake_0.50.a2")


@mutant("BD-KEY-008", at=_record("g1.brake_0.50.a2", "action_key"))
def drive_without_a_stream_of_decisions(d: Draft) -> None:
    d.set("rollouts", "role", "drive", rollout_id="g1.brake_0.50.a2")


# BD-TAB-007


def exchanged(rows: pa.Table, first: int, second: int) -> pa.Table:
    """The rows with two of them in each other's place."""
    order = list(range(len(rows)))
    order[first], order[second] = second, first
    return rows.take(order)


@mutant("BD-TAB-007", at={"table": "actors", "column": "actor_id", "tick": 0})
def actors_of_a_moment_in_another_order(d: Draft) -> None:
    d.map_table("actors", lambda rows: exchanged(rows, 0, 1), folder=SHARD_1)


@mutant("BD-TAB-007", at={"table": "rollouts", "column": "rollout_id"})
def attempts_in_another_order(d: Draft) -> None:
    d.map_table("rollouts", lambda rows: exchanged(rows, 3, 4), folder=SHARD_1)


# Several places: what violates a rule is counted


@mutant("BD-KEY-004", at={"table": "controls", "rollout_id": "nobody"}, findings=201)
def more_rows_of_nobody_than_a_report_keeps(d: Draft) -> None:
    d.duplicate("controls", {"rollout_id": "nobody"}, rollout_id=BRAKE)


@mutant("BD-KEY-005", at={"rollout_id": FURTHER, "column": "nominal_rollout_id"}, findings=2)
def two_nominals_that_do_not_exist(d: Draft) -> None:
    d.set("rollouts", "nominal_rollout_id", "nobody", rollout_id=BOTH)


@mutant("BD-KEY-006", at={"rollout_id": FURTHER, "tick": BRANCH_TICK}, findings=2)
def evidence_of_two_attempts_twice(d: Draft) -> None:
    d.duplicate("evidence", rollout_id=BOTH, tick=BRANCH_TICK)
