"""What one shard contributes to a study: small arrays, so that a dataset of any size is read in bounded memory.

Among them are outcomes of rollouts: whether the ego touched anything, and what a nominal's result counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import DECISIONS, TICK_TABLES
from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.driving.target import TARGETS
from branchdrive.engine.examine import examine
from branchdrive.model.targets import targets_of
from branchdrive.quality.collected import Collected, Names
from branchdrive.quality.qualification import first_attempts
from branchdrive.quality.replay import Pairs, canonical_pairs
from branchdrive.raw.examination import Examination
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import take_float, window_rows
from branchdrive_reference.simulation.branch_kind import EARLY_TICKS, BranchKind
from branchdrive_reference.study.fidelity import discrepancies, equal_records

__all__ = [
    "RESULTS",
    "Banks",
    "Collisions",
    "Drives",
    "Facts",
    "Fidelity",
    "NominalResults",
    "branch_kinds",
    "collisions",
    "nominal_results",
    "shard_facts",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

RESULTS = {
    "result_num_vehicle_collisions": "vehicle collisions",
    "result_num_pedestrian_collisions": "pedestrian collisions",
    "result_num_static_collisions": "static collisions",
    "result_num_red_light_infractions": "red lights",
    "result_num_stop_sign_infractions": "stop signs",
    "result_num_off_road_infractions": "departures from the road",
}
"""What a rollout's result counts, by column."""


class Collisions(NamedTuple):
    """Whether rollouts touched anything, each field ``[rollouts]``: at any time, and within 2.5 s of the branch."""

    ever: Mask
    in_window: Mask


class NominalResults(NamedTuple):
    """Route results of nominal rollouts.

    Attributes:
        completed: Whether the route was completed ``[rollouts]``.
        counts: Collisions and infractions ``[rollouts, 6]`` in the order of `RESULTS`, NaN where not monitored.
    """

    completed: Mask
    counts: NDArray[np.float64]


@dataclass(frozen=True)
class Banks:
    """Canonical banks of integrity-complete groups, ``[banks]`` first; a policy is a position in the action bank.

    Attributes:
        scenario_type: Of the group.
        branch: Kind of the group's branch, as `branch_kinds` has it.
        targets: Scalar targets ``[banks, policies, 6]``, NaN where unavailable.
        collided: Whether the ego ever touched anything ``[banks, policies]``; NaN where no evidence is claimed.
        collided_in_window: The same within 2.5 s of the branch.
        completed: Whether the nominal completed its route.
        results: Collisions and infractions of the nominal ``[banks, 6]``, NaN where not monitored.
    """

    scenario_type: Names
    branch: Names
    targets: Array
    collided: Array
    collided_in_window: Array
    completed: Mask
    results: Array


@dataclass(frozen=True)
class Fidelity:
    """Attempts against nominals.

    Attributes:
        interventions: Discrepancies of canonical interventions ``[n, 12]``.
        replays: Discrepancies of compliant nominal replays ``[n, 12]``.
        equal: Whether complete nominal replays hold the bits of their complete nominals, by table
            ``[n, tables]`` in the order of `TICK_TABLES`; true for a table that is not claimed.
        num_alone: Nominal replays that are not complete or whose nominal is not ``[shards]``.
    """

    interventions: Array
    replays: Array
    equal: Mask
    num_alone: NDArray[np.int64]


@dataclass(frozen=True)
class Drives:
    """Drives, which only a dataset of drives has.

    Attributes:
        num_drives: Drives ``[shards]``.
        choices: Action key of every decision ``[decisions]``.
    """

    num_drives: NDArray[np.int64]
    choices: Names


