"""Accident: two crashed vehicles and one that came to help block the ego's lane."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.sizes import CAR, COMPACT, VAN
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.standing_obstacle import StandingObstacle, obstacle_trigger
from branchdrive_reference.world.body import Body, Kind

__all__ = ["Accident", "AccidentTwoWays"]

_GAPS_M = (0.0, 9.5, 15.5)


class Accident(StandingObstacle):
    """Passed on another lane of the ego's direction."""

    name = "Accident"
    trigger = obstacle_trigger("accident-onset 1")

    def bodies(self, stage: Stage) -> list[Body]:
        """The helper first, then the two that crashed, askew."""
        sizes, turns_rad = (VAN, CAR, COMPACT), (0.0, 0.25, -0.45)
        return [
            stage.standing(
                Kind.VEHICLE, size, stage.site_m + gap_m, stage.draw(-0.6, 0.0, Purpose.SCENARIO_PLACE, index),
                turn_rad=turn_rad * stage.draw(0.6, 1.2, Purpose.SCENARIO_ANGLE, index),
            )
            for index, (size, gap_m, turn_rad) in enumerate(zip(sizes, _GAPS_M, turns_rad, strict=True))
        ]  # fmt: skip


class AccidentTwoWays(Accident):
    """Passed on the oncoming lane."""

    name = "AccidentTwoWays"
    two_ways = True
    trigger = obstacle_trigger("accident-two-ways-onset 1")
