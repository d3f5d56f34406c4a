"""The map of a town says of every place what the world's own lookup says."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from branchdrive.contract.limits import spec_limits
from branchdrive.driving.surface import Areas, Strips, Work
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.elements import Element, town_elements
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.surface import town_surface
from branchdrive_reference.town.town import TOWN_NAMES, town

SLACK_M = 0.05


@pytest.fixture(params=TOWN_NAMES)
def network(request: pytest.FixtureRequest) -> RoadNetwork:
    return town(request.param)


def _of_kinds(network: RoadNetwork, *kinds: str) -> list[Element]:
    return [element for element in town_elements(network) if element["kind"] in kinds]


def test_lanes_and_road_agree_with_the_lookup_of_the_world(network: RoadNetwork) -> None:
    """At random places up to 12 m beside the lanes."""
    random = np.random.default_rng(0)
    x, y = (
        np.concatenate([np.repeat(getattr(lane.centre, axis)[::5], 4) for lane in network.lanes.values()])
        for axis in ("x_m", "y_m")
    )
    x, y = x + random.uniform(-12.0, 12.0, len(x)), y + random.uniform(-12.0, 12.0, len(y))
    lanes, on_road = town_surface(network).under(x, y)

    elements = _of_kinds(network, "lane", "shoulder", "parking")
    counts = np.array([len(element["x_m"]) for element in elements])
    lines = [np.concatenate([element[name] for element in elements]) for name in ("x_m", "y_m", "width_m")]
    town_codes, here = np.zeros(len(elements), np.int64), np.zeros(len(x), np.int64)
    names = np.array([element["lane_id"] if element["kind"] == "lane" else "" for element in elements])
    has_lane, fits_lane, is_on, may_be_on = (np.zeros(len(x), bool) for _ in range(4))
    recorded = np.array([lane or "none" for lane in lanes])
    strips = Strips(town_codes, counts, *lines, slack_m=SLACK_M, most_squares=spec_limits().max_map_squares)
    work = Work(spec_limits().max_map_pairs)
    for point, strip, excess_m, is_end in strips.near(here, x, y, work):
        certain, may = (excess_m <= -SLACK_M) & ~is_end, excess_m <= SLACK_M
        has_lane[point[certain & (names[strip] != "")]] = True
        fits_lane[point[may & (names[strip] == recorded[point])]] = True
        is_on[point[certain]] = True
        may_be_on[point[may]] = True
    outlines = tuple(np.stack([area["x_m"], area["y_m"]], axis=1) for area in _of_kinds(network, "road_area"))
    for point, excess_m in Areas(np.zeros(len(outlines), np.int64), outlines).near(here, x, y, work, slack_m=SLACK_M):
        is_on[point[excess_m <= -SLACK_M]] = True
        may_be_on[point[excess_m <= SLACK_M]] = True

    has_name = recorded != "none"
    assert has_name.any()
    assert not has_name.all()
    assert fits_lane[has_name].all()
    assert not has_lane[~has_name].any()
    assert may_be_on[on_road].all()
    assert not is_on[~on_road].any()


def test_every_element_has_an_id_of_its_own(network: RoadNetwork) -> None:
    count = Counter(element["element_id"] for element in town_elements(network))
    assert max(count.values()) == 1


def test_lanes_keep_their_limits_and_lengths(network: RoadNetwork) -> None:
    for element in _of_kinds(network, "lane"):
        lane = network.lanes[element["lane_id"]]
        length_m = np.hypot(np.diff(element["x_m"]), np.diff(element["y_m"])).sum()
        assert element["speed_limit_mps"] == lane.speed_limit_mps
        assert length_m == pytest.approx(lane.centre.length_m, rel=1e-3)


def test_approaches_that_wait_have_a_line(network: RoadNetwork) -> None:
    waiting = {
        lane.lane_id
        for lane in network.lanes.values()
        if lane.turn is Turn.FOLLOW and lane.junction
        for junction in [network.junctions[lane.junction]]
        if junction.control is Control.SIGNAL or lane.way[0] not in junction.major
    }
    lines = {element["lane_id"]: element["marking"] for element in _of_kinds(network, "stop_line")}
    assert waiting == set(lines)
    assert set(lines.values()) == {"solid", "broken"}
