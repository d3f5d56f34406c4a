"""Merging like a zipper: who is nearer to the join goes first, on either side."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.reference_impl.world.ground import ADVISORY_MPS, CAR, Ground, shaped, track

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.world.body import EGO, Heed
from branchdrive_reference.world.corridor import NOBODY
from branchdrive_reference.world.priority import zipper_leader

ENTRY, LANE = 1, 2
BEGIN_M, JOIN_M = -300.0, 300.0


def entry() -> NDArray[np.void]:
    """A track that comes from the right, one metre in twenty, and is on the lane from ``x = 0`` on."""
    x = np.arange(BEGIN_M, JOIN_M)
    return shaped(Polyline(x, np.minimum(x, 0.0) / 20.0))


def merge(*, ego_m: float = 0.0, ego_mps: float | None = None) -> Ground:
    """An entry and a lane besides the ego's track, or with the ego on the entry."""
    if ego_mps is None:
        return Ground([track(left_m=200.0), entry(), track()], merging=(ENTRY, LANE))
    return Ground([entry(), track(left_m=200.0), track()], merging=(0, LANE), ego_m=ego_m, ego_mps=ego_mps)


def leader(ground: Ground, row: int) -> int:
    """Whom a body follows into the merge."""
    found, _ = zipper_leader(ground.bodies, ground.feet, ground.conflicts, int(ground.bodies["track"][row]), row)
    return found


@pytest.mark.parametrize("lead_m", [-8.0, 8.0])
def test_who_is_nearer_to_the_join_goes_first(lead_m: float) -> None:
    ground = merge()
    entering, passing = ground.vehicle_at(-60.0 + lead_m, ENTRY), ground.vehicle_at(-60.0, LANE)
    first, second = (entering, passing) if lead_m > 0 else (passing, entering)
    assert (leader(ground, first), leader(ground, second)) == (NOBODY, first)


def test_the_gap_is_that_along_the_way_to_the_join() -> None:
    ground = merge()
    entering, passing = ground.vehicle_at(-30.0, ENTRY), ground.vehicle_at(-60.0, LANE)
    _, gap_m = zipper_leader(ground.bodies, ground.feet, ground.conflicts, LANE, passing)
    assert gap_m == pytest.approx(30.0 - CAR.length_m, abs=0.5)
    assert leader(ground, entering) == NOBODY


def test_the_nearest_of_those_ahead_leads() -> None:
    ground = merge()
    rows = [ground.vehicle_at(arc_m, ENTRY) for arc_m in (-20.0, -40.0, -80.0)]
    passing = ground.vehicle_at(-60.0, LANE)
    assert leader(ground, passing) == rows[1]


@pytest.mark.parametrize("arc_m", [-250.0, 10.0])
def test_far_from_the_merge_and_behind_it_nobody_leads(arc_m: float) -> None:
    ground = merge()
    ground.vehicle_at(arc_m + 5.0, ENTRY)
    assert leader(ground, ground.vehicle_at(arc_m, LANE)) == NOBODY


@pytest.mark.parametrize("lead_m", [-6.0, 6.0])
def test_two_streams_become_one_without_touching(lead_m: float) -> None:
    ground = merge()
    rows = [
        ground.vehicle_at(-100.0 - 25.0 * index + side * lead_m, ENTRY + side) for index in range(3) for side in (0, 1)
    ]
    ground.drive(700)
    x = ground.history["x_m"][:, rows]
    last = np.sort(x[-1])
    assert (last > 100.0).all()
    assert np.diff(last).min() > CAR.length_m + 1.0
    joined = (x[:, :, None] > -20.0) & (x[:, None, :] > -20.0) & ~np.eye(len(rows), dtype=bool)
    assert np.abs(x[:, :, None] - x[:, None, :])[joined].min() > CAR.length_m


def slows_down_mps(heeds: Heed) -> float:
    """How much a driver on the lane slows down within half a second behind an ego that is still beside the lane."""
    ground = merge(ego_m=-70.0, ego_mps=7.0)
    passing = ground.vehicle_at(-76.0, LANE, heeds=heeds)
    ground.drive(10)
    return float(ADVISORY_MPS - ground.bodies["speed_mps"][passing])


def test_traffic_lets_the_ego_in_as_far_as_it_heeds_priority() -> None:
    assert slows_down_mps(Heed.ALL) > 0.5
    assert slows_down_mps(Heed.SIGNALS) < 0.2


def test_nobody_brakes_hard_to_let_somebody_in() -> None:
    """Even where somebody enters much more slowly right ahead."""
    ground = merge()
    passing = ground.vehicle_at(-86.0, LANE)
    ground.vehicle_at(-80.0, ENTRY, speed_mps=4.0)
    ground.drive(20)
    slowest = np.diff(ground.history["speed_mps"][:, passing]).min() / TICK_S
    assert -3.0 < slowest < -1.0


def test_the_ego_is_seen_on_its_own_track_only() -> None:
    ground = merge(ego_m=-40.0, ego_mps=ADVISORY_MPS)
    passing = ground.vehicle_at(-60.0, LANE)
    assert leader(ground, passing) == EGO
    ground.bodies["y_m"][EGO] = 100.0
    ground.think()
    assert leader(ground, passing) == NOBODY
    assert math.isinf(zipper_leader(ground.bodies, ground.feet, ground.conflicts, LANE, passing)[1])


def test_a_follower_of_the_ego_has_its_place_in_the_zipper() -> None:
    ground = merge(ego_m=-40.0, ego_mps=ADVISORY_MPS)
    follower = ground.vehicle_at(-60.0, 0)
    assert leader(ground, ground.vehicle_at(-75.0, LANE)) == follower


def test_two_that_are_equally_near_do_not_wait_for_each_other() -> None:
    ground = merge()
    entering = ground.vehicle_at(-60.0, ENTRY)
    join_m = ground.conflicts[["leave_m", "other_leave_m"]][0].tolist()
    passing = ground.vehicle_at(-60.0 - join_m[0] + join_m[1], LANE)
    assert [leader(ground, entering), leader(ground, passing)].count(NOBODY) == 1
    ground.drive(600)
    assert ground.bodies["x_m"][[entering, passing]].min() > 0.0
