"""Replays of a shard against the nominal of their group, over the window before the branch.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/11-fidelity.md#pairs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OFFSETS
from branchdrive.driving.discrepancy import (
    CORE,
    EXTENDED,
    NO_LIGHT,
    History,
    HistoryEvidence,
    core_discrepancy,
    extended_discrepancy,
)
from branchdrive.quality.qualification import nominal_replays
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows
from branchdrive.tables.frame import Values

if TYPE_CHECKING:
    from branchdrive.raw.examination import Examination

__all__ = ["Pairs", "canonical_pairs", "discrepancies", "evidence_of", "history_of", "pair_columns"]

Index = NDArray[np.int64]


class Pairs(NamedTuple):
    """Paired attempts ``[pairs]``, indices into the shard's rollouts."""

    replay: Index
    nominal: Index


def canonical_pairs(view: ShardView, examination: Examination) -> tuple[Pairs, Pairs]:
    """Canonical interventions, and compliant nominal replays, of integrity-complete groups with their nominals."""
    selection, groups = examination.selection, examination.complete_groups
    others = np.delete(selection.chosen[groups], view.descriptor.action_bank.nominal_index, axis=1)
    replays = nominal_replays(view, examination)
    replays = replays[np.isin(view.group[replays], groups)]
    return (
        Pairs(others.ravel(), np.repeat(selection.nominal[groups], others.shape[1])),
        Pairs(replays, selection.nominal[view.group[replays]]),
    )


def history_of(view: ShardView, rollouts: Index) -> History:
    """Drives of rollouts with whole windows before their branch."""
    observed = window_rows(view, view.observations, rollouts, HISTORY_OFFSETS)
    driven = window_rows(view, view.controls, rollouts, range(-CONTROL_HISTORY_TICKS, 0))
    columns = [view.observations[name][observed] for name in ("x_m", "y_m", "yaw_rad", "speed_mps")]
    columns += [view.controls[f"applied_{name}"][driven] for name in ("steer", "throttle", "brake")]
    columns.append(view.branch_tick[rollouts])
    return History(*columns)


def evidence_of(view: ShardView, rollouts: Index) -> HistoryEvidence:
    """What surrounded rollouts with whole windows before their branch."""
    evidence = view.stream("evidence")
    rows = window_rows(view, evidence, rollouts, HISTORY_OFFSETS)
    light, _ = evidence.categories("traffic_light")
    return HistoryEvidence(
        evidence["nearest_vehicle_available"][rows],
        evidence["nearest_vehicle_gap_m"][rows],
        evidence["nearest_vehicle_rel_speed_mps"][rows],
        evidence["num_actors"][rows],
        np.where(evidence["traffic_light_available"][rows], light[rows], NO_LIGHT),
        evidence["nearest_pedestrian_available"][rows],
        evidence["nearest_pedestrian_gap_m"][rows],
    )


def discrepancies(view: ShardView, pairs: Pairs) -> NDArray[np.float64]:
    """Core and extended variables of pairs with whole windows, ``[pairs, 7 + 5]``.

    Where no evidence is claimed, nothing is there on either side: the extended variables are 0.
    """
    core = core_discrepancy(history_of(view, pairs.replay), history_of(view, pairs.nominal))
    if "evidence" in view:
        extended = extended_discrepancy(evidence_of(view, pairs.replay), evidence_of(view, pairs.nominal))
    else:
        extended = np.zeros((len(pairs.replay), len(EXTENDED)))
    return np.concatenate([core, extended], axis=1)


def pair_columns(view: ShardView, pairs: Pairs) -> dict[str, Values]:
    """What one shard can tell of the table `pairs`."""
    values = discrepancies(view, pairs)
    columns: dict[str, Values] = {variable.name: values[:, i] for i, variable in enumerate((*CORE, *EXTENDED))}
    for mask, names in (
        ("vehicle_comparable", ("vehicle_gap_m", "vehicle_rel_speed_mps")),
        ("pedestrian_comparable", ("pedestrian_gap_m",)),
    ):
        columns[mask] = np.asarray(np.isfinite(columns[names[0]]))
        columns.update({name: np.ma.masked_invalid(columns[name], copy=True) for name in names})
    is_replay = view.role("nominal_replay")[pairs.replay]
    if "evidence" in view:
        evidence = view.stream("evidence")
        rows = window_rows(view, evidence, pairs.nominal, HISTORY_OFFSETS)
        has_pedestrian = np.asarray(evidence["nearest_pedestrian_available"][rows].any(axis=1))
    else:
        has_pedestrian = np.zeros(len(pairs.replay), bool)
    return {
        "group_id": view.rollouts["group_id"][pairs.replay],
        "rollout_id": np.array(view.rollout_ids, object)[pairs.replay],
        "kind": np.where(is_replay, "nominal_replay", "intervention").astype(object),
        "action_key": view.rollouts["action_key"][pairs.replay],
        **columns,
        "has_pedestrian": has_pedestrian,
    }
