"""Crossing the road on foot or by bicycle: somebody waits beside it and sets out in time to meet the ego.

It starts when the ego, at its present speed, would arrive while the other is in the ego's lane, and some way behind
the kerb, so that it already moves when the expert begins to react.
"""

from __future__ import annotations

import math
from abc import abstractmethod

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.population import PARKED_OFFSET_M
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Scenario, Scene
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import Lane, LaneSide, RoadClass
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.world.body import CAR, CHILD, CONTAINER, PEDESTRIAN, VAN, Behaviour, Body, Kind, Size

__all__ = ["Crossing", "DynamicObjectCrossing", "ParkingCrossingPedestrian", "PedestrianCrossing"]

_BEYOND_KERB_M = 1.6

_WALK_OUT_S, _STEP_OUT_S, _RUN_OUT_S = 1.9, 1.85, 1.8
"""Time from the start to the ego's path, from a kerb, between vehicles, from behind a container.

It is longer than the expert's forecast of it.
"""

_PATH_HALF_WIDTH_M, _KERB_M, _PAVEMENT_M = 2.0, 0.6, 0.4
_MAX_EDGE_M = 6.0
"""Pedestrians come from a side whose kerb is at most this far from the lane."""

_PARKED_GAP_M = 0.9
_BESIDE_M, _BEFORE_M = 1.4, 3.4
_HIDDEN_SHARE = 0.86
"""Where an ego that comes from far sees the container before who runs, as a share of the way to the road's middle."""


class Crossing(Scenario):
    """What these scenarios share; the hazard is active once somebody sets out."""

    kind: Kind
    size: Size
    speed_mps: tuple[float, float]
    """Range of the speed."""

    meeting_m: tuple[float, float]
    """Range of how far from the middle of the ego's lane, towards the start, it is when the ego arrives."""

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A stretch of street."""
        return route.place is Place.ROAD and route.site_lane.road_class is RoadClass.STREET

    @abstractmethod
    def start_offset_m(self, road: EmptyRoad) -> float:
        """Signed offset from the route at which it waits."""

    def place_m(self, road: EmptyRoad) -> float:
        """Arc length on the route where it crosses."""
        return road.site_m

    def lane(self, road: EmptyRoad) -> Lane:
        """Lane of the route there."""
        return road.tables.route.site_lane

    def draw_speed_mps(self, road: EmptyRoad) -> float:
        """Speed of this world."""
        return road.draw(*self.speed_mps, Purpose.SCENARIO_SPEED)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """Who crosses, facing the road."""
        offset_m = self.start_offset_m(road)
        turn_rad = math.copysign(math.pi / 2, -offset_m)
        return [road.standing(self.kind, self.size, self.place_m(road), offset_m, turn_rad=turn_rad)]

    def update(self, scene: Scene, _tick: int) -> bool:
        """Set out in time to be at the meeting point when the ego arrives."""
        if scene.hazard_tick >= 0:
            return True
        road = scene.road
        speed, start_m = self.draw_speed_mps(road), self.start_offset_m(road)
        meeting_m = road.draw(*self.meeting_m, Purpose.SCENARIO_TIMING)
        if scene.time_to_s(self.place_m(road)) > (abs(start_m) - meeting_m) / speed:
            return False
        lane = self.lane(road)
        body = scene.bodies[FIRST_ROW]
        body["behaviour"], body["speed_mps"] = Behaviour.WALKING, speed
        body["travel_m"] = abs(start_m) + (lane.right_edge_m if start_m > 0 else lane.left_edge_m) + _BEYOND_KERB_M
        return True


class PedestrianCrossing(Crossing):
    """A pedestrian crosses the whole road in front of the ego; the hazard is active once the pedestrian walks."""

    name = "PedestrianCrossing"
    trigger = brake_trigger("pedestrian-crossing-onset 1")
    kind, size = Kind.PEDESTRIAN, PEDESTRIAN
    speed_mps = (1.2, 1.9)
    meeting_m = (-0.8, 0.8)

    def start_offset_m(self, road: EmptyRoad) -> float:
        """Behind the kerb of a side that is not too far from the lane."""
        left_m, right_m = road.edges_m()
        from_left = left_m <= _MAX_EDGE_M and choice(2, road.seed, Purpose.SCENARIO_SIDE) == 1
        edge_m = left_m if from_left else right_m
        distance_m = max(edge_m + _KERB_M, _PATH_HALF_WIDTH_M + _WALK_OUT_S * self.draw_speed_mps(road))
        return distance_m if from_left else -distance_m


class ParkingCrossingPedestrian(Crossing):
    """A pedestrian steps out between parked vehicles; the hazard is active once the pedestrian walks."""

    name = "ParkingCrossingPedestrian"
    trigger = brake_trigger("parking-crossing-onset 1")
    kind, size = Kind.PEDESTRIAN, PEDESTRIAN
    speed_mps = (1.5, 2.4)
    meeting_m = (-0.5, 0.8)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A street with a parking strip."""
        return route.place is Place.ROAD and route.site_lane.right is LaneSide.PARKING

    def start_offset_m(self, road: EmptyRoad) -> float:
        """On the pavement beside the strip."""
        return -max(road.edges_m()[1] + _PAVEMENT_M, _STEP_OUT_S * self.draw_speed_mps(road))

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The pedestrian, and a parked vehicle on either side of its way."""
        site_m = self.place_m(road)
        before_m = site_m - VAN.length_m / 2 - _PARKED_GAP_M
        return [
            *super().bodies(road),
            road.standing(Kind.VEHICLE, VAN, before_m, PARKED_OFFSET_M),
            road.standing(Kind.VEHICLE, CAR, site_m + CAR.length_m / 2 + _PARKED_GAP_M, PARKED_OFFSET_M),
        ]


class DynamicObjectCrossing(Crossing):
    """A child comes out fast from behind a container beside the road; the hazard is active once it runs."""

    name = "DynamicObjectCrossing"
    trigger = brake_trigger("dynamic-object-onset 1")
    kind, size = Kind.PEDESTRIAN, CHILD
    speed_mps = (2.2, 3.2)
    meeting_m = (-0.6, 1.0)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A street or rural road whose right side is close."""
        lane = route.site_lane
        on_road = route.place is Place.ROAD and lane.road_class in (RoadClass.STREET, RoadClass.RURAL)
        return on_road and lane.right is LaneSide.NOTHING

    def start_offset_m(self, road: EmptyRoad) -> float:
        """To the right, far enough for a run-up."""
        return -max(road.edges_m()[1] + 1.0, _RUN_OUT_S * self.draw_speed_mps(road))

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """Who runs, and what hides it."""
        aside_m = max(road.edges_m()[1] + _BESIDE_M, _HIDDEN_SHARE * abs(self.start_offset_m(road)))
        before_m = _BEFORE_M + 0.5 * choice(3, road.seed, Purpose.SCENARIO_GAP)
        hides = road.standing(Kind.STATIC, CONTAINER, self.place_m(road) - before_m, -aside_m)
        return [*super().bodies(road), hides]
