"""Rows of the model layer that follow from other tables: contexts, actions, and which groups are near duplicates.

Source: paper III-E, III-F; spec/12-model.md#frozen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.encoding import encode_bank
from branchdrive.derive.feature import SENSOR_PROFILE
from branchdrive.derive.history import HistoryInput
from branchdrive.derive.layer.arrays import pack_history
from branchdrive.derive.layer.frame import Frame, Values, sort_rows, take
from branchdrive.derive.layer.population import frozen_groups
from branchdrive.derive.near_duplicate import NearDuplicates, history_vectors, near_duplicates
from branchdrive.derive.normalisation import fit_controls, fit_state, training
from branchdrive.derive.split import TRAINING

__all__ = [
    "DuplicateFlags", "action_rows", "context_rows", "duplicate_flags", "duplicates_among", "near_duplicate_flags",
    "of_groups",
]  # fmt: skip


def of_groups(frame: Frame, groups: Sequence[str]) -> dict[str, Values]:
    """Rows of `groups`, in the order of the frame."""
    wanted = set(groups)
    return take(frame, np.array([group in wanted for group in frame["group_id"].tolist()], bool))


def duplicates_among(
    state: Frame, past_controls: Frame, groups: Sequence[str], assignment: Mapping[str, str]
) -> NearDuplicates:
    """Near duplicates among `groups`, by histories that are scaled on those of them that are in training.

    Args:
        state: Rows of the table `state`, of these groups and no others.
        past_controls: Rows of the table `past_controls`, of the same groups.
        groups: Groups in sorted order.
        assignment: Partition by group id.

    Raises:
        ValueError: Fewer than two groups are in training.
        DatasetError: A group lacks a row.
    """
    histories = [pack_history(state, "state", groups), pack_history(past_controls, "past_controls", groups)]
    fitted_on = training(groups, assignment)
    scaled = []
    for values, fit in zip(histories, (fit_state, fit_controls), strict=True):
        history = HistoryInput(values, np.asarray(np.isfinite(values).all(axis=2)))
        scaled.append(fit(history, SENSOR_PROFILE, fitted_on).apply(values))
    return near_duplicates(history_vectors(*scaled), [assignment[group] for group in groups])


class DuplicateFlags(NamedTuple):
    """Groups outside of training that are near duplicates, and those of which last bits decide, ``[groups]`` each."""

    flagged: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]


def near_duplicate_flags(
    groups: Frame, state: Frame, past_controls: Frame, assignment: Mapping[str, str]
) -> NDArray[np.bool_]:
    """Which groups are core-valid, outside of training, and near duplicates across partitions ``[groups]``."""
    return duplicate_flags(groups, state, past_controls, assignment).flagged


def duplicate_flags(groups: Frame, state: Frame, past_controls: Frame, assignment: Mapping[str, str]) -> DuplicateFlags:
    """Core-valid groups outside of training that are near duplicates across partitions, and how surely.

    Nothing is compared where fewer than two core-valid groups are in training.

    Args:
        groups: Rows of `group_quality` with `core_valid`.
        state: Rows of the table `state` of at least the core-valid groups.
        past_controls: Rows of the table `past_controls`, likewise.
        assignment: Partition by group id.
    """
    valid = sorted(groups["group_id"][np.asarray(groups["core_valid"], bool)].tolist())
    if sum(assignment[group] == TRAINING for group in valid) < 2:
        return DuplicateFlags(*np.zeros((2, len(groups["group_id"])), bool))
    found = duplicates_among(of_groups(state, valid), of_groups(past_controls, valid), valid, assignment)
    judged = {group: row for row, group in enumerate(valid) if assignment[group] != TRAINING}
    rows = [judged.get(group, len(valid)) for group in groups["group_id"].tolist()]
    return DuplicateFlags(*(np.append(told, False)[rows] for told in (found.flagged, found.doubtful)))


def context_rows(groups: Frame, records: Frame) -> dict[str, Values]:
    """Rows of the table `contexts`: the frozen population.

    Args:
        groups: Rows of `group_quality`, complete.
        records: Rows of the table `records`.
    """
    chosen = sort_rows(take(groups, frozen_groups(groups)), ("group_id",))
    links = records["kind"] == "nominal_link"
    nominal = dict(zip(records["group_id"][links].tolist(), records["rollout_id"][links].tolist(), strict=True))
    return {
        "group_id": chosen["group_id"],
        "partition": np.ma.getdata(chosen["partition"]),
        "scenario_type": chosen["scenario_type"],
        "town": chosen["town"],
        "route_cluster": np.ma.getdata(chosen["route_cluster"]),
        "nominal_rollout_id": np.array([nominal.get(g) or "" for g in chosen["group_id"].tolist()], object),
        "extended_valid": np.asarray(chosen["extended_valid"], bool),
    }


def action_rows(bank: ActionBank, *, encoded: bool) -> dict[str, Values]:
    """Rows of the table `actions`, in presentation order.

    Args:
        bank: The action bank.
        encoded: Whether the descriptor declares the encoding `bd29`.
    """
    size = len(bank.policies)
    vectors = np.empty(size, object)
    matrix = encode_bank(bank).astype(np.float64) if encoded else np.zeros((size, 0))
    for row, vector in enumerate(matrix):
        vectors[row] = vector
    return {
        "action_key": np.array(bank.keys, object),
        "position": np.arange(size, dtype=np.int32),
        "family": np.array([policy.family for policy in bank.policies], object),
        "encoded": np.full(size, encoded),
        "encoding": np.ma.masked_array(vectors, np.full(size, not encoded)),
    }
