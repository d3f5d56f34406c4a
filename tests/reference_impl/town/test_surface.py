"""The surface: which lane lies under a point, and what is paved."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.town.towns import TOWNS, each_town, point

from branchdrive_reference.town.lane import LANE_WIDTH_M, PARKING_WIDTH_M, LaneSide, RoadClass, Turn
from branchdrive_reference.town.motorway import SHOULDER_M
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.surface import town_surface


def under(network: RoadNetwork, points: list[tuple[np.ndarray, np.ndarray]]) -> tuple[list[str | None], list[bool]]:
    x, y = (np.concatenate(values) for values in zip(*points, strict=True))
    lanes, drivable = town_surface(network).under(x, y)
    return lanes, drivable.tolist()


@each_town
def test_the_lane_under_its_own_centre_line_is_named(network: RoadNetwork) -> None:
    """Ramps aside where they have become their lane, and connectors where they share an end."""
    lanes = [
        lane for lane in network.lanes.values() if lane.turn is Turn.FOLLOW and lane.road_class is not RoadClass.RAMP
    ]
    for share, side in ((0.5, 0.0), (0.5, 1.6), (0.5, -1.6), (0.3, 0.8)):
        found, drivable = under(network, [point(lane, share * lane.centre.length_m, side) for lane in lanes])
        wrong = [
            (lane.lane_id, name)
            for lane, name in zip(lanes, found, strict=True)
            if name != lane.lane_id and (name is None or network.lanes[name].road_class is not RoadClass.RAMP)
        ]
        assert wrong == []
        assert all(drivable)


@each_town
def test_every_lane_is_drivable_from_edge_to_edge(network: RoadNetwork) -> None:
    for lane in network.lanes.values():
        points = [point(lane, arc_m, side) for arc_m in (1.0, lane.centre.length_m / 2) for side in (-1.7, 0.0, 1.7)]
        lanes, drivable = under(network, points)
        assert all(drivable), lane.lane_id
        assert None not in lanes, lane.lane_id


def test_parking_strips_are_drivable_and_the_meadow_beyond_is_not() -> None:
    for network in TOWNS:
        for lane in network.lanes.values():
            if lane.right is LaneSide.PARKING:
                strip, meadow = (
                    point(lane, lane.centre.length_m / 2, -LANE_WIDTH_M / 2 - aside_m)
                    for aside_m in (PARKING_WIDTH_M / 2, PARKING_WIDTH_M + 0.5)
                )
                assert under(network, [strip, meadow]) == ([None, None], [True, False]), lane.lane_id


def test_streets_without_parking_end_at_their_lane() -> None:
    for network in TOWNS:
        for way in network.carriageways.values():
            lane = way.lanes[-1]
            if lane.right is LaneSide.NOTHING:
                beside = point(lane, lane.centre.length_m / 2, -LANE_WIDTH_M / 2 - 0.3)
                assert under(network, [beside]) == ([None], [False]), lane.lane_id


@each_town
def test_junctions_are_paved_and_the_meadow_around_is_not(network: RoadNetwork) -> None:
    surface = town_surface(network)
    for junction in network.junctions.values():
        angle = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
        x, y = (
            junction.x_m + 0.95 * junction.radius_m * np.cos(angle),
            junction.y_m + 0.95 * junction.radius_m * np.sin(angle),
        )
        assert surface.under(x, y)[1].all()
        aside = 3.0 * junction.radius_m
        corners = np.array([(aside, aside), (aside, -aside), (-aside, aside), (-aside, -aside)])
        lanes, drivable = surface.under(junction.x_m + corners[:, 0], junction.y_m + corners[:, 1])
        assert lanes == [None] * 4
        assert not drivable.any()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_motorways_have_a_shoulder_on_the_right_only(side: float) -> None:
    """Beyond the outermost lane lies the shoulder, beyond the innermost the median."""
    checked = 0
    for network in TOWNS:
        for lane in network.lanes.values():
            beside = lane.left if side > 0 else lane.right
            if lane.road_class is not RoadClass.MOTORWAY or beside is not LaneSide.NOTHING:
                continue
            points = [
                point(lane, lane.centre.length_m / 2, side * (LANE_WIDTH_M / 2 + aside_m))
                for aside_m in (0.6, SHOULDER_M + 0.5)
            ]
            lanes, drivable = under(network, points)
            if any(name is not None for name in lanes):  # a ramp runs there
                continue
            assert drivable == [side < 0, False], lane.lane_id
            checked += 1
    assert checked
