"""Standing obstacles in the ego's lane: the expert passes them on the neighbour lane or waits behind them.

On roads with several lanes it uses the next lane of its own direction, on two-way roads the oncoming one.
"""

from __future__ import annotations

from branchdrive_reference.scenarios.scenario import Scenario, Scene
from branchdrive_reference.scenarios.trigger import Signal, Trigger
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.route import Place, Route, obstacle_sight_m

__all__ = ["StandingObstacle", "obstacle_trigger"]

_SIGHT_MARGIN_M = 10.0


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
        return scene.way_to_m(scene.stage.site_m) < sight_m
