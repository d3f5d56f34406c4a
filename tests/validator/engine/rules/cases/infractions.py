"""Defects and limits of counted departures from the road, red lights and stop signs."""

from __future__ import annotations

from tests.validator.engine.rules.case import BRAKE, boundary, mutant
from tests.validator.engine.rules.cases.results import result_of
from tests.validator.engine.rules.draft import Draft

OFF_ROAD, RED, STOP = (f"result_num_{kind}_infractions" for kind in ("off_road", "red_light", "stop_sign"))


# BD-RES-004


def _stop_sign(d: Draft, away_m: float) -> None:
    """Put a stop sign behind the place from which an attempt departs."""
    start = d.take("observations", rollout_id=BRAKE, tick=0)
    place = {"x_m": [start["x_m"][0].as_py() - away_m], "y_m": [start["y_m"][0].as_py()]}
    changes = {"element_id": "sign", "kind": "stop_sign", **place}
    d.duplicate("map", changes, town=d.value("rollouts", "town", rollout_id=BRAKE), element_id="far-signal")


@mutant("BD-RES-004", base="full", at=result_of(OFF_ROAD))
def departure_that_is_not_counted(d: Draft) -> None:
    d.set("evidence", "on_road", False, rollout_id=BRAKE, tick=[150, 155])


@mutant("BD-RES-004", base="full", at=result_of(OFF_ROAD))
def departures_that_are_counted_tick_by_tick(d: Draft) -> None:
    d.set("evidence", "on_road", False, rollout_id=BRAKE, tick=[150, 155])
    d.set("rollouts", OFF_ROAD, 10, rollout_id=BRAKE)


@mutant("BD-RES-004", base="full", at=result_of(RED))
def red_light_in_green(d: Draft) -> None:
    _lights(d, "green")
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


@mutant("BD-RES-004", base="map", at=result_of(STOP))
def stop_sign_where_the_map_has_none(d: Draft) -> None:
    d.set("rollouts", STOP, 1, rollout_id=BRAKE)


@mutant("BD-RES-004", base="map", at=result_of(STOP))
def stop_sign_behind_the_start(d: Draft) -> None:
    _stop_sign(d, 30.01)
    d.set("rollouts", STOP, 1, rollout_id=BRAKE)


@boundary("BD-RES-004")
def stop_sign_near_the_start(d: Draft) -> None:
    _stop_sign(d, 29.99)
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
    """Yellow at the last observation before the line, and red when the front is at it."""
    d.set("evidence", "traffic_light", "yellow", rollout_id=BRAKE, tick=range(60))
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


# BD-RES-006


def _lights(d: Draft, light: str, last_tick: int = 200) -> None:
    """Show one light from the start to a tick, and none after it."""
    for name, shown, none in (("traffic_light_available", True, False), ("traffic_light", light, None)):
        d.set("evidence", name, none, rollout_id=BRAKE)
        d.set("evidence", name, shown, rollout_id=BRAKE, tick=range(last_tick + 1))


@mutant("BD-RES-006", at=result_of(RED))
def red_light_that_is_passed(d: Draft) -> None:
    _lights(d, "red", 50)


@boundary("BD-RES-006")
def red_light_that_is_passed_and_counted(d: Draft) -> None:
    _lights(d, "red", 50)
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


@mutant("BD-RES-006", at=result_of(RED))
def green_light_that_is_counted(d: Draft) -> None:
    """It was red before, while the ego came near."""
    d.set("evidence", "lane_id", "road", rollout_id=BRAKE)
    _lights(d, "green", 50)
    d.set("evidence", "traffic_light", "red", rollout_id=BRAKE, tick=range(20))
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


@boundary("BD-RES-006")
def yellow_light_that_is_counted(d: Draft) -> None:
    _lights(d, "green", 50)
    d.set("evidence", "traffic_light", "yellow", rollout_id=BRAKE, tick=50)
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


@boundary("BD-RES-006")
def red_light_of_a_signal_before_the_green_one(d: Draft) -> None:
    """Another governs the next lane at once."""
    _lights(d, "green", 50)
    d.set("evidence", "lane_id", "road", rollout_id=BRAKE)
    d.set("evidence", "lane_id", "before", rollout_id=BRAKE, tick=range(20))
    d.set("evidence", "traffic_light", "red", rollout_id=BRAKE, tick=range(20))
    d.set("rollouts", RED, 1, rollout_id=BRAKE)


@boundary("BD-RES-006")
def red_light_at_the_end(d: Draft) -> None:
    _lights(d, "green", 50)
    for name, value in (("traffic_light_available", True), ("traffic_light", "red")):
        d.set("evidence", name, value, rollout_id=BRAKE, tick=range(195, 10_000))
    d.set("rollouts", RED, 1, rollout_id=BRAKE)
