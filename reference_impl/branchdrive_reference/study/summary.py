"""From all that shards contribute to the numbers of a study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.columns import TICK_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.driving.discrepancy import CORE, EXTENDED
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, extreme_shares, fit_scale, utility
from branchdrive.quality.collected import Collected, Names
from branchdrive_reference.simulation.branch_kind import BranchKind
from branchdrive_reference.study.facts import RESULTS, Banks, Facts, Fidelity
from branchdrive_reference.study.study import CollectedDrives, CollectedGroups, Equality, Rate, Scenario, Spread, Study

__all__ = ["PROFILE", "summarise"]

PROFILE = "balanced"
"""Profile by which candidates are ranked."""


def summarise(facts: Facts, descriptor: Descriptor) -> Study:
    """The study of a dataset from all it contributes."""
    banks, bank = facts.banks, descriptor.action_bank
    targets = Targets(banks.targets, np.isfinite(banks.targets))
    shares = extreme_shares(utility(targets, fit_scale(targets), PROFILES[PROFILE]))
    everything = np.ones(len(banks.completed), bool)
    unseen = np.asarray(np.isnan(banks.results).any(axis=0))
    has_evidence = "evidence" in descriptor.tables
    tables = [table for table in TICK_TABLES if table in descriptor.tables]
    return Study(
        descriptor.dataset_id,
        descriptor.dataset_version,
        _population(facts.groups, facts.branch),
        _drives(facts, bank) if descriptor.is_of_drives else None,
        PROFILE,
        tuple(title for title, missing in zip(RESULTS.values(), unseen, strict=True) if missing),
        has_evidence,
        tuple(
            _scenario(name, banks.scenario_type == name, banks, shares, bank) for name in facts.groups.scenario_types
        ),
        tuple(_scenario(kind, banks.branch == kind, banks, shares, bank) for kind in _kinds(banks.branch)),
        _scenario("all", everything, banks, shares, bank),
        _spreads(facts.fidelity.interventions, has_evidence),
        _spreads(facts.fidelity.replays, has_evidence),
        _equality(facts.fidelity, tables),
    )


def _population(groups: Collected, branch: Names) -> CollectedGroups:
    return CollectedGroups(
        groups.num_groups,
        int(groups.is_complete.sum()),
        int((~groups.has_complete).sum()),
        int((groups.has_complete & ~groups.is_complete).sum()),
        int((~groups.has_nominal).sum()),
        groups.scenario_types,
        groups.towns,
        {kind: int((branch == kind).sum()) for kind in _kinds(branch)},
        groups.num_route_clusters,
        groups.num_ticks,
        dict(sorted(groups.statuses.items())),
    )


def _drives(facts: Facts, bank: ActionBank) -> CollectedDrives:
    found = Counter(facts.drives.choices.tolist())
    choices = {key: found[key] for key in bank.keys if found[key]}
    return CollectedDrives(facts.groups.num_groups, int(facts.drives.num_drives.sum()), found.total(), choices)


def _kinds(found: NDArray[np.object_]) -> list[str]:
    """Kinds of branch that are found, in their order."""
    return [kind for kind in (*map(str, BranchKind), "none") if (found == kind).any()]


def _rate(values: NDArray[Any]) -> Rate:
    """Mean of shares and flags; ``None`` where there is none or one is unknown."""
    mean = float(np.mean(values)) if values.size else np.nan
    return mean if np.isfinite(mean) else None


def _scenario(
    name: str,
    rows: NDArray[np.bool_],
    banks: Banks,
    shares: tuple[NDArray[np.float64], NDArray[np.float64]],
    bank: ActionBank,
) -> Scenario:
    family = np.array([policy.family for policy in bank.policies])
    ranked = rows & np.isfinite(shares[0]).all(axis=1)
    clean = banks.completed & (np.nansum(banks.results, axis=1) == 0)

    def by_family(rate: Any) -> dict[str, Rate]:
        return {name: rate(family == name) for name in dict.fromkeys(family.tolist())}

    return Scenario(
        name,
        int(rows.sum()),
        _rate(banks.completed[rows]),
        _rate(clean[rows]),
        by_family(lambda own: _rate(banks.collided[rows][:, own])),
        by_family(lambda own: _rate(banks.collided_in_window[rows][:, own])),
        int(ranked.sum()),
        by_family(lambda own: _rate(shares[0][ranked][:, own].sum(axis=1))),
        by_family(lambda own: _rate(shares[1][ranked][:, own].sum(axis=1))),
        _rate((shares[0] * banks.collided)[ranked].sum(axis=1)),
        _rate((shares[0] * banks.collided_in_window)[ranked].sum(axis=1)),
    )


def _spreads(values: NDArray[np.float64], has_evidence: bool) -> tuple[Spread, ...]:
    spreads = []
    for column, variable in enumerate((*CORE, *EXTENDED) if has_evidence else CORE):
        own = values[:, column]
        quantiles = np.quantile(own, [0.5, 0.9, 0.99, 1.0], method="higher") if len(own) else np.full(4, np.inf)
        median, q90, q99, largest = (float(value) if np.isfinite(value) else None for value in quantiles)
        infinite = int(np.isinf(own).sum())
        zero = _rate(own == 0)
        is_extended = column >= len(CORE)
        spreads.append(
            Spread(variable.name, variable.unit, is_extended, len(own), median, q90, q99, largest, zero, infinite)
        )
    return tuple(spreads)


def _equality(fidelity: Fidelity, tables: Sequence[str]) -> Equality:
    num_compared = len(fidelity.equal)
    differing = dict(zip(TICK_TABLES, (~fidelity.equal).sum(axis=0).tolist(), strict=True))
    return Equality(
        num_compared + int(fidelity.num_alone.sum()),
        num_compared,
        int(fidelity.equal.all(axis=1).sum()),
        {table: differing[table] for table in tables},
    )
