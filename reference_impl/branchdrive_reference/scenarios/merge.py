"""Entering a motorway: the expert finds a gap in the flow on the lane that its ramp joins."""

from __future__ import annotations

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.flow import flow
from branchdrive_reference.scenarios.scenario import Ambient, Scenario, Scene
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.town.track import Role
from branchdrive_reference.world.body import Body

__all__ = ["EnterActorFlow", "MergerIntoSlowTraffic"]

_ACTIVE_M = 130.0


class EnterActorFlow(Scenario):
    """The flow is fast and dense; active from some way before the join."""

    name = "EnterActorFlow"
    trigger = brake_trigger("enter-actor-flow-onset 1")
    ambient = Ambient(ahead=False, beside=False)
    eagerness = (0.7, 0.85)
    headway_s = (1.1, 1.8)
    count = (8, 11)
    early_s = 6.0

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """Any entry."""
        return route.place is Place.MERGE

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The flow, around the time at which the ego would be there."""
        track = road.tables.roles[Role.MAINLINE]
        at_m, other_at_m = road.meeting_m(track)
        first_s = road.ego_arrival_s(at_m) - self.early_s + road.draw(-1.0, 1.0, Purpose.SCENARIO_TIMING)
        count = road.count(self.count, Purpose.SCENARIO_COUNT)
        eagerness = road.draw(*self.eagerness, Purpose.SCENARIO_SPEED)
        return flow(road, track, other_at_m, first_s, count, self.headway_s, eagerness=eagerness)

    def update(self, scene: Scene, _tick: int) -> bool:
        """The flow drives by itself."""
        return scene.way_to_m(scene.road.site_m) < _ACTIVE_M


class MergerIntoSlowTraffic(EnterActorFlow):
    """The flow is slow."""

    name = "MergerIntoSlowTraffic"
    trigger = brake_trigger("merger-into-slow-traffic-onset 1")
    eagerness = (0.4, 0.6)
    headway_s = (1.8, 3.2)
