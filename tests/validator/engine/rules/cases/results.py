"""Defects and limits of what attempts report of contacts and of their end."""

from __future__ import annotations

from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    STEER_LEFT,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))


FREE_TICK = 120
"""Nobody is within ten metres of the attempt that cases edit."""


def result_of(column: str) -> dict[str, str]:
    return {"table": "rollouts", "column": column, "rollout_id": BRAKE}


# BD-RES


@mutant("BD-RES-001", at=result_of(COUNTS[0]))
def contact_that_is_not_counted(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=150)


@mutant("BD-RES-001", at=result_of(COUNTS[0]))
def collision_that_nothing_shows(d: Draft) -> None:
    d.set("rollouts", COUNTS[1], 1, rollout_id=BRAKE)


@mutant("BD-RES-001", at={"column": "collision", "rollout_id": STEER_LEFT, "tick": 165})
def overlap_that_nobody_sees(d: Draft) -> None:
    d.set("evidence", "collision", False, rollout_id=STEER_LEFT)
    d.set("rollouts", COUNTS, 0, rollout_id=STEER_LEFT)


@mutant("BD-RES-001", at={"column": "collision", "rollout_id": BRAKE, "tick": FREE_TICK})
def collision_with_somebody_who_is_far(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=FREE_TICK)
    d.set("rollouts", COUNTS[0], 1, rollout_id=BRAKE)


def _hide(d: Draft, unmonitored: str) -> None:
    """Count no collision of the attempt in which a cycle's box overlaps, and say that a kind was not monitored."""
    d.set("rollouts", COUNTS, 0, rollout_id=STEER_LEFT)
    d.set("rollouts", unmonitored, None, rollout_id=STEER_LEFT)


@mutant("BD-RES-001", at={"column": COUNTS[0], "rollout_id": STEER_LEFT})
def contact_beside_a_kind_that_is_not_monitored(d: Draft) -> None:
    _hide(d, COUNTS[2])


@mutant("BD-RES-001", at={"column": "collision", "rollout_id": STEER_LEFT, "tick": 165})
def overlap_beside_a_kind_that_is_not_monitored(d: Draft) -> None:
    _hide(d, COUNTS[2])
    d.set("evidence", "collision", False, rollout_id=STEER_LEFT)


@boundary("BD-RES-001")
def contact_of_a_kind_that_is_not_monitored(d: Draft) -> None:
    _hide(d, COUNTS[0])


@boundary("BD-RES-001", "BD-RES-005")
def collision_with_something_static_before(d: Draft) -> None:
    """Nobody is near the first contact, which is with a thing."""
    d.set("evidence", "collision", True, rollout_id=STEER_LEFT, tick=FREE_TICK)
    d.set("rollouts", COUNTS[2], 1, rollout_id=STEER_LEFT)


@boundary("BD-RES-001")
def overlap_of_two_observations(d: Draft) -> None:
    """Boxes are larger than bodies."""
    d.set("evidence", "collision", False, rollout_id="g0.steer_left_0.05.a1")
    d.set("rollouts", COUNTS, 0, rollout_id="g0.steer_left_0.05.a1")


@boundary("BD-RES-001")
def contact_that_nobody_counts(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=150)
    d.set("rollouts", COUNTS[1], None, rollout_id=BRAKE)


@mutant("BD-RES-001", at={"column": COUNTS[0], "rollout_id": STEER_LEFT})
def cycle_that_is_counted_as_a_pedestrian(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], 0, rollout_id=STEER_LEFT)
    d.set("rollouts", COUNTS[1], 1, rollout_id=STEER_LEFT)


@mutant("BD-RES-002", at=result_of("result_route_fraction"))
def completed_route_that_was_driven_in_part(d: Draft) -> None:
    d.set("rollouts", "result_completion", "completed", rollout_id=BRAKE)


@mutant("BD-RES-002", at=result_of("result_route_fraction"))
def route_fraction_of_the_nominal(d: Draft) -> None:
    d.set("rollouts", "result_route_fraction", 1.0, rollout_id=BRAKE)


@boundary("BD-RES-002")
def route_fraction_to_a_goal_before_the_end(d: Draft) -> None:
    d.set("rollouts", "result_route_fraction", lambda v: v + 0.2, rollout_id=BRAKE)


@mutant("BD-RES-002", at=result_of("result_completion"))
def blocked_and_driving(d: Draft) -> None:
    d.set("rollouts", "result_completion", "blocked", rollout_id=BRAKE)


@mutant("BD-RES-002", at=result_of("result_completion"))
def deviated_along_the_route(d: Draft) -> None:
    d.set("rollouts", "result_completion", "deviated", rollout_id=BRAKE)


@boundary("BD-RES-002", base="bare")
def blocked_until_somebody_pushes(d: Draft) -> None:
    """The last two seconds are eight observations."""
    d.set("rollouts", "result_completion", "blocked", rollout_id=BRAKE)
    d.set("observations", "speed_mps", 0.5, rollout_id=BRAKE, tick=165)


# BD-RES-005


@mutant("BD-RES-005", at=result_of(COUNTS[0]))
def one_collision_for_two_contacts(d: Draft) -> None:
    """The second begins after a second and a quarter without one."""
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=[FREE_TICK, FREE_TICK + 30])
    d.set("rollouts", COUNTS[2], 1, rollout_id=BRAKE)


@mutant("BD-RES-005", at={"column": COUNTS[0], "rollout_id": STEER_LEFT})
def collision_that_is_counted_at_every_tick(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], 15, rollout_id=STEER_LEFT)


@mutant("BD-RES-005", at=result_of(COUNTS[0]))
def thing_that_is_counted_as_the_cycle_behind(d: Draft) -> None:
    """It is 4.6 m away, and no nearer a quarter second later."""
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=20)
    d.set("rollouts", COUNTS[0], 1, rollout_id=BRAKE)


@boundary("BD-RES-005")
def vehicle_that_is_as_near_and_comes_fast(d: Draft) -> None:
    """It is 4.2 m away at 10 m/s, and 2.0 m at 11 m/s a quarter second later."""
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=165)
    d.set("rollouts", COUNTS[0], 1, rollout_id=BRAKE)


@boundary("BD-RES-005")
def contact_again_within_a_second(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=[FREE_TICK, FREE_TICK + 25])
    d.set("rollouts", COUNTS[2], 1, rollout_id=BRAKE)


@boundary("BD-RES-005")
def contacts_that_are_not_all_monitored(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=[FREE_TICK, FREE_TICK + 30])
    d.set("rollouts", COUNTS[2], 1, rollout_id=BRAKE)
    d.set("rollouts", COUNTS[1], None, rollout_id=BRAKE)


# Several places: what violates a rule is counted


@mutant("BD-RES-001", at={"rollout_id": FURTHER}, findings=2, lost=2)
def contacts_of_two_attempts_that_are_not_counted(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BOTH, tick=150)
