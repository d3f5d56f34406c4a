"""Which groups a collection consists of: a pure function of its seed and the group's index.

Presets of a collection: how many groups, how noisy, with which faults.

`paper` leaves a funnel of the paper's shape; docs/decisions/0012-faults-as-declared-rates.md derives
its rates. Source: paper, "Research Questions and Experimental Protocol", table of the population.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from types import MappingProxyType

from branchdrive.errors import UsageError
from branchdrive_reference.collect.fault import Fault
from branchdrive_reference.noise import Purpose, choice, integer
from branchdrive_reference.scenarios.registry import SCENARIOS, scenario_routes
from branchdrive_reference.simulation.branch_kind import BranchKind, drawn_kind
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.town.signal import ENVIRONMENTS

__all__ = [
    "BRANCH_PRESETS",
    "CONSEQUENTIAL",
    "DEEP",
    "FAULT_PRESETS",
    "PRESETS",
    "PlannedGroup",
    "Preset",
    "plan_group",
    "select_scenarios",
]


@dataclass(frozen=True)
class PlannedGroup:
    """One planned group.

    Attributes:
        index: Place in the dataset, from 0.
        group_id: Identity of the group.
        spec: The world that all its rollouts share.
        kind: Kind of branch that its trigger is asked for.
        repetition: Recorded repetition index; every group draws its own seed, so none repeats.
    """

    index: int
    group_id: str
    spec: WorldSpec
    kind: BranchKind = BranchKind.ONSET
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


def plan_group(
    seed: int, index: int, scenario_types: Sequence[str] = (), branches: Mapping[str, float] = MappingProxyType({})
) -> PlannedGroup:
    """The group at `index` of the collection with `seed`: scenario types take turns, the rest is drawn.

    Args:
        seed: Seed of the collection.
        index: Place of the group.
        scenario_types: Scenario types that take turns, in registered order; all if there is none.
        branches: Shares of groups by the kind of branch that is asked for; the others branch at the manoeuvre.
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
    return PlannedGroup(index, f"g{index:05d}-{scenario.name.lower()}", spec, drawn_kind(branches, seed, index))


@dataclass(frozen=True)
class Preset:
    """Defaults of a collection.

    Attributes:
        num_groups: Branch groups.
        replay_noise: Strength of the noise of replays.
        faults: Rates of injected faults by name.
        branches: Shares of groups by the kind of branch that is asked for; the others branch at the manoeuvre.
        scenario_types: Scenario types that take turns; all if there is none.
    """

    num_groups: int
    replay_noise: float = 0.0
    faults: Mapping[str, float] = field(default_factory=dict)
    branches: Mapping[str, float] = field(default_factory=dict)
    scenario_types: tuple[str, ...] = ()


_BENCHMARK_FAULTS: Mapping[str, float] = {
    Fault.PARTIAL: 0.008,
    Fault.QUARANTINED: 0.002,
    Fault.EARLY_BRANCH: 0.001,
    Fault.LATE_BRANCH: 0.001,
    Fault.WRONG_DURATION: 0.001,
    Fault.TRUNCATED_LOG: 0.0005,
    Fault.DROPPED_FRAME: 0.0005,
    Fault.UNRETRIED: 0.05,
    Fault.DUPLICATE: 0.01,
    Fault.ABANDONED: 0.03,
    Fault.SEED_DISAGREEMENT: 0.003,
    Fault.ONLINE_STEERING: 0.05,
}

CONSEQUENTIAL = (
    "Accident",
    "AccidentTwoWays",
    "BlockedIntersection",
    "ConstructionObstacleTwoWays",
    "CrossingBicycleFlow",
    "DynamicObjectCrossing",
    "HardBrakeRoute",
    "HazardAtSideLane",
    "HazardAtSideLaneTwoWays",
    "HighwayCutIn",
    "OppositeVehicleTakingPriority",
    "ParkedObstacle",
    "ParkedObstacleTwoWays",
    "ParkingCrossingPedestrian",
    "ParkingCutIn",
    "PedestrianCrossing",
    "StaticCutIn",
)
"""Scenario types whose consequence lies inside the window: who accelerates at the manoeuvre touches something within
2.5 s in two drives of five or more, docs/decisions/0022-branches-in-context.md."""

DEEP = (
    "AccidentTwoWays",
    "CrossingBicycleFlow",
    "HardBrakeRoute",
    "HazardAtSideLaneTwoWays",
    "HighwayCutIn",
    "OppositeVehicleTakingPriority",
)
"""Consequential types in which others move, and in which accelerating touches something neither almost always nor
seldom, without two in which a table by type is nearly right; docs/decisions/0045-deep-and-trees.md."""

PRESETS: Mapping[str, Preset] = {
    "demo": Preset(num_groups=29),
    "benchmark": Preset(
        num_groups=1_000,
        replay_noise=1.0,
        faults=_BENCHMARK_FAULTS,
    ),
    "context": Preset(
        num_groups=1_800,
        replay_noise=1.0,
        faults=_BENCHMARK_FAULTS,
        branches={BranchKind.EARLY: 0.1, BranchKind.QUIET: 0.6},
        scenario_types=CONSEQUENTIAL,
    ),
    "deep": Preset(
        num_groups=900,
        replay_noise=1.0,
        faults=_BENCHMARK_FAULTS,
        branches={BranchKind.EARLY: 0.4},
        scenario_types=DEEP,
    ),
    "paper": Preset(
        num_groups=2_467,
        replay_noise=1.0,
        faults={
            Fault.PARTIAL: 0.013,
            Fault.QUARANTINED: 0.004,
            Fault.EARLY_BRANCH: 0.01,
            Fault.LATE_BRANCH: 0.01,
            Fault.WRONG_DURATION: 0.017,
            Fault.TRUNCATED_LOG: 0.005,
            Fault.DROPPED_FRAME: 0.002,
            Fault.UNRETRIED: 0.2,
            Fault.DUPLICATE: 0.014,
            Fault.ABANDONED: 0.242,
            Fault.SEED_DISAGREEMENT: 0.0032,
            Fault.ONLINE_STEERING: 0.388,
        },
    ),
}
"""Presets by name."""

FAULT_PRESETS: Mapping[str, Mapping[str, float]] = {
    name: preset.faults for name, preset in PRESETS.items() if preset.faults
}
"""Rates of the presets that have any, by the preset's name."""

BRANCH_PRESETS: Mapping[str, Mapping[str, float]] = {
    name: preset.branches for name, preset in PRESETS.items() if preset.branches
}
"""Shares of branches of the presets that have any, by the preset's name."""
