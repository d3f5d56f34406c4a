"""Cut-ins: a vehicle moves over into the ego's lane close ahead of it."""

from __future__ import annotations

import math

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.population import PARKED_OFFSET_M
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Ambient, Scenario, Scene
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide
from branchdrive_reference.town.route import START_M, Place, Route
from branchdrive_reference.town.track import EGO_TRACK, Role
from branchdrive_reference.world.body import BOX_TRUCK, CAR, EGO, VAN, VEHICLES, Body, Kind

__all__ = ["HighwayCutIn", "ParkingCutIn", "StaticCutIn"]

_STATIONED_GAIN = (0.25, 0.9)
"""Gains on distance and speed difference with which a vehicle keeps its place beside the ego."""

_QUEUE = (3, 5)
_QUEUE_GAP_M = 2.5


class HighwayCutIn(Scenario):
    """On a motorway, from the next lane; active once the vehicle moves over."""

    name = "HighwayCutIn"
    trigger = brake_trigger("highway-cut-in-onset 1")
    ambient = Ambient(ahead=False, beside=False)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """Any stretch of motorway."""
        return route.place is Place.MOTORWAY

    def _side(self, road: EmptyRoad) -> tuple[int, float]:
        """The vehicle's track and the offset to the ego's lane."""
        right, left = road.track(Role.RIGHT_LANE), road.track(Role.LEFT_LANE)
        if right is not None and (left is None or choice(2, road.seed, Purpose.SCENARIO_SIDE)):
            return right, LANE_WIDTH_M
        if left is None:
            raise LookupError(f"route {road.tables.route.route_id!r} has no other lane")
        return left, -LANE_WIDTH_M

    def _ahead_m(self, road: EmptyRoad) -> float:
        return road.draw(8.0, 17.0, Purpose.SCENARIO_PLACE)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The vehicle, beside and ahead of the ego, and another one behind it."""
        track, _ = self._side(road)
        size = road.pick(VEHICLES, Purpose.TRAFFIC_BODY, 90)
        eagerness = road.draw(0.62, 0.85, Purpose.SCENARIO_SPEED)
        beside_m = road.beside(START_M, track)
        speed = road.advisory_mps(START_M)
        rate = road.draw(1.2, 2.2, Purpose.SCENARIO_STRENGTH)
        first = road.vehicle(
            size, beside_m + self._ahead_m(road), track, eagerness=eagerness, speed_mps=speed, lateral_mps=rate
        )
        follower = road.vehicle(CAR, beside_m - road.draw(12.0, 30.0, Purpose.TRAFFIC_GAP, 90), track)
        return [first, follower]

    def update(self, scene: Scene, _tick: int) -> bool:
        """Keep its place beside the ego until the site, then move over and slow down."""
        road = scene.road
        track, offset_m = self._side(road)
        body, ego = scene.bodies[FIRST_ROW], scene.feet[track, EGO]
        if scene.hazard_tick < 0 and scene.way_to_m(road.site_m) > 0.0:
            lag_m = float(ego["arc_m"] - body["arc_m"]) + self._ahead_m(road)
            slower_mps = float(ego["speed_mps"] - body["speed_mps"])
            scene.command(FIRST_ROW, _STATIONED_GAIN[0] * lag_m + _STATIONED_GAIN[1] * slower_mps)
            return False
        body["commanded_accel_mps2"] = math.nan
        body["goal_offset_m"] = offset_m
        return True


class _FromStandstill(Scenario):
    """A standing vehicle pulls out; active once it moves."""

    lead_s: tuple[float, float]
    """How long before the ego, at its present speed, would reach the vehicle's front it pulls out."""

    def _goal_offset_m(self) -> float:
        """Offset of the ego's lane on the vehicle's track."""
        return 0.0

    def update(self, scene: Scene, _tick: int) -> bool:
        """Stand until the ego is close, then pull out."""
        road, body = scene.road, scene.bodies[FIRST_ROW]
        if scene.hazard_tick < 0:
            at_m = float(scene.feet["arc_m"][EGO_TRACK, FIRST_ROW])
            if scene.time_to_s(at_m) > road.draw(*self.lead_s, Purpose.SCENARIO_TIMING):
                body["commanded_accel_mps2"] = 0.0
                return False
            body["commanded_accel_mps2"] = road.draw(1.2, 2.2, Purpose.SCENARIO_STRENGTH)
            body["goal_offset_m"] = self._goal_offset_m()
        elif abs(float(body["offset_m"] - body["goal_offset_m"])) < 0.1:
            body["commanded_accel_mps2"] = math.nan
        return True


class StaticCutIn(_FromStandstill):
    """From a queue that stands in the right lane."""

    name = "StaticCutIn"
    trigger = brake_trigger("static-cut-in-onset 1")
    ambient = Ambient(beside=False)
    lead_s = (2.4, 3.4)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A stretch of road with a lane of the ego's direction to the right, that traffic can be placed on."""
        on_road = route.place is Place.ROAD and route.has_clear_side_lanes
        return on_road and route.site_lane.right is LaneSide.SAME_DIRECTION

    def _goal_offset_m(self) -> float:
        return LANE_WIDTH_M

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The vehicle that cuts in, and the queue before and behind it."""
        track = road.track(Role.RIGHT_LANE)
        if track is None:
            raise LookupError(f"route {road.tables.route.route_id!r} has no lane to the right")
        size = road.pick((CAR, VAN), Purpose.SCENARIO_BODY)
        at_m = road.beside(road.site_m, track)
        first = road.vehicle(size, at_m, track, speed_mps=0.0, lateral_mps=1.6)
        queue, front_m, back_m = [], at_m + size.length_m / 2 + 5.0, at_m - size.length_m / 2
        for index in range(road.count(_QUEUE, Purpose.SCENARIO_COUNT)):
            other = road.pick((*VEHICLES, BOX_TRUCK), Purpose.TRAFFIC_BODY, 90 + index)
            step_m = other.length_m + _QUEUE_GAP_M
            if index % 2:
                queue.append(road.standing(Kind.VEHICLE, other, back_m - step_m + other.length_m / 2, 0.0, track=track))
                back_m -= step_m
            else:
                queue.append(road.standing(Kind.VEHICLE, other, front_m + other.length_m / 2, 0.0, track=track))
                front_m += step_m
        return [first, *queue]


class ParkingCutIn(_FromStandstill):
    """From the parking strip."""

    name = "ParkingCutIn"
    trigger = brake_trigger("parking-cut-in-onset 1")
    lead_s = (2.4, 3.6)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A street with a parking strip."""
        return route.place is Place.ROAD and route.site_lane.right is LaneSide.PARKING

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The vehicle that pulls out."""
        size = road.pick((CAR, VAN), Purpose.SCENARIO_BODY)
        return [road.vehicle(size, road.site_m, offset_m=PARKED_OFFSET_M, speed_mps=0.0, lateral_mps=1.5)]
