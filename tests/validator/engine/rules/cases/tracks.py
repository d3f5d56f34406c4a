"""Defects and limits of tracks of actors."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK, EGO_BOX_M, to_table
from tests.validator.engine.rules.case import (
    ACCELERATE,
    BRAKE,
    SHARD_0,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import on_grid

COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))


def observed_at(column: str, tick: int) -> dict[str, str | int]:
    return {"table": "observations", "column": column, "rollout_id": BRAKE, "tick": tick}


def _actor(column: str, tick: int, actor_id: int) -> dict[str, str | int]:
    return {"table": "actors", "column": column, "rollout_id": BRAKE, "tick": tick, "actor_id": actor_id}


def _refresh(d: Draft) -> None:
    """Evidence of the actors as they are now; nothing is touched that was not."""
    d.refresh_evidence(BRAKE)
    d.set("evidence", "collision", False, rollout_id=BRAKE)
    d.set("rollouts", COUNTS, 0, rollout_id=BRAKE)


# BD-ACT


@mutant("BD-ACT-001", at=_actor("actor_class", BRANCH_TICK, 3))
def cycle_that_becomes_a_vehicle(d: Draft) -> None:
    d.set("actors", "actor_class", "vehicle", rollout_id=BRAKE, actor_id=3, tick=range(BRANCH_TICK, 201))


@mutant("BD-ACT-001", at=_actor("height_m", BRANCH_TICK, 7))
def actor_that_grows(d: Draft) -> None:
    d.set("actors", "height_m", lambda v: v + 1, rollout_id=BRAKE, actor_id=7, tick=BRANCH_TICK)


@boundary("BD-ACT-001")
def actor_that_grows_outside_the_windows(d: Draft) -> None:
    d.set("actors", "height_m", lambda v: v + 1, rollout_id=BRAKE, actor_id=7, tick=BRANCH_TICK + 55)


@mutant("BD-ACT-002", at=_actor("x_m", BRANCH_TICK - 75, 99))
def ego_among_the_actors(d: Draft) -> None:
    rows = d.take("observations", rollout_id=BRAKE)
    count, speed, yaw = len(rows), rows["speed_mps"].to_numpy(), rows["yaw_rad"].to_numpy()
    box = dict(zip(("length_m", "width_m", "height_m"), np.tile(np.array(EGO_BOX_M)[:, None], count), strict=True))
    columns = {
        **{name: rows[name].to_pylist() for name in ("rollout_id", "tick", "x_m", "y_m", "yaw_rad")}, **box,
        "actor_id": [99] * count, "actor_class": ["vehicle"] * count,
        "vel_x_mps": on_grid(speed * np.cos(yaw)), "vel_y_mps": on_grid(speed * np.sin(yaw)),
    }  # fmt: skip
    d.append("actors", to_table("actors", columns), folder=SHARD_0)
    _refresh(d)
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)


@mutant("BD-ACT-002", at=_actor("x_m", BRANCH_TICK - 75, 99))
def ego_with_the_extents_of_a_data_sheet(d: Draft) -> None:
    ego_among_the_actors(d)
    d.set("actors", ("length_m", "width_m"), lambda v: v + 0.02, rollout_id=BRAKE, actor_id=99)
    d.set("actors", "x_m", lambda v: v + 0.2, rollout_id=BRAKE, actor_id=99)
    _refresh(d)
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)


@mutant("BD-ACT-002", at=_actor("actor_id", BRANCH_TICK - 75, 98))
def actor_under_two_ids(d: Draft) -> None:
    d.duplicate("actors", {"actor_id": 98}, rollout_id=BRAKE, actor_id=1)
    _refresh(d)


@mutant("BD-ACT-002", at=_actor("actor_id", BRANCH_TICK - 75, 98))
def actor_nearly_under_two_ids(d: Draft) -> None:
    """The copy is a little shorter, turned, and stands a little beside the actor."""
    d.duplicate("actors", {"actor_id": 98}, rollout_id=BRAKE, actor_id=1)
    for column, change in (("x_m", 0.09), ("y_m", -0.09), ("length_m", -0.09), ("yaw_rad", 0.01)):
        d.set("actors", column, lambda v, change=change: v + change, rollout_id=BRAKE, actor_id=98)
    _refresh(d)


@boundary("BD-ACT-002")
def actors_that_stand_close_together(d: Draft) -> None:
    d.duplicate("actors", {"actor_id": 98}, rollout_id=BRAKE, actor_id=1)
    d.set("actors", "y_m", lambda v: v + 0.11, rollout_id=BRAKE, actor_id=98)
    d.duplicate("actors", {"actor_id": 99, "actor_class": "static"}, rollout_id=BRAKE, actor_id=1)
    d.set("actors", "x_m", lambda v: v + 0.05, rollout_id=BRAKE, actor_id=99)
    _refresh(d)


@boundary("BD-ACT-002", "BD-ACT-001", "BD-ACT-003")
def cars_of_one_make_in_any_order(d: Draft) -> None:
    for column, extent in zip(("length_m", "width_m", "height_m"), EGO_BOX_M, strict=True):
        d.set("actors", column, extent, rollout_id=BRAKE, actor_id=[1, 2])
    d.map_table("actors", lambda rows: rows.take(pa.array(np.arange(len(rows))[::-1])), folder=SHARD_0)
    _refresh(d)


@mutant("BD-ACT-003", at=_actor("actor_id", BRANCH_TICK, 1))
def actor_that_blinks(d: Draft) -> None:
    d.drop("actors", rollout_id=BRAKE, actor_id=1, tick=[BRANCH_TICK - 10, BRANCH_TICK - 5])
    _refresh(d)


@boundary("BD-ACT-003")
def actor_out_of_range_that_blinks(d: Draft) -> None:
    d.drop("actors", rollout_id=BRAKE, actor_id=7, tick=BRANCH_TICK - 75 + 5)
    _refresh(d)


def _stand(d: Draft, actor_id: int) -> None:
    """Let an actor stand where it is at the branch."""
    for column in ("x_m", "y_m"):
        d.set("actors", column, d.value("actors", column, rollout_id=BRAKE, actor_id=actor_id, tick=BRANCH_TICK),
              rollout_id=BRAKE, actor_id=actor_id)  # fmt: skip
    d.set("actors", ("vel_x_mps", "vel_y_mps"), 0.0, rollout_id=BRAKE, actor_id=actor_id)


@mutant("BD-ACT-003", at=_actor("actor_id", BRANCH_TICK + 25, 4))
def standing_actor_that_is_away_for_three_seconds(d: Draft) -> None:
    _stand(d, 4)
    d.drop("actors", rollout_id=BRAKE, actor_id=4, tick=range(BRANCH_TICK - 35, BRANCH_TICK + 25))
    _refresh(d)


@boundary("BD-ACT-003", "BD-ACT-005")
def actor_near_the_limit_of_the_range_that_is_away_for_three_seconds(d: Draft) -> None:
    x_m = d.value("observations", "x_m", rollout_id=BRAKE, tick=BRANCH_TICK)
    d.set("actors", "x_m", x_m, rollout_id=BRAKE, actor_id=7)
    d.set("actors", "y_m", 46.0, rollout_id=BRAKE, actor_id=7)
    d.drop("actors", rollout_id=BRAKE, actor_id=7, tick=range(BRANCH_TICK - 35, BRANCH_TICK + 25))
    _refresh(d)


def _another(d: Draft, away_m: float) -> None:
    """Let an oncoming vehicle leave, and give its id after two seconds to one that is as far from its way."""
    first, last = BRANCH_TICK - 75, BRANCH_TICK + 50
    d.drop("actors", rollout_id=BRAKE, actor_id=7, tick=range(first + 5, first + 45))
    d.set("actors", "y_m", lambda v: v + away_m, rollout_id=BRAKE, actor_id=7, tick=range(first + 45, last + 5))
    _refresh(d)


@mutant("BD-ACT-005", at=_actor("actor_id", BRANCH_TICK - 30, 7))
def id_of_somebody_who_left(d: Draft) -> None:
    _another(d, 20.0)


@boundary("BD-ACT-005")
def actor_that_moves_out_of_range(d: Draft) -> None:
    _another(d, 10.0)


@mutant("BD-ACT-004", at=_actor("vel_x_mps", BRANCH_TICK - 70, 2))
def actor_velocity_in_kilometres_per_hour(d: Draft) -> None:
    d.set("actors", ("vel_x_mps", "vel_y_mps"), lambda v: 3.6 * v, rollout_id=BRAKE, actor_id=2)
    _refresh(d)


@boundary("BD-ACT-004")
def actor_velocity_at_the_bound(d: Draft) -> None:
    """Of somebody who stands, whose steps say nothing of a speed."""
    d.set("actors", "vel_y_mps", lambda v: v + 3.9, rollout_id=BRAKE, actor_id=4)
    _refresh(d)


# Several places: what violates a rule is counted


@mutant("BD-ACT-001", at={"rollout_id": ACCELERATE, "actor_id": 7}, findings=2)
def actor_that_grows_in_two_attempts(d: Draft) -> None:
    d.set("actors", "height_m", lambda v: v + 1, rollout_id=[BRAKE, ACCELERATE], actor_id=7, tick=BRANCH_TICK)


# BD-ACT-008: in the second group, a pedestrian is there from tick 130 to tick 190.

ALONE = "g1.brake_0.50.a1"


def _brake_for_pedestrians(d: Draft, rollout_id: str, *ticks: int) -> None:
    d.set("observations", "pedestrian_hazard", False, rollout_id=rollout_id)
    d.set("observations", "pedestrian_hazard", True, rollout_id=rollout_id, tick=ticks)


@mutant("BD-ACT-008", at={**observed_at("pedestrian_hazard", 100), "rollout_id": ALONE}, lost=0)
def brakes_for_a_pedestrian_where_none_is(d: Draft) -> None:
    _brake_for_pedestrians(d, ALONE, 100, 105, 125)


@boundary("BD-ACT-008")
def brakes_for_a_pedestrian_before_one_is_there(d: Draft) -> None:
    _brake_for_pedestrians(d, ALONE, 125, 130)


@boundary("BD-ACT-008")
def brakes_for_a_pedestrian_before_the_window(d: Draft) -> None:
    _brake_for_pedestrians(d, ALONE, BRANCH_TICK - 80)
