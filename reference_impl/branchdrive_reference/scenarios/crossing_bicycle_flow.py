"""CrossingBicycleFlow: behind a turn, cyclists cross the ego's road one after the other on their own path."""

from __future__ import annotations

import math

from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.scenario import Scene
from branchdrive_reference.scenarios.sizes import BICYCLE
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import brake_trigger
from branchdrive_reference.scenarios.vehicle_turning_route import VehicleTurningRoute
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import Behaviour, Body, Kind

__all__ = ["CrossingBicycleFlow"]

_ACTIVE_M = 45.0
_FLOW = (3, 6)
_HEADWAY_S = (1.2, 2.4)


class CrossingBicycleFlow(VehicleTurningRoute):
    """See the module; the hazard is active from some way before the crossing."""

    name = "CrossingBicycleFlow"
    trigger = brake_trigger("bicycle-flow-onset 1")
    speed_mps = (3.2, 4.6)

    def bodies(self, stage: Stage) -> list[Body]:
        """The cyclists, on the move from the beginning, timed around the ego's arrival."""
        place_m, speed = self.place_m(stage), self.draw_speed_mps(stage)
        side = 1 if choice(2, stage.seed, Purpose.SCENARIO_SIDE) else -1
        time_s = stage.ego_arrival_s(place_m) + stage.draw(-2.5, 0.0, Purpose.SCENARIO_TIMING)
        bodies = []
        for index in range(stage.count(_FLOW, Purpose.SCENARIO_COUNT)):
            x, y, yaw = interpolate(stage.tables.path(EGO_TRACK), place_m, side * speed * time_s)
            heading = yaw + math.copysign(math.pi / 2, -side)
            bodies.append(Body(Kind.CYCLE, Behaviour.WALKING, BICYCLE, x, y, heading, speed, travel_m=500.0))
            time_s += stage.draw(*_HEADWAY_S, Purpose.SCENARIO_GAP, index)
        return bodies

    def update(self, scene: Scene, _tick: int) -> bool:
        """The cyclists ride on."""
        return scene.way_to_m(self.place_m(scene.stage)) < _ACTIVE_M
