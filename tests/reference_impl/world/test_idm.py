"""The intelligent driver model at its fixed points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive_reference.world.traffic import HARDEST_BRAKE_MPS2, desired_gap_m, idm_accel_mps2

ACCEL, BRAKE, HEADWAY_S, STANDSTILL_M = 1.5, 2.0, 1.2, 2.0


def wanted_m(speed: float, lead: float) -> float:
    return desired_gap_m(speed, lead, HEADWAY_S, STANDSTILL_M, ACCEL, BRAKE)


@pytest.mark.parametrize("speed", [2.0, 6.0, 9.5])
def test_equilibrium_gap(speed: float) -> None:
    """Behind an equally fast leader acceleration vanishes at ``s = s* / sqrt(1 - (v / v0)^4)``."""
    gap_m = wanted_m(speed, speed) / math.sqrt(1 - (speed / 10.0) ** 4)
    assert idm_accel_mps2(speed, 10.0, gap_m, wanted_m(speed, speed), ACCEL) == pytest.approx(0.0, abs=1e-12)


def test_free_road() -> None:
    assert idm_accel_mps2(0.0, 10.0, np.inf, 0.0, ACCEL) == ACCEL
    assert idm_accel_mps2(10.0, 10.0, np.inf, 0.0, ACCEL) == 0.0


def test_standstill_gap_is_kept() -> None:
    assert wanted_m(0.0, 0.0) == STANDSTILL_M
    assert idm_accel_mps2(0.0, 10.0, STANDSTILL_M, wanted_m(0.0, 0.0), ACCEL) == 0.0


@given(st.floats(0, 30), st.floats(-5, 30), st.floats(-5, 100))
def test_braking_is_bounded(speed: float, lead: float, gap_m: float) -> None:
    accel = idm_accel_mps2(speed, 12.0, gap_m, wanted_m(speed, lead), ACCEL)
    assert -HARDEST_BRAKE_MPS2 <= accel <= ACCEL


def test_a_queue_settles_at_the_equilibrium_gap() -> None:
    lead_m, lead_speed = 40.0, 8.0
    follow_m, speed = 0.0, 12.0
    for _ in range(4000):
        accel = idm_accel_mps2(speed, 14.0, lead_m - follow_m, wanted_m(speed, lead_speed), ACCEL)
        follow_m, speed, lead_m = follow_m + speed * 0.05, max(speed + accel * 0.05, 0.0), lead_m + lead_speed * 0.05
    assert speed == pytest.approx(lead_speed, abs=1e-3)
    assert lead_m - follow_m == pytest.approx(wanted_m(8.0, 8.0) / math.sqrt(1 - (8 / 14) ** 4), rel=1e-3)
