"""ConstructionObstacle: a barrier, cones and a container close the ego's lane."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.sizes import BARRIER, CONE, CONTAINER
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.standing_obstacle import StandingObstacle, obstacle_trigger
from branchdrive_reference.world.body import Body, Kind

__all__ = ["ConstructionObstacle", "ConstructionObstacleTwoWays"]

_CONE_SPACING_M = 5.0
_CONE_OFFSET_M = 1.25


class ConstructionObstacle(StandingObstacle):
    """Passed on another lane of the ego's direction."""

    name = "ConstructionObstacle"
    trigger = obstacle_trigger("construction-obstacle-onset 1")

    def bodies(self, stage: Stage) -> list[Body]:
        """The barrier across the lane, the container behind it, and a line of cones beside it."""
        site_m, offset_m = stage.site_m, stage.draw(-0.5, -0.2, Purpose.SCENARIO_PLACE)
        cones = stage.count((2, 4), Purpose.SCENARIO_COUNT)
        return [
            stage.standing(Kind.STATIC, BARRIER, site_m, offset_m),
            stage.standing(Kind.STATIC, CONTAINER, site_m + 6.0, offset_m),
            *(
                stage.standing(Kind.STATIC, CONE, site_m + 2.5 + _CONE_SPACING_M * index, offset_m + _CONE_OFFSET_M)
                for index in range(cones)
            ),
        ]


class ConstructionObstacleTwoWays(ConstructionObstacle):
    """Passed on the oncoming lane."""

    name = "ConstructionObstacleTwoWays"
    two_ways = True
    trigger = obstacle_trigger("construction-obstacle-two-ways-onset 1")
