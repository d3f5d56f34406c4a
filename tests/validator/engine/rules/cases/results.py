"""Defects and limits of what attempts report of their outcome."""

from __future__ import annotations

from tests.validator.engine.rules.case import BRAKE, STEER_LEFT, boundary, mutant
from tests.validator.engine.rules.draft import Draft

COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))
FREE_TICK = 120
"""Nobody is within ten metres of the attempt that cases edit."""
OFF_ROAD, RED, STOP = (f"result_num_{kind}_infractions" for kind in ("off_road", "red_light", "stop_sign"))


def _result(column: str) -> dict[str, str]:
    return {"table": "rollouts", "column": column, "rollout_id": BRAKE}


# BD-RES


@mutant("BD-RES-001", at=_result(COUNTS[0]))
def contact_that_is_not_counted(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=150)


@mutant("BD-RES-001", at=_result(COUNTS[0]))
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


@mutant("BD-RES-002", at=_result("result_route_fraction"))
def completed_route_that_was_driven_in_part(d: Draft) -> None:
    d.set("rollouts", "result_completion", "completed", rollout_id=BRAKE)


@mutant("BD-RES-002", at=_result("result_route_fraction"))
def route_fraction_of_the_nominal(d: Draft) -> None:
    d.set("rollouts", "result_route_fraction", 1.0, rollout_id=BRAKE)


@boundary("BD-RES-002")
def route_fraction_to_a_goal_before_the_end(d: Draft) -> None:
    d.set("rollouts", "result_route_fraction", lambda v: v + 0.2, rollout_id=BRAKE)


@mutant("BD-RES-002", at=_result("result_completion"))
def blocked_and_driving(d: Draft) -> None:
    d.set("rollouts", "result_completion", "blocked", rollout_id=BRAKE)


@mutant("BD-RES-002", at=_result("result_completion"))
def deviated_along_the_route(d: Draft) -> None:
    d.set("rollouts", "result_completion", "deviated", rollout_id=BRAKE)


@boundary("BD-RES-002", base="bare")
def blocked_until_somebody_pushes(d: Draft) -> None:
    """The last two seconds are eight observations."""
    d.set("rollouts", "result_completion", "blocked", rollout_id=BRAKE)
    d.set("observations", "speed_mps", 0.5, rollout_id=BRAKE, tick=165)


# BD-RES-004


@mutant("BD-RES-004", base="full", at=_result(OFF_ROAD))
def departure_that_is_not_counted(d: Draft) -> None:
    d.set("evidence", "on_road", False, rollout_id=BRAKE, tick=[150, 155])


@mutant("BD-RES-004", base="full", at=_result(OFF_ROAD))
def departures_that_are_counted_tick_by_tick(d: Draft) -> None:
    d.set("evidence", "on_road", False, rollout_id=BRAKE, tick=[150, 155])
    d.set("rollouts", OFF_ROAD, 10, rollout_id=BRAKE)


@mutant("BD-RES-004", base="full", at=_result(RED))
def red_light_in_green(d: Draft) -> None:
    _lights(d, "green")
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


@mutant("BD-RES-004", base="map", at=_result(STOP))
def stop_sign_where_the_map_has_none(d: Draft) -> None:
    d.set("rollouts", STOP, 1, rollout_id=BRAKE)


@boundary("BD-RES-004", base="full")
def departures_from_the_start_and_later(d: Draft) -> None:
    d.set("evidence", "on_road", False, rollout_id=BRAKE, tick=[0, 5, 150])
    d.set("rollouts", OFF_ROAD, 2, rollout_id=BRAKE)


@boundary("BD-RES-004", base="full")
def departure_that_nobody_monitors(d: Draft) -> None:
    d.set("evidence", "on_road", False, rollout_id=BRAKE, tick=150)
    d.set("rollouts", OFF_ROAD, None, rollout_id=BRAKE)


@boundary("BD-RES-004", base="full")
def light_that_changes_at_the_line(d: Draft) -> None:
    """Green at the last observation before the line, and red when the front is at it."""
    d.set("evidence", "traffic_light", "green", rollout_id=BRAKE, tick=range(60))
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


# BD-RES-005


@mutant("BD-RES-005", at=_result(COUNTS[0]))
def one_collision_for_two_contacts(d: Draft) -> None:
    """The second begins after a second and a quarter without one."""
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=[FREE_TICK, FREE_TICK + 30])
    d.set("rollouts", COUNTS[2], 1, rollout_id=BRAKE)


@mutant("BD-RES-005", at={"column": COUNTS[1], "rollout_id": STEER_LEFT})
def cycle_that_is_counted_as_a_pedestrian(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], 0, rollout_id=STEER_LEFT)
    d.set("rollouts", COUNTS[1], 1, rollout_id=STEER_LEFT)


@mutant("BD-RES-005", at={"column": COUNTS[0], "rollout_id": STEER_LEFT})
def collision_that_is_counted_at_every_tick(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], 15, rollout_id=STEER_LEFT)


@boundary("BD-RES-005")
def contact_again_within_a_second(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=[FREE_TICK, FREE_TICK + 25])
    d.set("rollouts", COUNTS[2], 1, rollout_id=BRAKE)


@boundary("BD-RES-005")
def contacts_that_are_not_all_monitored(d: Draft) -> None:
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=[FREE_TICK, FREE_TICK + 30])
    d.set("rollouts", COUNTS[2], 1, rollout_id=BRAKE)
    d.set("rollouts", COUNTS[1], None, rollout_id=BRAKE)


# BD-RES-006


def _lights(d: Draft, light: str, last_tick: int = 200) -> None:
    """Show one light from the start to a tick, and none after it."""
    for name, shown, none in (("traffic_light_available", True, False), ("traffic_light", light, None)):
        d.set("evidence", name, none, rollout_id=BRAKE)
        d.set("evidence", name, shown, rollout_id=BRAKE, tick=range(last_tick + 1))


@mutant("BD-RES-006", at=_result(RED))
def red_light_that_is_passed(d: Draft) -> None:
    _lights(d, "red", 50)


@boundary("BD-RES-006")
def red_light_that_is_passed_and_counted(d: Draft) -> None:
    _lights(d, "red", 50)
    d.set("rollouts", RED, 1, rollout_id=BRAKE)
