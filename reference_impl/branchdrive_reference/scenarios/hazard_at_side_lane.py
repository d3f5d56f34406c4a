"""HazardAtSideLane: slow cyclists ride at the right side of the ego's lane; the expert overtakes them."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Scene
from branchdrive_reference.scenarios.standing_obstacle import StandingObstacle, obstacle_trigger
from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.route import Place, Route, obstacle_sight_m
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import BICYCLE, EGO, Body, Kind

__all__ = ["HazardAtSideLane", "HazardAtSideLaneTwoWays"]

_SPACING_M = 5.0
_SIGHT_MARGIN_M = 6.0
_SEEN_M = 45.0
"""Distance to the site from which the ego sees them there."""


class HazardAtSideLane(StandingObstacle):
    """Overtaken with another lane of the ego's direction beside; active once the last cyclist is in sight."""

    name = "HazardAtSideLane"
    trigger = obstacle_trigger("hazard-at-side-lane-onset 1")

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """The outermost lane behind a junction where the ego need not stop, so that the cyclists do not get away."""
        if route.place is not Place.ROAD or not route.early or crossroads is None:
            return False
        goes_first = crossroads.control is Control.SIGNAL or route.chain[0].way[0] in crossroads.major
        outermost = route.site_lane.right is not LaneSide.SAME_DIRECTION
        return goes_first and outermost and super().fits(route, crossroads)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The cyclists, last first, so far ahead that the ego sees them shortly before the site."""
        speed = road.draw(2.6, 4.2, Purpose.SCENARIO_SPEED)
        behind_m = road.site_m - speed * road.ego_arrival_s(road.site_m - _SEEN_M)
        last_m = max(behind_m, road.tables.route.junction_m[1] + BICYCLE.length_m)
        eagerness = speed / road.advisory_mps(road.site_m)
        return [
            road.vehicle(
                BICYCLE, last_m + _SPACING_M * index, kind=Kind.CYCLE, speed_mps=speed, eagerness=eagerness,
                offset_m=road.draw(-1.25, -0.75, Purpose.SCENARIO_PLACE, index), headway_s=0.6,
            )
            for index in range(road.count((1, 3), Purpose.SCENARIO_COUNT))
        ]  # fmt: skip

    def update(self, scene: Scene, _tick: int) -> bool:
        """The cyclists ride on."""
        ego = scene.feet[EGO_TRACK, EGO]
        way_m = float(scene.bodies["arc_m"][FIRST_ROW] - ego["arc_m"])
        return way_m < obstacle_sight_m(float(ego["speed_mps"])) + _SIGHT_MARGIN_M


class HazardAtSideLaneTwoWays(HazardAtSideLane):
    """Overtaken on a two-way road."""

    name = "HazardAtSideLaneTwoWays"
    two_ways = True
    trigger = obstacle_trigger("hazard-at-side-lane-two-ways-onset 1")
