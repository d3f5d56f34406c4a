"""Defects and limits of extents: of the ego, of actors by their class, and of vehicles over the whole dataset."""

from __future__ import annotations

from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import BRAKE, boundary, mutant
from tests.validator.engine.rules.draft import Draft

FIRST = BRANCH_TICK - 75
"""Tick at which tracks begin."""


def _actor(column: str, actor_id: int) -> dict[str, str | int]:
    return {"table": "actors", "column": column, "rollout_id": BRAKE, "tick": FIRST, "actor_id": actor_id}


# BD-BOX-002


@mutant("BD-BOX-002", at=_actor("length_m", 4))
def pedestrian_of_eight_metres(d: Draft) -> None:
    d.set("actors", "length_m", 8.0, rollout_id=BRAKE, actor_id=4)
    d.refresh_evidence(BRAKE)


@mutant("BD-BOX-002", at=_actor("height_m", 4))
def pedestrian_as_tall_as_a_house(d: Draft) -> None:
    d.set("actors", "height_m", 6.0, rollout_id=BRAKE, actor_id=4)


@mutant("BD-BOX-002", at=_actor("width_m", 3))
def cycle_without_width(d: Draft) -> None:
    d.set("actors", "width_m", 0.05, rollout_id=BRAKE, actor_id=3)
    d.refresh_evidence(BRAKE)


@mutant("BD-BOX-002", at={"table": "rollouts", "column": "ego_height_m", "rollout_id": BRAKE}, findings=15)
def ego_as_high_as_long(d: Draft) -> None:
    d.set("rollouts", "ego_height_m", 6.5, group_id="g0")


@boundary("BD-BOX-002")
def road_train_and_barrier(d: Draft) -> None:
    d.set("actors", "length_m", 60.0, rollout_id=BRAKE, actor_id=7)
    d.set("actors", ("width_m", "height_m"), 6.0, rollout_id=BRAKE, actor_id=7)
    d.set("actors", "length_m", 0.01, rollout_id=BRAKE, actor_id=6)
    d.set("actors", "height_m", 20.0, rollout_id=BRAKE, actor_id=6)
    d.refresh_evidence(BRAKE)


# BD-BOX-003


@mutant("BD-BOX-003", at={"table": "rollouts", "column": "ego_width_m"}, base="bare")
def half_extents_of_the_ego(d: Draft) -> None:
    d.set("rollouts", ("ego_length_m", "ego_width_m", "ego_height_m"), lambda extent: extent / 2)


@mutant("BD-BOX-003", at={"table": "rollouts", "column": "ego_width_m"}, base="bare")
def length_and_width_of_the_ego_swapped(d: Draft) -> None:
    d.set("rollouts", "ego_width_m", 4.5)
    d.set("rollouts", "ego_length_m", 1.875)


@mutant("BD-BOX-003", at={"table": "actors", "column": "width_m"})
def half_extents_of_vehicles(d: Draft) -> None:
    d.set("actors", ("length_m", "width_m", "height_m"), lambda extent: extent / 2, actor_class="vehicle")
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist():
        d.refresh_evidence(rollout_id)


@boundary("BD-BOX-003", base="bare")
def quadricycles(d: Draft) -> None:
    d.set("rollouts", "ego_width_m", 1.2)


@boundary("BD-BOX-003", base="bare")
def narrow_ego_of_two_groups(d: Draft) -> None:
    d.set("rollouts", "ego_width_m", 0.8, group_id=["g0", "g1"])
