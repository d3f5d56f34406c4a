"""BlockedIntersection: right behind the junction a vehicle stands in the ego's lane for a while."""

from __future__ import annotations

import math

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Ambient, Scenario, Scene, green_on_arrival
from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.world.body import BOX_TRUCK, CAR, VAN, Body

__all__ = ["BlockedIntersection"]

_VEHICLES = (CAR, VAN, BOX_TRUCK)
_BEHIND_JUNCTION_M = (5.0, 9.0)
_ACTIVE_M = 50.0
_STANDS_S = (7.0, 10.0)


class BlockedIntersection(Scenario):
    """See the module; the hazard is active once the vehicle is in sight."""

    name = "BlockedIntersection"
    trigger = brake_trigger("blocked-intersection-onset 1")
    ambient = Ambient(ahead=False, crossing=False)

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """The way through a junction where the ego need not stop."""
        if route.place is not Place.JUNCTION or crossroads is None:
            return False
        return crossroads.control is Control.SIGNAL or route.chain[0].way[0] in crossroads.major

    def _place_m(self, road: EmptyRoad) -> float:
        return road.tables.route.junction_m[1] + road.draw(*_BEHIND_JUNCTION_M, Purpose.SCENARIO_PLACE)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The vehicle that stands there."""
        size = road.pick(_VEHICLES, Purpose.SCENARIO_BODY)
        return [road.vehicle(size, self._place_m(road), speed_mps=0.0)]

    def update(self, scene: Scene, tick: int) -> bool:
        """It drives on some time after it came into sight."""
        active = scene.hazard_tick >= 0 or scene.way_to_m(self._place_m(scene.road)) < _ACTIVE_M
        waited_s = scene.since_hazard_s(tick) if scene.hazard_tick >= 0 else 0.0
        stands = waited_s < scene.road.draw(*_STANDS_S, Purpose.SCENARIO_TIMING)
        scene.bodies["commanded_accel_mps2"][FIRST_ROW] = 0.0 if stands else math.nan
        return active

    def signal_offset(self, road: EmptyRoad) -> int:
        """The ego comes at green."""
        return green_on_arrival(road, 4.0)
