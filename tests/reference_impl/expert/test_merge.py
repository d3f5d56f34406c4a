"""Merging: the expert finds its place in the stream that it joins."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.reference_impl.world.ground import ADVISORY_MPS, CAR, Ground, shaped, track

from branchdrive_reference.expert.control import Cause
from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.town.lane import LANE_WIDTH_M
from branchdrive_reference.world.body import EGO
from branchdrive_reference.world.vehicle import EGO_SIZE

LENGTHS_M = (CAR.length_m + EGO_SIZE.length_m) / 2


def entry() -> NDArray[np.void]:
    """An entry that runs one lane width to the right and moves over between 70 m before the join and the join."""
    x = np.arange(-300.0, 301.0)
    aside = LANE_WIDTH_M * (0.5 + 0.5 * np.cos(np.pi * np.clip((x + 70.0) / 70.0, 0.0, 1.0)))
    return shaped(Polyline(x, -aside))


def merging(stream_m: list[float], *, ego_m: float = -130.0) -> tuple[Ground, list[int]]:
    ground = Ground([entry(), track()], merging=(0, 1), ego_m=ego_m, ego_mps=ADVISORY_MPS)
    rows = [ground.vehicle_at(arc_m, 1) for arc_m in stream_m]
    ground.drive(600)
    return ground, rows


@pytest.mark.parametrize("shift_m", [0.0, 5.0, 10.0, 15.0, 20.0])
def test_the_expert_joins_a_stream_without_touching_anybody(shift_m: float) -> None:
    ground, rows = merging([-220.0 + shift_m + 25.0 * index for index in range(7)])
    x, y = ground.history["x_m"], ground.history["y_m"]
    on_lane = y[:, EGO] > -0.3
    assert on_lane.any()
    assert np.abs(x[:, rows] - x[:, [EGO]])[on_lane].min() > LENGTHS_M + 0.5
    assert ground.bodies["x_m"][EGO] > 50.0
    assert not ground.contacts.hit.any()


def test_a_free_lane_is_joined_without_braking() -> None:
    ground, _ = merging([])
    assert ground.plans["brake"].max() == 0.0
    assert ground.history["speed_mps"][:, EGO].min() > 0.9 * ADVISORY_MPS


def test_who_is_nearer_to_the_join_goes_first() -> None:
    ground, (ahead, behind) = merging([-124.0, -139.0])
    last = ground.history["x_m"][-1]
    assert last[behind] < last[EGO] < last[ahead]


def test_who_is_let_in_is_the_cause() -> None:
    ground, _ = merging([-122.0])
    assert Cause.PRIORITY in ground.plans["cause"]
