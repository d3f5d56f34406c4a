"""Defects and limits of what interventions do, over the whole dataset."""

from __future__ import annotations

from collections.abc import Callable

import pyarrow as pa
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import NOMINAL, REPLAY, boundary, mutant
from tests.validator.engine.rules.draft import Draft

Row = dict[str, object]


def _like_nominal(d: Draft, copies: Callable[[Row], bool]) -> None:
    """Give observations of interventions the values of their nominal's at the same tick."""
    for shard in d.tables.values():
        record = {row["rollout_id"]: row for row in shard["rollouts"].to_pylist()}
        rows = shard["observations"].to_pylist()
        values = {(row["rollout_id"], row["tick"]): row for row in rows}
        for i, row in enumerate(rows):
            attempt = record[row["rollout_id"]]
            if attempt["role"] == "intervention" and copies({**attempt, **row}):
                own = {"rollout_id": row["rollout_id"]}
                rows[i] = {**values[attempt["nominal_rollout_id"], row["tick"]], **own}
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


# BD-RSP-001


_LATERAL = (
    "y_m", "yaw_rad", "accel_lateral_mps2", "yaw_rate_radps", "route_offset_m", "route_heading_error_rad",
    "target_point_1_y_m", "target_point_2_y_m",
)  # fmt: skip


def _mirror(d: Draft, **where: object) -> None:
    """Turn the world left to right, and leave the steering command as it is."""
    ids = d.take("rollouts", **where)["rollout_id"].to_pylist()
    d.set("observations", _LATERAL, lambda value: -value, rollout_id=ids)
    d.set("rollouts", "route_y_m", lambda ys: [-y for y in ys], rollout_id=ids)


@mutant("BD-RSP-001", base="bare", at={"column": "applied_steer"})
def mirrored_world(d: Draft) -> None:
    _mirror(d)


@boundary("BD-RSP-001", base="bare")
def group_of_a_mirrored_world(d: Draft) -> None:
    """What one of three groups shows refutes nothing."""
    _mirror(d, group_id="g0")


# BD-RSP-002


@mutant("BD-RSP-002", base="bare", at={"action_key": "brake_1.00"})
def command_that_does_nothing(d: Draft) -> None:
    _like_nominal(d, lambda row: row["action_key"] == "brake_1.00")


@mutant(
    "BD-RSP-002", base="bare", at={"action_key": "accelerate_0.30"}, findings=11
)  # one steers like the nominal in a curve
def commands_are_ignored(d: Draft) -> None:
    """All but one: in a curve, the nominal steers like `steer_right_0.05`."""
    _like_nominal(d, lambda row: True)


@boundary("BD-RSP-002", base="bare")
def command_that_does_nothing_in_two_of_three_groups(d: Draft) -> None:
    _like_nominal(d, lambda row: row["action_key"] == "brake_1.00" and row["group_id"] != "g0")


# BD-RSP-003, BD-RSP-004


@boundary("BD-RSP-003", "BD-RSP-004", base="bare")
def responses_at_the_first_observation_after_the_branch(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)


@mutant("BD-RSP-003", base="bare", at={"table": "observations"})
def observation_after_the_control(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) < BRANCH_TICK)


@mutant("BD-RSP-004", base="bare", at={"table": "observations"})
def observation_a_stride_late(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK + 5)


# BD-RSP-005


@mutant("BD-RSP-005", base="bare", at={"group_id": "g9"})
def group_under_two_names(d: Draft) -> None:
    for row in d.take("rollouts", group_id="g0").to_pylist():
        renamed = {
            name: f"g9{value[2:]}"
            for name in ("nominal_rollout_id", "trigger_rollout_id")
            if (value := row[name]) is not None
        }
        d.copy_attempt(row["rollout_id"], f"g9{row['rollout_id'][2:]}", group_id="g9", **renamed)


@boundary("BD-RSP-005", base="bare")
def replay_that_repeats_its_nominal(d: Draft) -> None:
    """Replays of a world without noise are equal to their nominal: that is what they are for."""
    for shard in d.tables.values():
        rows = shard["observations"].to_pylist()
        nominal = {row["tick"]: row for row in rows if row["rollout_id"] == NOMINAL}
        for i, row in enumerate(rows):
            if row["rollout_id"] == REPLAY:
                rows[i] = {**nominal[row["tick"]], "rollout_id": REPLAY}
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


# BD-RSP-006


@mutant("BD-RSP-006", base="bare", at={"table": "observations"}, findings=2)
def speed_in_another_unit(d: Draft) -> None:
    """These vehicles are slow; of faster ones, nearly all fail where km/h are taken for m/s."""
    kinds = ("vehicle", "pedestrian", "static")
    d.set("rollouts", tuple(f"result_num_{kind}_collisions" for kind in kinds), 0)
    d.set("observations", "speed_mps", lambda speed: 8 * speed)


@boundary("BD-RSP-006", base="bare")
def speedometer_that_shows_too_much(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda speed: 1.05 * speed)