@dataclass(frozen=True)
class Facts:
    """Contribution of a shard, or of several.

    Attributes:
        groups: What the raw layer holds.
        branch: Kind of the branch of each group ``[groups]``, as `branch_kinds` has it.
        banks: Canonical banks.
        fidelity: Attempts against nominals.
        drives: Drives and their decisions.
    """

    groups: Collected
    branch: Names
    banks: Banks
    fidelity: Fidelity
    drives: Drives

    @staticmethod
    def merged(parts: Sequence[Facts]) -> Facts:
        """Contribution of all `parts`, at least one."""

        def joined(kind: type[Any], sides: Sequence[Any]) -> Any:
            return kind(**{f.name: np.concatenate([getattr(side, f.name) for side in sides]) for f in fields(kind)})

        return Facts(
            Collected.merged(part.groups for part in parts),
            np.concatenate([part.branch for part in parts]),
            joined(Banks, [part.banks for part in parts]),
            joined(Fidelity, [part.fidelity for part in parts]),
            joined(Drives, [part.drives for part in parts]),
        )


def shard_facts(view: ShardView) -> Facts:
    """What a shard contributes."""
    _, examination = examine(view)
    described = first_attempts(view, examination)
    return Facts(
        Collected.of(view, examination, described),
        branch_kinds(view, described),
        _banks(view, examination),
        _fidelity(view, examination),
        Drives(
            np.array([view.role("drive").sum()]),
            view.stream(DECISIONS)["action_key"] if DECISIONS in view else np.zeros(0, object),
        ),
    )


def _banks(view: ShardView, examination: Examination) -> Banks:
    banks = examination.selection.chosen[examination.complete_groups]
    nominals = banks[:, view.descriptor.action_bank.nominal_index]
    touched = collisions(view, banks.ravel())
    results = nominal_results(view, nominals)
    unknown = np.full(banks.shape, np.nan)
    return Banks(
        view.rollouts["scenario_type"][nominals],
        branch_kinds(view, nominals),
        targets_of(view, banks.ravel()).values.reshape(*banks.shape, len(TARGETS)),
        unknown if touched is None else touched.ever.reshape(banks.shape).astype(np.float64),
        unknown if touched is None else touched.in_window.reshape(banks.shape).astype(np.float64),
        results.completed,
        results.counts.reshape(len(banks), len(RESULTS)),
    )


def _fidelity(view: ShardView, examination: Examination) -> Fidelity:
    nominal = view.nominal
    is_replay = view.role("nominal_replay")
    whole = is_replay & (nominal >= 0) & view.role("nominal")[nominal] & view.complete & view.complete[nominal]
    compared = np.flatnonzero(whole)
    equal = equal_records(view, Pairs(compared, nominal[compared]))
    interventions, replays = canonical_pairs(view, examination)
    return Fidelity(
        discrepancies(view, interventions),
        discrepancies(view, replays),
        np.stack([equal.get(table, np.ones(len(compared), bool)) for table in TICK_TABLES], axis=1),
        np.array([(is_replay & ~whole).sum()]),
    )


def branch_kinds(view: ShardView, rollouts: Index) -> Names:
    """Kinds of the branches of `rollouts`, as they are recorded.

    ``quiet`` is a control branch, ``early`` lies half a second before the manoeuvre or more, ``onset`` immediately
    before it, and ``none`` stands for a rollout without a branch.
    """
    delay_ticks = view.rollouts["trigger_tick"].astype(np.int64) - view.branch_tick
    where = {
        "none": ~view.branched,
        BranchKind.QUIET: view.rollouts.equals("trigger_signal", "steady"),
        BranchKind.EARLY: delay_ticks >= EARLY_TICKS,
    }
    kinds = np.select(list(where.values()), list(map(str, where)), BranchKind.ONSET).astype(object)
    return np.asarray(kinds[rollouts])


def collisions(view: ShardView, rollouts: Index) -> Collisions | None:
    """Collisions of rollouts with whole windows; ``None`` where no evidence is claimed."""
    if "evidence" not in view:
        return None
    evidence = view.stream("evidence")
    collided = evidence["collision"]
    rows = window_rows(view, evidence, rollouts, FUTURE_OFFSETS)
    return Collisions(evidence.by_rollout(collided).any[rollouts], np.asarray(collided[rows].any(axis=1)))


def nominal_results(view: ShardView, rollouts: Index) -> NominalResults:
    """Results of `rollouts` as recorded."""
    counts = [take_float(view.rollouts, column, rollouts) for column in RESULTS]
    return NominalResults(view.rollouts.equals("result_completion", "completed")[rollouts], np.stack(counts, axis=1))
