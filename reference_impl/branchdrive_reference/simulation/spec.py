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
        town: Recorded name of the town.
        route_id: Route of the town.
        environment: Name of a weather and light condition.
        seed: Seed of traffic and scenario.
        timeout_ticks: The simulator gives up at this tick.
        replay: 0 for a nominal pass; for every other attempt of a group a positive key of its own.
        replay_noise: Strength of the declared noise that a replay adds; 0 replays exactly.
    """

    scenario_type: str
    town: str
    route_id: str
    environment: str
    seed: int
    timeout_ticks: int = ROUTE_TIMEOUT_TICKS
    replay: int = 0
    replay_noise: float = 0.0
