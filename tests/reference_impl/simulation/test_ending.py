"""Endings: at observation ticks, not before an intervention is over, and with the right reason."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from branchdrive.collector.trigger import MARGIN_TICKS
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive_reference.simulation.ending import Ending, EndingRule
from branchdrive_reference.world.body import BODY
from branchdrive_reference.world.corridor import FOOT

GOAL_M, TIMEOUT_TICKS, BRANCH_TICK, NOMINAL_TICKS = 150.0, 900, 200, 400
FREE_TICK = BRANCH_TICK + ACTIVE_TICKS + MARGIN_TICKS
"""First tick at which an intervention may end on its own."""


def world(tick: int, *, arc_m: float = 50.0, offset_m: float = 0.0, speed_mps: float = 8.0) -> Any:
    """As much of a world as the rule looks at."""
    feet, bodies = np.zeros((1, 1), FOOT), np.zeros(1, BODY)
    feet["arc_m"], feet["offset_m"], bodies["speed_mps"] = arc_m, offset_m, speed_mps
    tables = SimpleNamespace(route=SimpleNamespace(goal_m=GOAL_M))
    return SimpleNamespace(tick=tick, feet=feet, bodies=bodies, tables=tables)


def nominal() -> EndingRule:
    return EndingRule(TIMEOUT_TICKS, None, None)


def intervention() -> EndingRule:
    return EndingRule(TIMEOUT_TICKS, BRANCH_TICK, NOMINAL_TICKS)


def completion(ending: Ending | None) -> str | None:
    return None if ending is None else ending.completion


def first_ending(rule: EndingRule, **state: float) -> tuple[int, Ending]:
    """When a world that never changes ends, and how."""
    for tick in range(TIMEOUT_TICKS + OBSERVATION_STRIDE_TICKS):
        ending = rule.check(world(tick, **state))
        if ending is not None:
            return tick, ending
    raise AssertionError("it never ended")


def test_a_route_is_completed_at_its_goal() -> None:
    assert completion(nominal().check(world(300, arc_m=GOAL_M))) == "completed"
    assert nominal().check(world(300, arc_m=GOAL_M - 0.1)) is None


@pytest.mark.parametrize("tick", [301, 302, 303, 304])
def test_rollouts_end_at_observation_ticks_only(tick: int) -> None:
    assert nominal().check(world(tick, arc_m=GOAL_M)) is None


@pytest.mark.parametrize("state", [{"arc_m": GOAL_M}, {"offset_m": -40.0}], ids=["completed", "deviated"])
def test_no_intervention_ends_on_its_own_before_it_is_over(state: dict[str, float]) -> None:
    tick, ending = first_ending(intervention(), **state)
    assert tick == FREE_TICK
    assert ending.partial_reason is None


def test_who_leaves_the_route_has_deviated() -> None:
    assert completion(nominal().check(world(300, offset_m=-40.0))) == "deviated"
    assert nominal().check(world(300, offset_m=10.0)) is None


def test_who_stands_for_long_is_blocked() -> None:
    tick, ending = first_ending(nominal(), speed_mps=0.0)
    assert ending.completion == "blocked"
    assert 200 < tick < TIMEOUT_TICKS


def test_standing_with_interruptions_is_not_blocked() -> None:
    rule = nominal()
    endings = [rule.check(world(tick, speed_mps=3.0 * (tick % 100 == 0))) for tick in range(800)]
    assert endings == [None] * 800


def test_a_timeout_makes_a_nominal_rollout_partial() -> None:
    tick, ending = first_ending(nominal())
    assert (tick, ending.completion) == (TIMEOUT_TICKS, "timeout")
    assert ending.partial_reason is not None


def test_an_intervention_gets_some_time_beyond_its_nominal() -> None:
    tick, ending = first_ending(intervention())
    assert ending == Ending("timeout", "recovery time over")
    assert NOMINAL_TICKS < tick < TIMEOUT_TICKS


def test_a_timeout_inside_the_intervention_makes_it_partial() -> None:
    tick, ending = first_ending(EndingRule(BRANCH_TICK + 30, BRANCH_TICK, NOMINAL_TICKS))
    assert tick == BRANCH_TICK + 30
    assert ending.partial_reason is not None


@pytest.mark.parametrize("timeout_ticks", [100, 101, 104, 105])
def test_the_most_ticks_are_a_whole_number_of_observations(timeout_ticks: int) -> None:
    most = EndingRule(timeout_ticks, None, None).max_ticks
    assert most == OBSERVATION_STRIDE_TICKS * math.ceil(timeout_ticks / OBSERVATION_STRIDE_TICKS)
