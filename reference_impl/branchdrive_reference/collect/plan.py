"""Which groups a collection consists of: a pure function of its seed and the group's index."""

from __future__ import annotations

from dataclasses import dataclass

from branchdrive_reference.noise import Purpose, choice, integer
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.town.environment import ENVIRONMENTS
from branchdrive_reference.town.reference_town import reference_town
from branchdrive_reference.town.route import town_routes

__all__ = ["GroupPlan", "plan_group"]


@dataclass(frozen=True)
class GroupPlan:
    """One planned group.

    Attributes:
        index: Place in the dataset, from 0.
        group_id: Identity of the group.
        spec: The world that all its rollouts share.
        repetition: Recorded repetition index; every group draws its own seed, so none repeats.
    """

    index: int
    group_id: str
    spec: WorldSpec
    repetition: int = 0


def plan_group(seed: int, index: int) -> GroupPlan:
    """The group at `index` of the collection with `seed`: scenario types take turns, the rest is drawn."""
    scenarios = tuple(SCENARIOS.values())
    scenario = scenarios[index % len(scenarios)]
    routes, environments = tuple(town_routes(reference_town())), tuple(ENVIRONMENTS)
    spec = WorldSpec(
        scenario_type=scenario.name,
        route_id=routes[choice(len(routes), seed, Purpose.PLAN_ROUTE, index)],
        environment=environments[choice(len(environments), seed, Purpose.PLAN_ENVIRONMENT, index)],
        seed=integer(seed, Purpose.PLAN_SEED, index),
    )
    return GroupPlan(index, f"g{index:05d}-{scenario.name.lower()}", spec)
