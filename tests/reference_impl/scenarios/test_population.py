"""Who is on the road when a world begins: nobody inside another, and no ambient body in the ego's way."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest
import shapely
import shapely.affinity
from tests.each import each
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES, drawn_spec

from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.population import populate
from branchdrive_reference.scenarios.scenario import Ambient
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.lane import LANE_WIDTH_M
from branchdrive_reference.town.route import START_M
from branchdrive_reference.town.track import EGO_TRACK, Role, route_tracks
from branchdrive_reference.world.body import EGO, Behaviour, Body, Kind

WORLDS = range(14)
each_scenario = each("scenario", SCENARIO_NAMES)


def outline(body: np.void) -> shapely.Polygon:
    """The oriented box of a `BODY` row."""
    box = shapely.box(-body["length_m"] / 2, -body["width_m"] / 2, body["length_m"] / 2, body["width_m"] / 2)
    turned = shapely.affinity.rotate(box, body["yaw_rad"], origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, body["x_m"], body["y_m"])


@dataclasses.dataclass(frozen=True, eq=False)
class Opening:
    """A world before its first tick."""

    spec: WorldSpec
    bodies: np.ndarray
    ambient: np.ndarray
    """The rows of `bodies` that do not belong to the scenario."""

    lane: shapely.Geometry
    """The lane of the ego's route."""

    site_m: float


@cache
def openings(scenario: str) -> list[Opening]:
    found = []
    for world in (World(drawn_spec(scenario, number)) for number in WORLDS):
        road = world.scene.road
        line = world.tables.route.polyline
        centre = shapely.LineString(np.column_stack([line.x_m, line.y_m]))
        first = EGO + 1 + len(world.scenario.bodies(road))
        lane = centre.buffer(LANE_WIDTH_M / 2, cap_style="flat")
        shapely.prepare(lane)
        found.append(Opening(world.spec, world.bodies, world.bodies[first:], lane, road.site_m))
    return found


@each_scenario
def test_bodies_begin_apart(scenario: str) -> None:
    for opening in openings(scenario):
        outlines = np.array([outline(body) for body in opening.bodies])
        first, second = shapely.STRtree(outlines).query(outlines, predicate="intersects")
        overlapping = [(a, b) for a, b in zip(first.tolist(), second.tolist(), strict=True) if a < b]
        assert overlapping == [], opening.spec


@each_scenario
def test_no_ambient_body_stands_or_walks_into_the_lane(scenario: str) -> None:
    for opening in openings(scenario):
        for body in opening.ambient:
            if body["behaviour"] in (Behaviour.STANDING, Behaviour.WALKING):
                way_m = body["travel_m"] if body["behaviour"] == Behaviour.WALKING else 0.0
                dx, dy = way_m * np.cos(body["yaw_rad"]), way_m * np.sin(body["yaw_rad"])
                there = shapely.affinity.translate(outline(body), dx, dy)
                swept = shapely.union_all([outline(body), there]).convex_hull
                assert not opening.lane.intersects(swept), (opening.spec, body)


@each_scenario
def test_vehicles_of_the_own_lane_keep_clear_of_the_ego_and_the_site(scenario: str) -> None:
    for opening in openings(scenario):
        ambient = opening.ambient
        own = ambient[(ambient["behaviour"] == Behaviour.FOLLOWING) & (ambient["track"] == EGO_TRACK)]
        assert ((own["arc_m"] < START_M - 8.0) | (own["arc_m"] > opening.site_m + 10.0)).all()


def ambient_of(spec: WorldSpec, ambient: Ambient) -> list[Body]:
    return populate(EmptyRoad(route_tracks(spec.town, spec.route_id), spec.seed), ambient, ())


@each("part", [field.name for field in dataclasses.fields(Ambient)])
@each_scenario
def test_leaving_a_group_out_changes_no_other(scenario: str, part: str) -> None:
    spec = drawn_spec(scenario, 0)
    everybody = ambient_of(spec, Ambient())
    others = ambient_of(spec, dataclasses.replace(Ambient(), **{part: False}))
    assert [body for body in everybody if body in others] == others


@pytest.mark.parametrize(
    ("part", "scenario", "role"),
    [("oncoming", "PedestrianCrossing", Role.ONCOMING), ("crossing", "BlockedIntersection", Role.FROM_LEFT)],
)
def test_a_scenario_can_leave_traffic_out(part: str, scenario: str, role: Role) -> None:
    present = 0
    for number in WORLDS:
        spec = drawn_spec(scenario, number)
        track = route_tracks(spec.town, spec.route_id).roles.get(role)
        on_track = [b for b in ambient_of(spec, Ambient()) if b.behaviour is Behaviour.FOLLOWING and b.track == track]
        left = ambient_of(spec, dataclasses.replace(Ambient(), **{part: False}))
        assert not [b for b in left if b.behaviour is Behaviour.FOLLOWING and b.track == track]
        present += len(on_track)
    assert present


def test_roads_are_populated_by_all_kinds() -> None:
    kinds = {Kind(kind) for opening in openings("ParkedObstacleTwoWays") for kind in opening.bodies["kind"].tolist()}
    assert kinds == set(Kind)


@each_scenario
def test_walkers_stop_before_whatever_of_the_scenario_stands_in_their_way(scenario: str) -> None:
    for opening in openings(scenario):
        standing = [
            outline(body)
            for body in opening.bodies
            if body["behaviour"] == Behaviour.STANDING and body["kind"] != Kind.PEDESTRIAN
        ]
        for walker in opening.ambient[opening.ambient["behaviour"] == Behaviour.WALKING]:
            dx, dy = (walker["travel_m"] * trig(walker["yaw_rad"]) for trig in (math.cos, math.sin))
            there = shapely.affinity.translate(outline(walker), dx, dy)
            swept = shapely.union_all([outline(walker), there]).convex_hull
            assert not any(body.intersects(swept) for body in standing), opening.spec
