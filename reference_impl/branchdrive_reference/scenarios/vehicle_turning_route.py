"""Crossings behind a turn: somebody crosses the road into which the ego turned, or cyclists one after the other."""

from __future__ import annotations

import math

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.crossing import Crossing
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import Ambient, Scene, green_on_arrival
from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import Lane, Turn
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import BICYCLE, PEDESTRIAN, Behaviour, Body, Kind

__all__ = ["CrossingBicycleFlow", "VehicleTurningRoute", "VehicleTurningRoutePedestrian"]

_BEHIND_JUNCTION_M = 4.0
_RUN_UP_S = 2.0

_FLOW_ACTIVE_M = 45.0
_FLOW_COUNT = (3, 6)
_FLOW_HEADWAY_S = (1.2, 2.4)


class VehicleTurningRoute(Crossing):
    """A cyclist crosses; the hazard is active once it sets out."""

    name = "VehicleTurningRoute"
    trigger = brake_trigger("turning-route-onset 1")
    ambient = Ambient(ahead=False, crossing=False)
    kind, size = Kind.CYCLE, BICYCLE
    speed_mps = (2.6, 4.0)
    meeting_m = (-1.2, 1.6)

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """A turn at a junction where the ego need not stop."""
        if route.place is not Place.JUNCTION or route.turn is Turn.STRAIGHT or crossroads is None:
            return False
        return crossroads.control is Control.SIGNAL or route.chain[0].way[0] in crossroads.major

    def lane(self, road: EmptyRoad) -> Lane:
        """The lane behind the junction."""
        return road.tables.route.chain[-1]

    def place_m(self, road: EmptyRoad) -> float:
        """Right behind the junction."""
        return road.tables.route.junction_m[1] + _BEHIND_JUNCTION_M

    def start_offset_m(self, road: EmptyRoad) -> float:
        """Beside the road, on either side."""
        lane = self.lane(road)
        from_left = choice(2, road.seed, Purpose.SCENARIO_SIDE) == 1
        edge_m = lane.left_edge_m if from_left else lane.right_edge_m
        distance_m = max(edge_m + 0.8, _RUN_UP_S * self.draw_speed_mps(road))
        return distance_m if from_left else -distance_m

    def signal_offset(self, road: EmptyRoad) -> int:
        """The ego comes at green."""
        return green_on_arrival(road, 4.0)


class VehicleTurningRoutePedestrian(VehicleTurningRoute):
    """A pedestrian crosses."""

    name = "VehicleTurningRoutePedestrian"
    trigger = brake_trigger("turning-route-pedestrian-onset 1")
    kind, size = Kind.PEDESTRIAN, PEDESTRIAN
    speed_mps = (1.3, 2.0)
    meeting_m = (-0.8, 1.0)


class CrossingBicycleFlow(VehicleTurningRoute):
    """Cyclists cross on a path of their own; the hazard is active from some way before the crossing."""

    name = "CrossingBicycleFlow"
    trigger = brake_trigger("bicycle-flow-onset 1")
    speed_mps = (3.2, 4.6)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The cyclists, on the move from the beginning, timed around the ego's arrival."""
        place_m, speed = self.place_m(road), self.draw_speed_mps(road)
        side = 1 if choice(2, road.seed, Purpose.SCENARIO_SIDE) else -1
        time_s = road.ego_arrival_s(place_m) + road.draw(-2.5, 0.0, Purpose.SCENARIO_TIMING)
        bodies = []
        for index in range(road.count(_FLOW_COUNT, Purpose.SCENARIO_COUNT)):
            x, y, yaw = interpolate(road.tables.path(EGO_TRACK), place_m, side * speed * time_s)
            heading = yaw + math.copysign(math.pi / 2, -side)
            bodies.append(Body(Kind.CYCLE, Behaviour.WALKING, BICYCLE, x, y, heading, speed, travel_m=500.0))
            time_s += road.draw(*_FLOW_HEADWAY_S, Purpose.SCENARIO_GAP, index)
        return bodies

    def update(self, scene: Scene, _tick: int) -> bool:
        """The cyclists ride on."""
        return scene.way_to_m(self.place_m(scene.road)) < _FLOW_ACTIVE_M
