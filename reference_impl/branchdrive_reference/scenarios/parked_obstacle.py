"""ParkedObstacle: a vehicle or container stands in the ego's lane."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.sizes import CAR, CONTAINER, VAN
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.standing_obstacle import StandingObstacle, obstacle_trigger
from branchdrive_reference.world.body import Body, Kind

__all__ = ["ParkedObstacle", "ParkedObstacleTwoWays"]

_OBSTACLES = ((Kind.VEHICLE, CAR), (Kind.VEHICLE, VAN), (Kind.STATIC, CONTAINER))


class ParkedObstacle(StandingObstacle):
    """Passed on another lane of the ego's direction."""

    name = "ParkedObstacle"
    trigger = obstacle_trigger("parked-obstacle-onset 1")

    def bodies(self, stage: Stage) -> list[Body]:
        """The obstacle, a little to the right of the lane's centre and slightly askew."""
        kind, size = stage.pick(_OBSTACLES, Purpose.SCENARIO_BODY)
        offset_m = stage.draw(-0.7, -0.1, Purpose.SCENARIO_PLACE)
        turn_rad = stage.draw(-0.06, 0.06, Purpose.SCENARIO_ANGLE)
        return [stage.standing(kind, size, stage.site_m, offset_m, turn_rad=turn_rad)]


class ParkedObstacleTwoWays(ParkedObstacle):
    """Passed on the oncoming lane."""

    name = "ParkedObstacleTwoWays"
    two_ways = True
    trigger = obstacle_trigger("parked-obstacle-two-ways-onset 1")
