"""The clock: windows have the lengths and the ends that the definition gives them."""

from __future__ import annotations

from itertools import pairwise

from branchdrive.contract.descriptor import Rates
from branchdrive.contract.timing import (
    ACTIVE_TICKS,
    CONTROL_HISTORY_TICKS,
    FUTURE_OBSERVATIONS,
    FUTURE_OFFSETS,
    HISTORY_OBSERVATIONS,
    HISTORY_OFFSETS,
    OBSERVATION_STRIDE_TICKS,
    PREDECESSOR_OFFSET,
    TICK_S,
)


def test_rates_are_20_and_4_hertz() -> None:
    assert TICK_S == 0.05
    assert OBSERVATION_STRIDE_TICKS == 5
    assert Rates() == Rates(tick_s=TICK_S, observation_stride_ticks=OBSERVATION_STRIDE_TICKS)


def test_history_has_16_observations_that_end_at_the_branch() -> None:
    assert HISTORY_OFFSETS == (-75, -70, -65, -60, -55, -50, -45, -40, -35, -30, -25, -20, -15, -10, -5, 0)
    assert len(HISTORY_OFFSETS) == HISTORY_OBSERVATIONS == 16


def test_predecessor_is_one_stride_before_the_history_and_starts_the_controls() -> None:
    assert HISTORY_OFFSETS[0] - PREDECESSOR_OFFSET == OBSERVATION_STRIDE_TICKS
    assert -PREDECESSOR_OFFSET == CONTROL_HISTORY_TICKS == 80


def test_future_has_10_observations_that_end_with_the_intervention() -> None:
    assert FUTURE_OFFSETS == (5, 10, 15, 20, 25, 30, 35, 40, 45, 50)
    assert len(FUTURE_OFFSETS) == FUTURE_OBSERVATIONS == 10
    assert FUTURE_OFFSETS[-1] == ACTIVE_TICKS


def test_intervention_lasts_two_and_a_half_seconds() -> None:
    assert ACTIVE_TICKS == 50
    assert ACTIVE_TICKS * TICK_S == 2.5


def test_windows_make_one_gapless_record_around_the_branch() -> None:
    offsets = (PREDECESSOR_OFFSET, *HISTORY_OFFSETS, *FUTURE_OFFSETS)
    strides = {later - earlier for earlier, later in pairwise(offsets)}
    assert strides == {OBSERVATION_STRIDE_TICKS}
