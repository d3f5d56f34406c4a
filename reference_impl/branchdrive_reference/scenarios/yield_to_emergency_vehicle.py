"""YieldToEmergencyVehicle: an ambulance comes from behind; the expert makes way and lets it pass."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Ambient, Scenario, Scene
from branchdrive_reference.scenarios.standing_obstacle import obstacle_trigger
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.route import START_M, Place, Route
from branchdrive_reference.town.track import EGO_TRACK, Role
from branchdrive_reference.world.body import CAR, EGO, VAN, Body, Heed

__all__ = ["YieldToEmergencyVehicle"]

_HEARD_M = 42.0
_BEFORE_SITE_S = 4.5


class YieldToEmergencyVehicle(Scenario):
    """See the module; the hazard is active once the siren is heard."""

    name = "YieldToEmergencyVehicle"
    trigger = obstacle_trigger("emergency-vehicle-onset 1")
    ambient = Ambient(behind=False, ahead=False, beside=False)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A stretch with another lane of the ego's direction, and a way behind it on which the ambulance is fast."""
        beside = LaneSide.SAME_DIRECTION in (route.site_lane.left, route.site_lane.right)
        return beside and (route.place is Place.MOTORWAY or (route.place is Place.ROAD and route.early))

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The ambulance, so far behind that it is heard near the site; the right lane is free, the left is not."""
        faster = road.draw(1.35, 1.55, Purpose.SCENARIO_SPEED)
        speed = road.advisory_mps(START_M)
        heard_s = road.ego_arrival_s(road.site_m) - _BEFORE_SITE_S
        arc_m = START_M - _HEARD_M - (faster - 1.0) * speed * heard_s
        ambulance = road.vehicle(VAN, arc_m, eagerness=faster, headway_s=0.4, heeds=Heed.NOTHING, siren=True)
        left = road.track(Role.LEFT_LANE)
        if left is None or road.track(Role.RIGHT_LANE) is None:
            return [ambulance]
        beside_m = road.beside(START_M, left)
        gaps_m = [road.draw(low, low + 15.0, Purpose.TRAFFIC_GAP, 95 + i) for i, low in enumerate((-25.0, -5.0, 15.0))]
        return [ambulance, *(road.vehicle(CAR, beside_m + gap_m, left) for gap_m in gaps_m)]

    def update(self, scene: Scene, _tick: int) -> bool:
        """It drives by itself."""
        feet = scene.feet[EGO_TRACK]
        return scene.hazard_tick >= 0 or bool(feet["arc_m"][EGO] - feet["arc_m"][FIRST_ROW] < _HEARD_M)
