"""A vehicle from the side drives into the junction although the ego may go: past a red light, or without priority."""

from __future__ import annotations

import math

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.flow import arrive_with_ego, rival_tracks, side_tracks
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Ambient, Scenario, Scene, green_on_arrival
from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.town.track import EGO_TRACK, route_tracks
from branchdrive_reference.world.body import CAR, VAN, Body, Heed

__all__ = ["OppositeVehicleRunningRedLight", "OppositeVehicleTakingPriority"]

_VEHICLES = (CAR, VAN)
_ACTIVE_S = 4.0
_FREE_S = 1.8
"""From this time before the meeting on, the vehicle keeps its speed."""


class OppositeVehicle(Scenario):
    """What these scenarios share; the hazard is active shortly before the two would meet."""

    ambient = Ambient(ahead=False, crossing=False)

    def rivals(self, road: EmptyRoad) -> list[int]:
        """Tracks on which the vehicle may come."""
        return rival_tracks(road, ego_yields=False)

    def _rival(self, road: EmptyRoad) -> int:
        rivals = self.rivals(road)
        return road.pick(rivals, Purpose.SCENARIO_SIDE)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The vehicle, which heeds nothing."""
        track = self._rival(road)
        at_m, other_at_m = road.meeting_m(track)
        eagerness = road.draw(0.85, 1.15, Purpose.SCENARIO_SPEED)
        arc_m = road.arc_before(track, other_at_m, road.ego_arrival_s(at_m), eagerness)
        size = road.pick(_VEHICLES, Purpose.SCENARIO_BODY)
        return [road.vehicle(size, arc_m, track, eagerness=eagerness, heeds=Heed.NOTHING)]

    def update(self, scene: Scene, _tick: int) -> bool:
        """Time the vehicle to the ego, then let it go."""
        road = scene.road
        at_m, other_at_m = road.meeting_m(self._rival(road))
        time_s = scene.time_to_s(at_m)
        if scene.hazard_tick >= 0 and not math.isnan(scene.bodies["commanded_accel_mps2"][FIRST_ROW]):
            if time_s < _FREE_S:
                scene.bodies["commanded_accel_mps2"][FIRST_ROW] = 0.0
        elif scene.hazard_tick < 0:
            late_s = road.draw(-1.1, 0.2, Purpose.SCENARIO_TIMING)
            arrive_with_ego(scene, FIRST_ROW, at_m, other_at_m, late_s)
        return scene.hazard_tick >= 0 or time_s < _ACTIVE_S

    def signal_offset(self, road: EmptyRoad) -> int:
        """The ego comes at green."""
        return green_on_arrival(road, road.draw(4.0, 7.0, Purpose.SIGNAL_OFFSET))


class OppositeVehicleRunningRedLight(OppositeVehicle):
    """It comes from a side whose light is red."""

    name = "OppositeVehicleRunningRedLight"
    trigger = brake_trigger("running-red-light-onset 1")

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """The way through a junction with signals and a side road from which the ego's way is crossed."""
        if route.place is not Place.JUNCTION or route.turn is Turn.RIGHT or crossroads is None:
            return False
        return crossroads.control is Control.SIGNAL and bool(side_tracks(route_tracks(route.town, route.route_id)))

    def rivals(self, road: EmptyRoad) -> list[int]:
        """The sides."""
        return side_tracks(road.tables)


class OppositeVehicleTakingPriority(OppositeVehicle):
    """It ought to yield to the ego."""

    name = "OppositeVehicleTakingPriority"
    trigger = brake_trigger("taking-priority-onset 1")

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """A junction without signals at which somebody yields to the ego, and the ego to no sign."""
        if route.place is not Place.JUNCTION or crossroads is None or crossroads.control is Control.SIGNAL:
            return False
        conflicts = route_tracks(route.town, route.route_id).conflicts
        yields = bool(((conflicts["other"] == EGO_TRACK) & (conflicts["yields"] == 1)).any())
        return yields and route.chain[0].way[0] in crossroads.major
