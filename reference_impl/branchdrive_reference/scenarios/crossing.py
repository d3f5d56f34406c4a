"""Crossing the road on foot or by bicycle: waits beside the road and sets out in time to meet the ego."""

from __future__ import annotations

import math
from abc import abstractmethod

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Scenario, Scene
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import Lane, RoadClass
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.world.body import Behaviour, Body, Kind, Size

__all__ = ["Crossing"]

_BEYOND_KERB_M = 1.6


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
    def start_offset_m(self, stage: Stage) -> float:
        """Signed offset from the route at which it waits."""

    def place_m(self, stage: Stage) -> float:
        """Arc length on the route where it crosses."""
        return stage.site_m

    def lane(self, stage: Stage) -> Lane:
        """Lane of the route there."""
        return stage.tables.route.site_lane

    def draw_speed_mps(self, stage: Stage) -> float:
        """Speed of this world."""
        return stage.draw(*self.speed_mps, Purpose.SCENARIO_SPEED)

    def bodies(self, stage: Stage) -> list[Body]:
        """Who crosses, facing the road."""
        offset_m = self.start_offset_m(stage)
        turn_rad = math.copysign(math.pi / 2, -offset_m)
        return [stage.standing(self.kind, self.size, self.place_m(stage), offset_m, turn_rad=turn_rad)]

    def update(self, scene: Scene, _tick: int) -> bool:
        """Set out in time to be at the meeting point when the ego arrives."""
        if scene.hazard_tick >= 0:
            return True
        stage = scene.stage
        speed, start_m = self.draw_speed_mps(stage), self.start_offset_m(stage)
        meeting_m = stage.draw(*self.meeting_m, Purpose.SCENARIO_TIMING)
        if scene.time_to_s(self.place_m(stage)) > (abs(start_m) - meeting_m) / speed:
            return False
        lane = self.lane(stage)
        body = scene.bodies[FIRST_ROW]
        body["behaviour"], body["speed_mps"] = Behaviour.WALKING, speed
        body["travel_m"] = abs(start_m) + (lane.right_edge_m if start_m > 0 else lane.left_edge_m) + _BEYOND_KERB_M
        return True
