"""Standing obstacles in the ego's lane: the expert passes them on the neighbour lane or waits behind them.

On roads with several lanes it uses the next lane of its own direction, on two-way roads the oncoming one.
"""

from __future__ import annotations

from branchdrive.collector.trigger import Signal, Trigger
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import Scenario, Scene
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.route import Place, Route, obstacle_sight_m
from branchdrive_reference.world.body import BARRIER, CAR, COMPACT, CONE, CONTAINER, VAN, Body, Kind

__all__ = [
    "Accident",
    "AccidentTwoWays",
    "ConstructionObstacle",
    "ConstructionObstacleTwoWays",
    "ParkedObstacle",
    "ParkedObstacleTwoWays",
    "StandingObstacle",
    "obstacle_trigger",
]

_SIGHT_MARGIN_M = 10.0

_CRASH_GAPS_M = (0.0, 9.5, 15.5)
_CONE_SPACING_M = 5.0
_CONE_OFFSET_M = 1.25
_OBSTACLES = ((Kind.VEHICLE, CAR), (Kind.VEHICLE, VAN), (Kind.STATIC, CONTAINER))


def obstacle_trigger(definition: str) -> Trigger:
    """A trigger that finds the lane shift around an obstacle, or the braking before it."""
    return Trigger(definition, (Signal("lane_shift", 0.25), Signal("throttle_release", 0.02), Signal("brake", 0.05)))


class StandingObstacle(Scenario):
    """What these scenarios share; the hazard is active once the obstacle is in sight."""

    two_ways = False
    """Whether only the oncoming lane is free to pass."""

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A stretch of road with the kind of neighbour lane that is passed on."""
        if route.place is not Place.ROAD and (self.two_ways or route.place is not Place.MOTORWAY):
            return False
        beside = LaneSide.SAME_DIRECTION in (route.site_lane.left, route.site_lane.right)
        return beside != self.two_ways

    def update(self, scene: Scene, _tick: int) -> bool:
        """Nothing moves."""
        sight_m = obstacle_sight_m(float(scene.bodies["speed_mps"][0])) + _SIGHT_MARGIN_M
        return scene.way_to_m(scene.road.site_m) < sight_m


class Accident(StandingObstacle):
    """Two crashed vehicles and one that came to help; passed on another lane of the ego's direction."""

    name = "Accident"
    trigger = obstacle_trigger("accident-onset 1")

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The helper first, then the two that crashed, askew."""
        sizes, turns_rad = (VAN, CAR, COMPACT), (0.0, 0.25, -0.45)
        return [
            road.standing(
                Kind.VEHICLE, size, road.site_m + gap_m, road.draw(-0.6, 0.0, Purpose.SCENARIO_PLACE, index),
                turn_rad=turn_rad * road.draw(0.6, 1.2, Purpose.SCENARIO_ANGLE, index),
            )
            for index, (size, gap_m, turn_rad) in enumerate(zip(sizes, _CRASH_GAPS_M, turns_rad, strict=True))
        ]  # fmt: skip


class AccidentTwoWays(Accident):
    """Passed on the oncoming lane."""

    name = "AccidentTwoWays"
    two_ways = True
    trigger = obstacle_trigger("accident-two-ways-onset 1")


class ConstructionObstacle(StandingObstacle):
    """A barrier, cones and a container; passed on another lane of the ego's direction."""

    name = "ConstructionObstacle"
    trigger = obstacle_trigger("construction-obstacle-onset 1")

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The barrier across the lane, the container behind it, and a line of cones beside it."""
        site_m, offset_m = road.site_m, road.draw(-0.5, -0.2, Purpose.SCENARIO_PLACE)
        cones = road.count((2, 4), Purpose.SCENARIO_COUNT)
        return [
            road.standing(Kind.STATIC, BARRIER, site_m, offset_m),
            road.standing(Kind.STATIC, CONTAINER, site_m + 6.0, offset_m),
            *(
                road.standing(Kind.STATIC, CONE, site_m + 2.5 + _CONE_SPACING_M * index, offset_m + _CONE_OFFSET_M)
                for index in range(cones)
            ),
        ]


class ConstructionObstacleTwoWays(ConstructionObstacle):
    """Passed on the oncoming lane."""

    name = "ConstructionObstacleTwoWays"
    two_ways = True
    trigger = obstacle_trigger("construction-obstacle-two-ways-onset 1")


class ParkedObstacle(StandingObstacle):
    """A vehicle or container; passed on another lane of the ego's direction."""

    name = "ParkedObstacle"
    trigger = obstacle_trigger("parked-obstacle-onset 1")

    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The obstacle, a little to the right of the lane's centre and slightly askew."""
        kind, size = road.pick(_OBSTACLES, Purpose.SCENARIO_BODY)
        offset_m = road.draw(-0.7, -0.1, Purpose.SCENARIO_PLACE)
        turn_rad = road.draw(-0.06, 0.06, Purpose.SCENARIO_ANGLE)
        return [road.standing(kind, size, road.site_m, offset_m, turn_rad=turn_rad)]


class ParkedObstacleTwoWays(ParkedObstacle):
    """Passed on the oncoming lane."""

    name = "ParkedObstacleTwoWays"
    two_ways = True
    trigger = obstacle_trigger("parked-obstacle-two-ways-onset 1")
