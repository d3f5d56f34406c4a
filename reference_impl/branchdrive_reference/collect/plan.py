"""Which groups a collection consists of: a pure function of its seed and the group's index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from branchdrive.errors import UsageError
from branchdrive_reference.noise import Purpose, choice, integer
from branchdrive_reference.scenarios.registry import SCENARIOS, scenario_routes
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.town.environment import ENVIRONMENTS

__all__ = ["GroupPlan", "plan_group", "select_scenarios"]


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


def select_scenarios(names: Sequence[str]) -> tuple[str, ...]:
    """The named scenario types in registered order, each once; empty if that is all of them, or none is named.

    Raises:
        UsageError: A name is not registered.
    """
    unknown = [name for name in names if name not in SCENARIOS]
    if unknown:
        lower = {name.lower(): name for name in SCENARIOS}
        close = get_close_matches(unknown[0].lower(), lower, n=1)
        hint = f" (did you mean {lower[close[0]]}?)" if close else ""
        raise UsageError(f"unknown scenario type {unknown[0]!r}{hint}; choose from {', '.join(SCENARIOS)}")
    selected = tuple(name for name in SCENARIOS if name in names)
    return selected if len(selected) < len(SCENARIOS) else ()


def plan_group(seed: int, index: int, scenario_types: Sequence[str] = ()) -> GroupPlan:
    """The group at `index` of the collection with `seed`: scenario types take turns, the rest is drawn.

    Args:
        seed: Seed of the collection.
        index: Place of the group.
        scenario_types: Scenario types that take turns, in registered order; all if there is none.
    """
    scenarios = tuple(s for s in SCENARIOS.values() if not scenario_types or s.name in scenario_types)
    scenario = scenarios[index % len(scenarios)]
    routes, environments = scenario_routes(scenario.name), tuple(ENVIRONMENTS)
    route = routes[choice(len(routes), seed, Purpose.PLAN_ROUTE, index)]
    spec = WorldSpec(
        scenario_type=scenario.name,
        town=route.town,
        route_id=route.route_id,
        environment=environments[choice(len(environments), seed, Purpose.PLAN_ENVIRONMENT, index)],
        seed=integer(seed, Purpose.PLAN_SEED, index),
    )
    return GroupPlan(index, f"g{index:05d}-{scenario.name.lower()}", spec)
