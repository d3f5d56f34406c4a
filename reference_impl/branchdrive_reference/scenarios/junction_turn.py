"""Ways through a junction on which the expert waits: for a gap in a flow, for green, or at a stop sign."""

from __future__ import annotations

from branchdrive.collector.trigger import brake_trigger
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.flow import flow, rival_tracks, side_tracks
from branchdrive_reference.scenarios.scenario import Ambient, Scenario, Scene, green_on_arrival
from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.town.track import EGO_TRACK, route_tracks
from branchdrive_reference.world.body import Body

__all__ = [
    "NonSignalizedJunctionLeftTurn",
    "NonSignalizedJunctionRightTurn",
    "SignalizedJunctionLeftTurn",
    "VanillaNonSignalizedTurnEncounterStopsign",
    "VanillaSignalizedTurnEncounterRedLight",
]

_ACTIVE_M = 55.0
_FLOW = (4, 7)
_HEADWAY_S = (1.7, 2.8)
_EARLY_S = (-4.0, -1.5)
"""When the first vehicle is in the ego's way, after the ego would be at the line."""

_LINE_ACTIVE_M = 60.0
_GREEN_AFTER_S = (6.0, 10.0)
_LINE_HEADWAY_S = (1.8, 3.0)
_LINE_COUNT = 4


class JunctionTurn(Scenario):
    """What these scenarios share; the hazard is active from some way before the junction."""

    ambient = Ambient(ahead=False, crossing=False)
    turn: Turn
    signalized: bool

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """A turn of the right kind at which the ego yields to somebody."""
        if route.place is not Place.JUNCTION or route.turn is not self.turn or crossroads is None:
            return False
        if (crossroads.control is Control.SIGNAL) != self.signalized:
            return False
        conflicts = route_tracks(route.town, route.route_id).conflicts
        return bool(((conflicts["track"] == EGO_TRACK) & (conflicts["yields"] == 1)).any())

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """One flow, from a side that has priority."""
        rivals = rival_tracks(road, ego_yields=True)
        track = road.pick(rivals, Purpose.SCENARIO_SIDE)
        _, other_at_m = road.meeting_m(track)
        first_s = road.ego_arrival_s(road.site_m) + road.draw(*_EARLY_S, Purpose.SCENARIO_TIMING)
        count = road.count(_FLOW, Purpose.SCENARIO_COUNT)
        eagerness = road.draw(0.9, 1.02, Purpose.SCENARIO_SPEED)
        return flow(road, track, other_at_m, max(first_s, 1.0), count, _HEADWAY_S, eagerness=eagerness)

    def update(self, scene: Scene, _tick: int) -> bool:
        """The flow drives by itself."""
        return scene.way_to_m(scene.road.site_m) < _ACTIVE_M

    def signal_offset(self, road: EmptyRoad) -> int:
        """The ego comes at green."""
        return green_on_arrival(road, road.draw(4.0, 6.0, Purpose.SIGNAL_OFFSET))


class SignalizedJunctionLeftTurn(JunctionTurn):
    """A left turn at green, across the opposite flow."""

    name = "SignalizedJunctionLeftTurn"
    trigger = brake_trigger("signalized-left-onset 1")
    turn, signalized = Turn.LEFT, True


class NonSignalizedJunctionLeftTurn(JunctionTurn):
    """A left turn without signals."""

    name = "NonSignalizedJunctionLeftTurn"
    trigger = brake_trigger("non-signalized-left-onset 1")
    turn, signalized = Turn.LEFT, False


class NonSignalizedJunctionRightTurn(JunctionTurn):
    """A right turn into a flow that has priority."""

    name = "NonSignalizedJunctionRightTurn"
    trigger = brake_trigger("non-signalized-right-onset 1")
    turn, signalized = Turn.RIGHT, False


class EncounterSign(Scenario):
    """What these scenarios share: from one side a flow passes while the ego has to wait."""

    ambient = Ambient(ahead=False, crossing=False)

    def rivals(self, road: EmptyRoad) -> list[int]:
        """Tracks on which the flow may come."""
        return rival_tracks(road, ego_yields=True)

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The flow, if there is a side from which it can come."""
        rivals = self.rivals(road)
        if not rivals:
            return []
        track = road.pick(rivals, Purpose.SCENARIO_SIDE)
        first_s = road.ego_arrival_s(road.site_m) + road.draw(-2.5, -0.5, Purpose.SCENARIO_TIMING)
        return flow(road, track, road.meeting_m(track)[1], first_s, _LINE_COUNT, _LINE_HEADWAY_S)

    def update(self, scene: Scene, _tick: int) -> bool:
        """Active from some way before the line."""
        return scene.way_to_m(scene.road.site_m) < _LINE_ACTIVE_M


class VanillaSignalizedTurnEncounterRedLight(EncounterSign):
    """The light is red when the ego comes, after Bench2Drive's type of this name."""

    name = "VanillaSignalizedTurnEncounterRedLight"
    trigger = brake_trigger("red-light-onset 1")

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """Any way through a junction with signals."""
        return route.place is Place.JUNCTION and crossroads is not None and crossroads.control is Control.SIGNAL

    def rivals(self, road: EmptyRoad) -> list[int]:
        """The sides, which have green."""
        return side_tracks(road.tables)

    def signal_offset(self, road: EmptyRoad) -> int:
        """Green begins some time after the ego would be at the line."""
        return green_on_arrival(road, -road.draw(*_GREEN_AFTER_S, Purpose.SIGNAL_OFFSET))


class VanillaNonSignalizedTurnEncounterStopsign(EncounterSign):
    """The ego comes to a stop sign, after Bench2Drive's type of this name."""

    name = "VanillaNonSignalizedTurnEncounterStopsign"
    trigger = brake_trigger("stop-sign-onset 1")

    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """Any way through a junction with stop signs, from an approach that has one."""
        if route.place is not Place.JUNCTION or crossroads is None or crossroads.control is not Control.STOP:
            return False
        return route.chain[0].way[0] not in crossroads.major
