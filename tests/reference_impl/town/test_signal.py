"""Signals: one cycle in which the two groups are never green together."""

from __future__ import annotations

import math
from itertools import groupby

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.town import signal
from branchdrive_reference.town.signal import CYCLE_TICKS, Light, approach_group, green_begins, light_of

GROUPS = (0, 1)
each_group = pytest.mark.parametrize("group", GROUPS)
TICKS = st.integers(0, 5000)
OFFSETS = st.integers(0, CYCLE_TICKS - 1)


def cycle(group: int, offset_ticks: int = 0) -> list[Light]:
    """Light of a group at every tick of one cycle."""
    return [Light(light_of(group, tick, offset_ticks)) for tick in range(CYCLE_TICKS)]


@each_group
def test_a_cycle_is_green_then_yellow_then_red(group: int) -> None:
    begin = cycle(group).index(Light.GREEN) if group else 0
    rotated = [light_of(group, begin + tick, 0) for tick in range(CYCLE_TICKS)]
    assert [light for light, _ in groupby(rotated)] == [Light.GREEN, Light.YELLOW, Light.RED]


@each_group
def test_every_light_lasts_long_enough_to_be_heeded(group: int) -> None:
    assert all(cycle(group).count(light) * TICK_S >= 3.0 for light in Light)


@given(TICKS, OFFSETS)
def test_only_one_group_may_go(tick: int, offset_ticks: int) -> None:
    assert Light.RED in [light_of(group, tick, offset_ticks) for group in GROUPS]


@each_group
def test_everything_is_red_before_a_group_gets_green(group: int) -> None:
    green = green_begins(group, 0)
    before = [
        [light_of(other, CYCLE_TICKS - ticks, green) for other in GROUPS]
        for ticks in range(1, signal._ALL_RED_TICKS + 2)
    ]
    assert before[:-1] == [[Light.RED, Light.RED]] * signal._ALL_RED_TICKS
    assert before[-1][1 - group] == Light.YELLOW


@given(st.sampled_from(GROUPS), TICKS, OFFSETS)
def test_cycles_repeat(group: int, tick: int, offset_ticks: int) -> None:
    assert light_of(group, tick + CYCLE_TICKS, offset_ticks) == light_of(group, tick, offset_ticks)
    assert light_of(group, tick, offset_ticks) == light_of(group, tick + offset_ticks, 0)


@given(st.sampled_from(GROUPS), st.integers(1, 5000))
def test_green_begins_at_the_tick_asked_for(group: int, tick: int) -> None:
    offset_ticks = green_begins(group, tick)
    assert 0 <= offset_ticks < CYCLE_TICKS
    assert light_of(group, tick, offset_ticks) == Light.GREEN
    assert light_of(group, tick - 1, offset_ticks) == Light.RED


@given(st.floats(-math.pi, math.pi))
def test_opposite_headings_share_a_group_and_square_ones_do_not(heading_rad: float) -> None:
    assert approach_group(heading_rad + math.pi) == approach_group(heading_rad)
    if abs(abs(math.cos(heading_rad)) - abs(math.sin(heading_rad))) > 1e-9:
        assert approach_group(heading_rad + math.pi / 2) == 1 - approach_group(heading_rad)
