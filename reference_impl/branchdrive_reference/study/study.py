"""The numbers that a study prints, as data."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["CollectedDrives", "CollectedGroups", "Equality", "Rate", "Scenario", "Spread", "Study"]

Rate = float | None
"""A share in ``[0, 1]``; ``None`` where there is nothing to take a share of."""


@dataclass(frozen=True)
class CollectedGroups:
    """What was collected.

    Attributes:
        num_groups: Branch groups.
        num_integrity_complete: Groups that are integrity-complete.
        num_without_complete: Groups that lack a complete attempt of some policy.
        num_noncompliant: Groups with a complete attempt of every policy that break a rule all the same.
        num_without_nominal: Groups without a compliant nominal.
        scenario_types: Groups by scenario type.
        towns: Groups by town.
        branches: Groups by the kind of their branch: ``onset``, ``early``, ``quiet``, or ``none`` without a branch.
        num_route_clusters: Clusters of route geometry.
        num_ticks: Control rows.
        attempts: Attempts by status.
    """

    num_groups: int
    num_integrity_complete: int
    num_without_complete: int
    num_noncompliant: int
    num_without_nominal: int
    scenario_types: dict[str, int]
    towns: dict[str, int]
    branches: dict[str, int]
    num_route_clusters: int
    num_ticks: int
    attempts: dict[str, int]


@dataclass(frozen=True)
class CollectedDrives:
    """What a dataset of drives holds in place of branch groups.

    Attributes:
        num_contexts: Contexts, each with the nominal rollout that its drives begin like.
        num_drives: Drives.
        num_decisions: Decisions of all drives.
        choices: Decisions by action key, in the order of the bank.
    """

    num_contexts: int
    num_drives: int
    num_decisions: int
    choices: dict[str, int]


@dataclass(frozen=True)
class Scenario:
    """Outcomes of the integrity-complete groups of one scenario type, of one kind of branch, or of all.

    Attributes:
        scenario_type: Its name or that of the kind, ``all`` for all.
        num_groups: Integrity-complete groups.
        completed: Share of nominals that completed their route.
        clean: Share that also had no collision and no infraction among those monitored.
        collided: Share of candidates of each family that ever touched anything.
        collided_in_window: The same within 2.5 s of the branch.
        num_ranked: Groups in which every candidate has a utility.
        best: Share of these groups whose best candidate is of each family.
        worst: The same for the worst candidate.
        best_collided: Share of these groups whose best candidate ever touched anything; ties are shared.
        best_collided_in_window: The same within 2.5 s of the branch.
    """

    scenario_type: str
    num_groups: int
    completed: Rate
    clean: Rate
    collided: dict[str, Rate]
    collided_in_window: dict[str, Rate]
    num_ranked: int
    best: dict[str, Rate]
    worst: dict[str, Rate]
    best_collided: Rate
    best_collided_in_window: Rate


@dataclass(frozen=True)
class Spread:
    """Distribution of one discrepancy; a quantile is a value that occurs, ``None`` where it is infinite.

    Attributes:
        variable: Its name.
        unit: Its unit, empty where it has none.
        extended: Whether it is one of the extended variables.
        num: Pairs.
        median: Quantile 0.5.
        q90: Quantile 0.9.
        q99: Quantile 0.99.
        max: Largest value.
        zero: Share that is exactly 0.
        num_infinite: Pairs in which a value is missing on one side only.
    """

    variable: str
    unit: str
    extended: bool
    num: int
    median: float | None
    q90: float | None
    q99: float | None
    max: float | None
    zero: Rate
    num_infinite: int


@dataclass(frozen=True)
class Equality:
    """Nominal replays against their nominals, bit by bit.

    Attributes:
        num_replays: Nominal replays.
        num_compared: Complete ones whose nominal is complete too.
        num_equal: Those that are equal in every table.
        differing: Those that differ, by compared table.
    """

    num_replays: int
    num_compared: int
    num_equal: int
    differing: dict[str, int]


@dataclass(frozen=True)
class Study:
    """Everything that `branchdrive study` prints.

    Attributes:
        dataset_id: Of the descriptor.
        dataset_version: Of the descriptor.
        population: What was collected.
        drives: What a dataset of drives holds; ``None`` of branch groups.
        profile: Profile of the ranking.
        not_monitored: Results that some canonical nominal does not monitor, as text.
        has_evidence: Whether the dataset claims risk evidence: without it nothing is known of collisions and ranks.
        scenarios: One row for each scenario type.
        branches: One row for each kind of branch.
        overall: All groups together.
        interventions: Discrepancies of canonical interventions.
        nominal_replays: Discrepancies of compliant nominal replays.
        equality: Whether nominal replays repeat their nominals.
    """

    dataset_id: str
    dataset_version: str
    population: CollectedGroups
    drives: CollectedDrives | None
    profile: str
    not_monitored: tuple[str, ...]
    has_evidence: bool
    scenarios: tuple[Scenario, ...]
    branches: tuple[Scenario, ...]
    overall: Scenario
    interventions: tuple[Spread, ...]
    nominal_replays: tuple[Spread, ...]
    equality: Equality

    def to_json(self) -> dict[str, Any]:
        """The study as a JSON document."""
        return asdict(self)
