"""HardBrakeRoute: the vehicle ahead brakes hard to a stop, waits, and drives on."""

from __future__ import annotations

import math

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Ambient, Scenario, Scene
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.route import START_M, Place, Route
from branchdrive_reference.world.body import CAR, VAN, Body

__all__ = ["HardBrakeRoute"]

_LEADERS = (CAR, VAN)
_BEFORE_SITE_M = 20.0
"""How far before the site the leader brakes where no junction lies there."""


def _brake_m(road: EmptyRoad) -> float:
    """Arc length at which the leader brakes."""
    return road.site_m - (0.0 if road.tables.route.early else _BEFORE_SITE_M)


class HardBrakeRoute(Scenario):
    """See the module; the hazard is active once the leader brakes."""

    name = "HardBrakeRoute"
    trigger = brake_trigger("hard-brake-onset 1")
    ambient = Ambient(ahead=False)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """Any stretch of road or motorway."""
        return route.place in (Place.ROAD, Place.MOTORWAY)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The leader, a short headway before the ego."""
        speed = road.advisory_mps(START_M)
        headway_s = road.draw(1.5, 2.0, Purpose.SCENARIO_PLACE)
        size = road.pick(_LEADERS, Purpose.SCENARIO_BODY)
        arc_m = START_M + size.length_m + headway_s * speed
        return [road.vehicle(size, arc_m, eagerness=0.96, headway_s=1.4)]

    def update(self, scene: Scene, tick: int) -> bool:
        """Brake near the site for 2.6 to 4 s, standstill included."""
        road = scene.road
        if scene.hazard_tick < 0:
            if scene.bodies["arc_m"][FIRST_ROW] < _brake_m(road):
                return False
            decel = road.draw(5.0, 7.5, Purpose.SCENARIO_STRENGTH)
            scene.bodies["commanded_accel_mps2"][FIRST_ROW] = -decel
        elif scene.since_hazard_s(tick) > road.draw(2.6, 4.0, Purpose.SCENARIO_TIMING):
            scene.bodies["commanded_accel_mps2"][FIRST_ROW] = math.nan
        return True
