"""What one shard contributes to a study: small arrays, so that a dataset of any size is read in bounded memory.

Among them are outcomes of rollouts: whether the ego touched anything, and what a nominal's result counts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TICK_TABLES
from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.driving.route_cluster import CLUSTER_POINTS, resample_polyline
from branchdrive.driving.target import TARGETS
from branchdrive.engine.examine import examine
from branchdrive.model.targets import targets_of
from branchdrive.quality.qualification import first_attempts, group_quality
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
    "Facts",
    "Fidelity",
    "Groups",
    "NominalResults",
    "branch_kinds",
    "collisions",
    "nominal_results",
    "shard_facts",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Names = NDArray[np.object_]
"""Text as objects, which share what is equal: an array of fixed width would make each as wide as the longest."""

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
class Groups:
    """Branch groups, each field ``[groups]`` first.

    Attributes:
        scenario_type: Of the canonical nominal, else of the first attempt.
        town: Likewise.
        branch: Kind of its branch likewise, as `branch_kinds` has it.
        polyline: Route ``[groups, 32, 2]``, resampled; NaN where the record holds no polyline.
        has_nominal: Whether a compliant nominal was found.
        is_complete: Whether the group is integrity-complete.
        has_complete: Whether every policy has a complete attempt, compliant or not.
    """

    scenario_type: Names
    town: Names
    branch: Names
    polyline: Array
    has_nominal: Mask
    is_complete: Mask
    has_complete: Mask


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
class Facts:
    """Contribution of a shard, or of several."""

    groups: Groups
    banks: Banks
    fidelity: Fidelity
    statuses: Counter[str]
    num_ticks: int

    @staticmethod
    def merged(parts: Sequence[Facts]) -> Facts:
        """Contribution of all `parts`, at least one."""

        def joined(kind: type[Any], sides: Sequence[Any]) -> Any:
            return kind(**{f.name: np.concatenate([getattr(side, f.name) for side in sides]) for f in fields(kind)})

        return Facts(
            joined(Groups, [part.groups for part in parts]),
            joined(Banks, [part.banks for part in parts]),
            joined(Fidelity, [part.fidelity for part in parts]),
            sum((part.statuses for part in parts), Counter()),
            sum(part.num_ticks for part in parts),
        )


def shard_facts(view: ShardView) -> Facts:
    """What a shard contributes."""
    _, examination = examine(view)
    return Facts(
        _groups(view, examination),
        _banks(view, examination),
        _fidelity(view, examination),
        Counter(view.rollouts["status"]),
        len(view.controls),
    )


def _groups(view: ShardView, examination: Examination) -> Groups:
    standing, described = group_quality(view, examination), first_attempts(view, examination)
    nominal, records = examination.selection.nominal, view.rollouts
    routes = [_polyline(records["route_x_m"][i], records["route_y_m"][i]) for i in described]
    return Groups(
        standing["scenario_type"],
        standing["town"],
        branch_kinds(view, described),
        np.reshape(routes, (len(described), CLUSTER_POINTS, 2)),
        (nominal >= 0) & examination.complies[nominal],
        np.asarray(standing["integrity_complete"]),
        np.asarray((examination.selection.chosen >= 0).all(axis=1)),
    )


def _polyline(x_m: Array, y_m: Array) -> Array:
    if len(x_m) != len(y_m) or not len(x_m) or not np.isfinite([x_m, y_m]).all():
        return np.full((CLUSTER_POINTS, 2), np.nan)
    return resample_polyline(x_m, y_m)


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
