"""What a world is made from; equal specifications give equal bytes."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ROUTE_TIMEOUT_TICKS", "WorldSpec"]

ROUTE_TIMEOUT_TICKS = 900
"""When the simulator gives up on a route, unless a specification says otherwise."""


@dataclass(frozen=True)
class WorldSpec:
    """Specification of a rollout's world.

    Attributes:
        scenario_type: Name of a registered scenario.
        route_id: Route of the reference town.
        environment: Name of a weather and light condition.
        seed: Seed of traffic and scenario.
        timeout_ticks: The simulator gives up at this tick.
    """

    scenario_type: str
    route_id: str
    environment: str
    seed: int
    timeout_ticks: int = ROUTE_TIMEOUT_TICKS
