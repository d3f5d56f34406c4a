"""Defects and limits of the clock of recorded rates: in what time, and at which observation, they stand."""

from __future__ import annotations

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.motion import give_before
from tests.validator.engine.rules.cases.responses import seen_again
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.timing import TICK_S

TOUCHED_TICK = 160
"""When pedestrians who are run over are where they would have been."""


def _walking(d: Draft, share: float) -> None:
    """Pedestrians who walk three times as fast, so that it counts, and velocities that are a share of theirs."""
    for place, velocity in (("x_m", "vel_x_mps"), ("y_m", "vel_y_mps")):
        rows = d.take("actors", actor_class="pedestrian")
        x, v, tick = (rows[name].to_numpy() for name in (place, velocity, "tick"))
        walked = {place: x + 2 * v * (tick - TOUCHED_TICK) * TICK_S, velocity: 3 * share * v}
        d.fill("actors", walked, actor_class="pedestrian")


@mutant("BD-RSP-007", base="full", at={"table": "actors", "column": "vel_x_mps"})
def pedestrians_that_are_slower_than_they_walk(d: Draft) -> None:
    """In no attempt by itself, and of all actors together hardly."""
    seen_again(d, lambda: _walking(d, 0.82))


@boundary("BD-RSP-007", base="full")
def pedestrians_that_are_a_little_slower_than_they_walk(d: Draft) -> None:
    seen_again(d, lambda: _walking(d, 0.96))


AWAY_M = 300.0
"""How far cyclists of these cases are moved along x and y, so that no evidence names one."""

SWING_MPS, SWING_RADPS = 1.5, 0.8
"""By how much, and how fast, the speed of cyclists swings in these cases."""


def _swinging(d: Draft, late_s: float) -> None:
    """Cyclists too far away to matter who ride faster and slower in turn, with velocities of a time that has passed."""
    for place, velocity in (("x_m", "vel_x_mps"), ("y_m", "vel_y_mps")):
        rows = d.take("actors", actor_class="cycle")
        x, v = (rows[name].to_numpy() for name in (place, velocity))
        speed = np.hypot(rows["vel_x_mps"].to_numpy(), rows["vel_y_mps"].to_numpy())
        time_s = rows["tick"].to_numpy() * TICK_S
        ahead_m = SWING_MPS / SWING_RADPS * np.sin(SWING_RADPS * time_s)
        swing_mps = SWING_MPS * np.cos(SWING_RADPS * (time_s - late_s))
        swung = {place: x + AWAY_M + ahead_m * v / speed, velocity: v + swing_mps * v / speed}
        d.fill("actors", swung, actor_class="cycle")


@mutant("BD-RSP-007", base="full", at={"table": "actors", "column": "vel_x_mps"})
def velocities_of_the_observation_before(d: Draft) -> None:
    seen_again(d, lambda: _swinging(d, 0.25))


@boundary("BD-RSP-007", "BD-MOT-006", base="full")
def velocities_of_half_an_observation_before(d: Draft) -> None:
    seen_again(d, lambda: _swinging(d, 0.125))


@mutant("BD-RSP-007", base="bare", at={"column": "speed_mps"})
def speeds_of_the_observation_before(d: Draft) -> None:
    give_before(d, "speed_mps", 1.0)


@boundary("BD-RSP-007", "BD-MOT-006", base="bare")
def speeds_of_half_an_observation_before(d: Draft) -> None:
    give_before(d, "speed_mps", 0.5)
