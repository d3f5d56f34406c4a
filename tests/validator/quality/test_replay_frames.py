"""Replays frame by frame: shares above floors, and the nearest vehicle of the nominal looked up by its identity."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests import synthetic
from tests.synthetic import make_group

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.limits import threshold_floors
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.box import Boxes, box_gap
from branchdrive.engine.examine import examine
from branchdrive.quality.replay import Pairs, canonical_pairs, pair_columns
from branchdrive.quality.replay_frames import FRAMED, MATCHED, frame_columns, matched_vehicle
from branchdrive.raw.shard_view import ShardView

DESCRIPTOR = Descriptor.model_validate(synthetic.descriptor())


def pairs_of(view: ShardView) -> Pairs:
    interventions, replays = canonical_pairs(view, examine(view)[1])
    return Pairs(*(np.concatenate(sides) for sides in zip(interventions, replays, strict=True)))


@cache
def view() -> ShardView:
    return ShardView(make_group(1), DESCRIPTOR)


@cache
def pairs() -> Pairs:
    return pairs_of(view())


def ego_of(rollout: int, tick: int) -> tuple[Boxes, Any]:
    """Box and velocity of the ego."""
    rollouts, observations = view().rollouts, view().observations
    row = int(observations.find(np.array([rollout]), np.array([tick]))[0])
    x, y, yaw, speed = (float(observations[name][row]) for name in ("x_m", "y_m", "yaw_rad", "speed_mps"))
    sides = (float(rollouts[name][rollout]) for name in ("ego_length_m", "ego_width_m"))
    return Boxes(*(np.array([value]) for value in (x, y, yaw, *sides))), (speed * math.cos(yaw), speed * math.sin(yaw))


def vehicles_at(rollout: int, tick: int) -> dict[int, tuple[float, float]]:
    """Gap and closing speed of every vehicle and cycle, by its identity."""
    ego, (vx, vy) = ego_of(rollout, tick)
    actors, found = view().stream("actors"), {}
    codes, classes = actors.categories("actor_class")
    for row in range(len(actors)):
        if actors.rollout[row] == rollout and actors.tick[row] == tick and classes[codes[row]] in ("vehicle", "cycle"):
            box = Boxes(*(np.array([float(actors[name][row])]) for name in Boxes._fields))
            gap = box_gap(ego, box)
            rel = float(actors["vel_x_mps"][row]) - vx, float(actors["vel_y_mps"][row]) - vy
            closing = -(rel[0] * gap.normal_x[0] + rel[1] * gap.normal_y[0])
            found[int(actors["actor_id"][row])] = (float(gap.gap_m[0]), float(closing))
    return found


def test_the_matched_vehicle_is_that_of_the_nominal_in_the_replay() -> None:
    found = matched_vehicle(view(), pairs())
    ticks = view().branch_tick
    for pair in (0, 5, len(pairs().replay) - 1):
        replay, nominal = int(pairs().replay[pair]), int(pairs().nominal[pair])
        for frame in (0, 8, 15):
            offset = HISTORY_OFFSETS[frame]
            at_nominal = vehicles_at(nominal, int(ticks[nominal]) + offset)
            at_replay = vehicles_at(replay, int(ticks[replay]) + offset)
            near = min((gap, identity) for identity, (gap, _) in at_nominal.items())[1]
            assert at_nominal[near][0] <= 50
            expected = np.abs(np.subtract(at_replay[near], at_nominal[near]))
            assert [found[0][pair, frame], found[1][pair, frame]] == pytest.approx(expected.tolist(), abs=1e-9)


def without(tables: dict[str, pa.Table], rollout_id: str, identity: int) -> dict[str, pa.Table]:
    actors = tables["actors"]
    gone = pc.and_(pc.equal(actors["rollout_id"], rollout_id), pc.equal(actors["actor_id"], identity))
    return {**tables, "actors": actors.filter(pc.invert(gone))}


def test_a_vehicle_that_the_replay_lacks_is_infinitely_far() -> None:
    replay, nominal = int(pairs().replay[0]), int(pairs().nominal[0])
    tick = int(view().branch_tick[nominal])
    near = min((gap, identity) for identity, (gap, _) in vehicles_at(nominal, tick).items())[1]
    fewer = ShardView(without(make_group(1), view().rollout_ids[replay], near), DESCRIPTOR)
    gap_m, speed_mps = matched_vehicle(fewer, pairs())
    assert math.isinf(gap_m[0, -1])
    assert math.isinf(speed_mps[0, -1])
    assert np.isfinite(gap_m[1:]).all()


def test_shares_count_frames_above_the_floor_of_the_variable() -> None:
    columns, largest = frame_columns(view(), pairs()), pair_columns(view(), pairs())
    floors = threshold_floors()
    for name in FRAMED:
        most = largest.get(name, columns.get(f"largest_{name}"))
        is_above = np.ma.filled(np.ma.asarray(most), np.inf) > floors[MATCHED.get(name, name)]
        assert ((columns[f"above_{name}"] > 0) == is_above).all()
    assert columns["rollout_id"].tolist() == largest["rollout_id"].tolist()


def test_a_nominal_against_itself_is_above_no_floor_and_moves_all_the_same() -> None:
    same = Pairs(pairs().nominal, pairs().nominal)
    columns = frame_columns(view(), same)
    assert all((columns[f"above_{name}"] == 0).all() for name in FRAMED)
    rows = np.flatnonzero(view().observations.rollout == int(same.nominal[0]))
    ticks = view().observations.tick[rows] - int(view().branch_tick[same.nominal[0]])
    speeds = view().observations["speed_mps"][rows[np.isin(ticks, HISTORY_OFFSETS)]].astype(float)
    assert columns["variation_speed_mps"][0] == pytest.approx(np.ptp(speeds))


def test_without_evidence_nothing_is_there_on_either_side() -> None:
    bare = Descriptor.model_validate(synthetic.bare_descriptor())
    tables = {name: table for name, table in make_group(1).items() if name in bare.tables}
    columns = frame_columns(ShardView(tables, bare), pairs())
    assert (columns["above_vehicle_gap_m"] == 0).all()
    assert (columns["largest_matched_vehicle_gap_m"] == 0).all()
    assert np.isnan(columns["variation_matched_vehicle_gap_m"]).all()
