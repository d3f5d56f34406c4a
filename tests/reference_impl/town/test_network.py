"""Networks: lanes meet, keep to the right, lead on, and junctions order their approaches."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from tests.reference_impl.town.towns import TOWNS, each_town, motorway_beside, ramps

from branchdrive.contract.columns import PATTERNS
from branchdrive_reference.geometry.box import wrap
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.lane import LANE_WIDTH_M, PARKING_WIDTH_M, LaneSide, RoadClass, Turn
from branchdrive_reference.town.motorway import TAPER_M
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.signal import approach_group
from branchdrive_reference.town.town import TOWN_NAMES, town

_WAYS = {
    network.name: [lane for lane in network.lanes.values() if lane.road_class is RoadClass.MOTORWAY]
    for network in TOWNS
}
_OPPOSITE_RAD = math.radians(135.0)


def approaches(network: RoadNetwork, junction: str) -> dict[tuple[str, str], float]:
    """Heading of every approach of a junction where it arrives."""
    return {
        way: float(carriageway.lanes[0].centre.tangent_rad[-1])
        for way, carriageway in network.carriageways.items()
        if way[1] == junction
    }


def test_an_unknown_town_is_refused() -> None:
    with pytest.raises(KeyError):
        town("Reference00")


@each_town
def test_names_are_recordable(network: RoadNetwork) -> None:
    assert re.fullmatch(PATTERNS["name"], network.name)
    assert all(re.fullmatch(PATTERNS["name"], lane_id) for lane_id in network.lanes)


@each_town
def test_lanes_meet_in_place_and_direction(network: RoadNetwork) -> None:
    for lane_id, lane in network.lanes.items():
        for following in network.successors[lane_id]:
            dx, dy = following.centre.x_m[0] - lane.centre.x_m[-1], following.centre.y_m[0] - lane.centre.y_m[-1]
            turn_rad = abs(wrap(float(following.centre.tangent_rad[0] - lane.centre.tangent_rad[-1])))
            assert math.hypot(dx, dy) < 0.01, (lane_id, following.lane_id)
            assert turn_rad < 0.1, (lane_id, following.lane_id)


@each_town
def test_predecessors_are_successors_seen_from_behind(network: RoadNetwork) -> None:
    forward = {(lane_id, after.lane_id) for lane_id, found in network.successors.items() for after in found}
    backward = {(before.lane_id, lane_id) for lane_id, found in network.predecessors.items() for before in found}
    assert forward == backward


@each_town
def test_traffic_can_go_on_from_every_street_to_every_other(network: RoadNetwork) -> None:
    """Over successors and lane changes; only the motorway begins and ends at the edge of the map."""
    streets = {lane.lane_id for lane in network.lanes.values() if lane.junction}
    edges = {
        lane_id: {after.lane_id for after in network.successors[lane_id]}
        | {beside.lane_id for step in (-1, 1) if (beside := network.neighbour(network.lanes[lane_id], step))}
        for lane_id in streets
    }
    for neighbours in (edges, {lane: {other for other in streets if lane in edges[other]} for lane in streets}):
        reached, frontier = set(), {min(streets)}
        while frontier:
            reached |= frontier
            frontier = set().union(*(neighbours[lane] for lane in frontier)) - reached
        assert reached == streets


@each_town
def test_every_street_lane_leads_somewhere_and_comes_from_somewhere(network: RoadNetwork) -> None:
    for lane_id, lane in network.lanes.items():
        if lane.junction:
            assert network.successors[lane_id], lane_id
            assert network.predecessors[lane_id], lane_id


@each_town
def test_traffic_keeps_to_the_right(network: RoadNetwork) -> None:
    for (start, end), way in network.carriageways.items():
        opposite = network.carriageways[end, start].lanes[0].centre
        for index, lane in enumerate(way.lanes):
            x, y = lane.centre.at(np.array([lane.centre.length_m / 2]))
            assert opposite.position(x, y).offset_m[0] == pytest.approx(LANE_WIDTH_M * (index + 1), abs=0.05)


@each_town
def test_carriageways_of_a_motorway_lie_apart(network: RoadNetwork) -> None:
    """The other direction lies beyond the median, to the left."""
    for lane in _WAYS[network.name]:
        for other in _WAYS[network.name]:
            if lane.lane_id[:2] == other.lane_id[:2]:
                continue
            x, y = lane.centre.at(np.array([lane.centre.length_m / 2]))
            foot = other.centre.position(x, y)
            inside = 1.0 < foot.progress_m[0] < other.centre.length_m - 1.0
            assert not inside or foot.offset_m[0] > LANE_WIDTH_M


@each_town
def test_neighbours_lie_one_lane_width_apart(network: RoadNetwork) -> None:
    for lane in network.lanes.values():
        for step in (-1, 1):
            beside = network.neighbour(lane, step)
            if beside is None:
                continue
            x, y = lane.centre.at(np.array([lane.centre.length_m / 2]))
            assert beside.centre.position(x, y).offset_m[0] == pytest.approx(step * LANE_WIDTH_M, abs=0.05)
            assert network.neighbour(beside, -step) is lane


@each_town
def test_connectors_say_which_way_they_turn(network: RoadNetwork) -> None:
    for lane in network.lanes.values():
        turned = wrap(float(lane.centre.tangent_rad[-1] - lane.centre.tangent_rad[0]))
        match lane.turn:
            case Turn.LEFT:
                assert turned > math.radians(35)
            case Turn.RIGHT:
                assert turned < -math.radians(35)
            case Turn.STRAIGHT:
                assert abs(turned) < math.radians(45)


@each_town
def test_connectors_stay_on_the_paved_disc_of_their_junction(network: RoadNetwork) -> None:
    for lane in network.lanes.values():
        if lane.turn is not Turn.FOLLOW:
            junction = network.junctions[lane.junction]
            away_m = np.hypot(lane.centre.x_m - junction.x_m, lane.centre.y_m - junction.y_m)
            assert away_m.max() < junction.radius_m + LANE_WIDTH_M, lane.lane_id


@each_town
def test_innermost_street_lanes_border_oncoming_traffic(network: RoadNetwork) -> None:
    for way in network.carriageways.values():
        assert way.lanes[0].left is LaneSide.ONCOMING
        assert way.lanes[-1].right in (LaneSide.NOTHING, LaneSide.PARKING)


def test_motorways_border_no_oncoming_traffic() -> None:
    lanes = [lane for found in _WAYS.values() for lane in found]
    assert lanes
    assert all(LaneSide.ONCOMING not in (lane.left, lane.right) for lane in lanes)


def test_there_are_parking_strips_and_they_are_paved() -> None:
    parking = [lane for network in TOWNS for lane in network.lanes.values() if lane.right is LaneSide.PARKING]
    assert parking
    assert all(lane.right_edge_m == pytest.approx(LANE_WIDTH_M / 2 + PARKING_WIDTH_M) for lane in parking)
    assert {lane.road_class for lane in parking} <= {RoadClass.STREET, RoadClass.RURAL}


def test_there_are_entries_and_exits_in_both_directions() -> None:
    found = [
        {ramp.lane_id[:2] for network in TOWNS for ramp in ramps(network, entries=entries)} for entries in (True, False)
    ]
    assert found == [{"mf", "mb"}, {"mf", "mb"}]


@each_town
def test_ramps_lead_to_and_from_the_outermost_lane(network: RoadNetwork) -> None:
    for entries, beyond, within in (
        (True, network.predecessors, network.successors), (False, network.successors, network.predecessors),
    ):  # fmt: skip
        for ramp in ramps(network, entries=entries):
            assert not beyond[ramp.lane_id]
            (joined,) = within[ramp.lane_id]
            assert joined.road_class is RoadClass.MOTORWAY
            assert joined.right is LaneSide.NOTHING


@each_town
@pytest.mark.parametrize("entries", [True, False], ids=["entries", "exits"])
def test_ramps_run_alongside_one_lane_width_to_the_right(network: RoadNetwork, entries: bool) -> None:
    """Before an entry tapers into the lane, and after an exit has left it, for more than 100 m."""
    for ramp in ramps(network, entries=entries):
        place = motorway_beside(network, ramp, entry=entries).position(ramp.centre.x_m, ramp.centre.y_m)
        to_join_m = (ramp.centre.length_m - ramp.centre.arc_m) if entries else ramp.centre.arc_m
        parallel = (to_join_m > TAPER_M + 2.0) & (to_join_m < TAPER_M + 102.0)
        assert place.offset_m[parallel] == pytest.approx(-LANE_WIDTH_M, abs=0.02)
        assert place.offset_m[to_join_m < 0.5] == pytest.approx(0.0, abs=0.02)
        assert place.offset_m.max() < 0.02


@each_town
def test_straight_neighbours_come_first(network: RoadNetwork) -> None:
    for lane in network.lanes.values():
        turns = [following.turn for following in network.successors[lane.lane_id]]
        assert Turn.STRAIGHT not in turns[1:] or turns[0] is Turn.STRAIGHT


def test_the_towns_have_every_kind_of_control() -> None:
    assert {junction.control for network in TOWNS for junction in network.junctions.values()} == set(Control)
    assert len(TOWN_NAMES) == len(TOWNS) == 2


@each_town
def test_signals_group_opposite_approaches(network: RoadNetwork) -> None:
    for name, junction in network.junctions.items():
        if junction.control is not Control.SIGNAL:
            continue
        groups = {way: approach_group(heading) for way, heading in approaches(network, name).items()}
        assert set(groups.values()) == {0, 1}, name
        for way, heading in approaches(network, name).items():
            for other, other_heading in approaches(network, name).items():
                if way != other:
                    opposite = abs(wrap(other_heading - heading)) > _OPPOSITE_RAD
                    assert (groups[way] == groups[other]) == opposite, (way, other)


@each_town
def test_major_neighbours_exist(network: RoadNetwork) -> None:
    for name, junction in network.junctions.items():
        neighbours = {way[0] for way in approaches(network, name)}
        assert junction.major <= neighbours, name
        assert bool(junction.major) == (junction.control is not Control.SIGNAL), name


@each_town
def test_lengthened_chains_reach_as_far_as_asked_or_to_the_edge(network: RoadNetwork) -> None:
    for lane in network.lanes.values():
        chain = network.extended([lane], 60.0, 150.0)
        index = chain.index(lane)
        behind_m = sum(part.centre.length_m for part in chain[:index])
        ahead_m = sum(part.centre.length_m for part in chain[index + 1 :])
        assert behind_m >= 60.0 or not network.predecessors[chain[0].lane_id]
        assert ahead_m >= 150.0 or not network.successors[chain[-1].lane_id]
        for before, after in pairwise(chain):
            assert after in network.successors[before.lane_id]
