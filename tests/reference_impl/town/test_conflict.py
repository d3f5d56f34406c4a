"""Conflicts: where tracks get in each other's way, and who yields."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.each import each
from tests.reference_impl.geometry.paths import path_of
from tests.reference_impl.town.towns import tables_of

from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.town import conflict as conflict_module
from branchdrive_reference.town.conflict import TrackCourse, conflict_table
from branchdrive_reference.town.lane import LANE_WIDTH_M, Turn
from branchdrive_reference.town.route import Place
from branchdrive_reference.town.signal import NO_GROUP
from branchdrive_reference.town.track import EGO_TRACK, Role, RouteTracks

CLEARANCE_M = conflict_module._CLEARANCE_M
STEP_M, REACH_M = 0.05, 40.0
STRAIGHT = TrackCourse(-15.0, 15.0, NO_GROUP, stops=False, turn=Turn.STRAIGHT)
ELSEWHERE = dataclasses.replace(STRAIGHT, begin_m=np.inf, end_m=np.inf)
EAST, NORTH, WEST = 0.0, math.pi / 2, math.pi


def all_tables() -> Iterator[RouteTracks]:
    return (tables for place in Place for tables in tables_of(place))


def straight(heading_rad: float, left_m: float = 0.0) -> NDArray[np.void]:
    """A straight track that passes the origin `left_m` to its left, at arc length 0."""
    arc = np.arange(-REACH_M, REACH_M + STEP_M / 2, STEP_M)
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return path_of(Polyline(arc * cos - left_m * sin, arc * sin + left_m * cos), arc_zero_m=REACH_M)


def course(
    turn: Turn = Turn.STRAIGHT, *, group: int = NO_GROUP, major: bool = True, begin_m: float = -15.0
) -> TrackCourse:
    return dataclasses.replace(STRAIGHT, turn=turn, group=group, major=major, begin_m=begin_m)


def who_yields(own: TrackCourse, other: TrackCourse, other_heading_rad: float = NORTH) -> tuple[bool, bool]:
    """Whether the track to the east and the other one, which crosses it, yield."""
    rows = conflict_table([straight(EAST), straight(other_heading_rad)], [own, other], merging=None)
    assert rows[["track", "other"]].tolist() == [(0, 1), (1, 0)]
    return bool(rows["yields"][0]), bool(rows["yields"][1])


@given(st.floats(math.radians(50), math.radians(130)))
def test_straight_tracks_conflict_where_their_distance_says(crossing_rad: float) -> None:
    """A point at arc length ``s`` is ``|s| sin(angle)`` from the other track."""
    own, other = conflict_table([straight(EAST), straight(crossing_rad)], [STRAIGHT, STRAIGHT], merging=None)
    half_m = CLEARANCE_M / math.sin(crossing_rad)
    for row in (own, other):
        assert row["enter_m"] == pytest.approx(-half_m, abs=2 * STEP_M)
        assert row["leave_m"] == pytest.approx(half_m, abs=2 * STEP_M)
    assert (own["other_enter_m"], own["other_leave_m"]) == (other["enter_m"], other["leave_m"])


def test_tracks_that_keep_apart_do_not_conflict() -> None:
    beside = [straight(EAST), straight(WEST, LANE_WIDTH_M)]
    assert len(conflict_table(beside, [STRAIGHT, STRAIGHT], merging=None)) == 0


def test_tracks_that_avoid_the_junction_do_not_conflict() -> None:
    crossing = [straight(EAST), straight(NORTH)]
    assert len(conflict_table(crossing, [STRAIGHT, ELSEWHERE], merging=None)) == 0


def test_between_equals_the_right_goes_first() -> None:
    """Who drives north comes from the right of who drives east."""
    assert who_yields(course(), course(), NORTH) == (True, False)
    assert who_yields(course(), course(), -NORTH) == (False, True)


@pytest.mark.parametrize("heading_rad", [NORTH, -NORTH])
@pytest.mark.parametrize("turn", [Turn.LEFT, Turn.STRAIGHT, Turn.RIGHT])
def test_minor_yields_to_major(turn: Turn, heading_rad: float) -> None:
    assert who_yields(course(Turn.STRAIGHT, major=False), course(turn), heading_rad) == (True, False)
    assert who_yields(course(Turn.LEFT), course(turn, major=False), heading_rad) == (False, True)


@pytest.mark.parametrize("group", [NO_GROUP, 1])
@pytest.mark.parametrize("other", [Turn.STRAIGHT, Turn.RIGHT])
def test_a_left_turn_yields_to_the_opposite_side(other: Turn, group: int) -> None:
    opposite_rad = WEST - 0.3
    assert who_yields(course(Turn.LEFT, group=group), course(other, group=group), opposite_rad) == (True, False)
    assert who_yields(course(other, group=group), course(Turn.LEFT, group=group), opposite_rad) == (False, True)


def test_opposite_left_turns_do_not_yield_to_each_other() -> None:
    assert who_yields(course(Turn.LEFT, group=0), course(Turn.LEFT, group=0), WEST - 0.3) == (False, False)


@each("heading_rad", [NORTH, -NORTH, WEST - 0.3])
@each("turn", [Turn.LEFT, Turn.STRAIGHT, Turn.RIGHT])
def test_signals_order_their_groups_so_that_nobody_yields(turn: Turn, heading_rad: float) -> None:
    assert who_yields(course(turn, group=0), course(Turn.STRAIGHT, group=1), heading_rad) == (False, False)


def test_a_merge_is_a_zipper_seen_from_both_sides() -> None:
    """The entry comes from the right, one metre in ten, and is on the lane from ``s = 0`` on."""
    arc = np.arange(-100.0, 60.0, 0.5)
    lane = path_of(Polyline(arc, np.zeros_like(arc)), arc_zero_m=100.0)
    entry = path_of(Polyline(arc, np.minimum(arc, 0.0) / 10.0), arc_zero_m=0.0)
    own, other = conflict_table([entry, lane], [ELSEWHERE, ELSEWHERE], merging=(0, 1))
    assert [own["zipper"], other["zipper"], own["yields"], other["yields"]] == [1, 1, 1, 1]
    assert (own["track"], own["other"], other["track"], other["other"]) == (0, 1, 1, 0)
    assert [own[f"other_{name}"] for name in ("enter_m", "leave_m")] == [other["enter_m"], other["leave_m"]]
    assert [other[f"other_{name}"] for name in ("enter_m", "leave_m")] == [own["enter_m"], own["leave_m"]]
    assert other["leave_m"] == pytest.approx(0.0, abs=1.0)
    assert other["enter_m"] == pytest.approx(-10.0 * CLEARANCE_M, abs=1.0)


def test_every_conflict_is_listed_from_both_sides() -> None:
    for tables in all_tables():
        sides = ["enter_m", "leave_m", "other_enter_m", "other_leave_m"]
        mirrored = ["other_enter_m", "other_leave_m", "enter_m", "leave_m"]
        rows = {(int(row["track"]), int(row["other"])): row for row in tables.conflicts}
        assert len(rows) == len(tables.conflicts)
        for (track, other), row in rows.items():
            back = rows[other, track]
            assert [row[name] for name in sides] == [back[name] for name in mirrored], tables.route.route_id
            assert row["zipper"] == back["zipper"]


def test_never_do_both_sides_yield_but_at_a_zipper() -> None:
    for tables in all_tables():
        yields = {(int(row["track"]), int(row["other"])): row for row in tables.conflicts}
        for (track, other), row in yields.items():
            both = bool(row["yields"] and yields[other, track]["yields"])
            assert both == bool(row["zipper"]), tables.route.route_id


def test_only_junctions_and_merges_have_conflicts() -> None:
    for tables in all_tables():
        zipper = tables.conflicts["zipper"].astype(bool)
        match tables.route.place:
            case Place.MERGE:
                main = tables.roles[Role.MAINLINE]
                assert tables.conflicts[["track", "other"]].tolist() == [(EGO_TRACK, main), (main, EGO_TRACK)]
                assert zipper.all()
            case Place.JUNCTION:
                assert not zipper.any()
            case Place.ROAD:  # others may meet there, the ego meets nobody
                assert EGO_TRACK not in tables.conflicts["track"]
                assert not zipper.any()
            case Place.MOTORWAY:
                assert len(tables.conflicts) == 0


def test_different_signal_groups_never_yield() -> None:
    for tables in all_tables():
        group = tables.tracks["group"]
        apart = group[tables.conflicts["track"]] != group[tables.conflicts["other"]]
        assert not tables.conflicts["yields"][apart].any(), tables.route.route_id


def stretch(path: NDArray[np.void], begin_m: float, end_m: float) -> shapely.LineString:
    inside = (path["arc_m"] >= begin_m) & (path["arc_m"] <= end_m)
    return shapely.LineString(np.stack([path["x_m"][inside], path["y_m"][inside]], axis=1))


def test_conflicts_are_where_the_tracks_come_close() -> None:
    """By shapely: both ends of the interval are close to the other track, and nothing before them is."""
    for tables in tables_of(Place.JUNCTION)[::2]:
        for row in tables.conflicts:
            own, other = tables.path(row["track"]), tables.path(row["other"])
            crossing = stretch(other, row["other_enter_m"] - REACH_M, row["other_leave_m"] + 10.0)
            near = own[(own["arc_m"] > row["enter_m"] - REACH_M) & (own["arc_m"] < row["leave_m"] + 1e-9)]
            distance_m = shapely.distance(shapely.points(near["x_m"], near["y_m"]), crossing)
            inside = near["arc_m"] > row["enter_m"] - 1e-9
            assert distance_m[inside][[0, -1]].max() < CLEARANCE_M, tables.route.route_id
            assert distance_m[~inside].min() > CLEARANCE_M - 0.1, tables.route.route_id


def test_nothing_is_close_behind_a_crossing() -> None:
    """As above for what lies behind; tracks that end on the same lane stay together instead."""
    crossed = 0
    for tables in tables_of(Place.JUNCTION)[::2]:
        for row in tables.conflicts:
            own, other = tables.path(row["track"]), tables.path(row["other"])
            crossing = stretch(other, row["other_enter_m"] - 10.0, row["other_leave_m"] + REACH_M)
            behind = own[(own["arc_m"] > row["leave_m"] + 1e-9) & (own["arc_m"] < row["leave_m"] + REACH_M)]
            distance_m = shapely.distance(shapely.points(behind["x_m"], behind["y_m"]), crossing)
            if distance_m[-1] < 0.5:
                continue
            assert distance_m.min() > CLEARANCE_M - 0.1, tables.route.route_id
            crossed += 1
    assert crossed
