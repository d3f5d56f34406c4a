"""Replay fidelity of a release: thresholds, who passes them, which groups are valid, and retention.

Everything is computed from rows of the tables `pairs` and `group_quality` and from the documents before it,
so a validator recomputes it from what is stored and compares exactly. An infinite discrepancy is a masked
entry of its column; an infinite threshold, which every finite discrepancy is within, is ``null`` in the
document where the variable is judged.

A bank is the intervention pairs of a group: each group needs the same actions, each once.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/11-fidelity.md#pairs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.driving.discrepancy import CORE
from branchdrive.quality.partition import PARTITIONS
from branchdrive.quality.retention import NUM_RESAMPLES, retention
from branchdrive.quality.threshold import (
    FLOORS,
    QUANTILE,
    VARIABLES,
    Thresholds,
    largest_discrepancies,
    passes,
    thresholds_of_largest,
)
from branchdrive.statistics.split import TRAINING
from branchdrive.tables.frame import Frame, Values

__all__ = [
    "CRITERIA", "LEVEL", "Largest", "PassingCounts", "Validity", "bank_actions", "bank_rows", "discrepancies_of",
    "eligible_in_training", "fitting_groups", "largest_of", "near_thresholds", "one_bank", "passing_counts",
    "retention_document_of", "threshold_document_of", "thresholds_of",
    "validity", "with_passes", "with_validity",
]  # fmt: skip

Index = NDArray[np.int64]

CRITERIA = ("core", "extended")
"""Criteria in the order in which documents name them; the second includes the first."""

LEVEL = 0.95
"""Level of the intervals of retention."""


def fitting_groups(groups: Frame, assignment: Mapping[str, str]) -> list[str]:
    """Eligible training groups, sorted: those that thresholds are fitted on.

    Raises:
        ValueError: There is none.
    """
    fitted_on = eligible_in_training(groups, assignment)
    if not fitted_on:
        raise ValueError("no training group is structurally eligible, so no threshold can be fitted")
    return fitted_on


def eligible_in_training(groups: Frame, assignment: Mapping[str, str]) -> list[str]:
    """Eligible groups in training, sorted; of a part of the groups there may be none."""
    eligible = groups["group_id"][np.asarray(groups["eligible"], np.bool_)].tolist()
    return sorted(group_id for group_id in eligible if assignment.get(group_id) == TRAINING)


class Largest(NamedTuple):
    """What thresholds are fitted on, of some groups.

    Attributes:
        values: Largest discrepancy of the interventions of each group ``[groups, 12]``.
        has_pedestrian: Whether any of its pairs has a pedestrian in range ``[groups]``.
        actions: Actions of each bank, sorted; none without a group.
    """

    values: NDArray[np.float64]
    has_pedestrian: NDArray[np.bool_]
    actions: tuple[str, ...]


def largest_of(pairs: Frame, group_ids: list[str]) -> Largest:
    """What thresholds are fitted on, of groups.

    Raises:
        ValueError: A group lacks a pair that others have, or a discrepancy is negative or NaN.
    """
    rows = bank_rows(pairs, group_ids)
    there = np.asarray(pairs["has_pedestrian"], np.bool_)[rows].any(axis=1)
    return Largest(largest_discrepancies(discrepancies_of(pairs)[rows]), np.asarray(there), bank_actions(pairs, rows))


def bank_actions(pairs: Frame, rows: Index) -> tuple[str, ...]:
    """Actions of banks ``[groups, actions]``; none without a group."""
    return tuple(pairs["action_key"][rows[0]].tolist()) if len(rows) else ()


def one_bank(banks: Iterable[tuple[str, ...]]) -> None:
    """Groups that come in parts have the same actions.

    Args:
        banks: Actions of each part; none of a part without a group.

    Raises:
        ValueError: They have not.
    """
    found = sorted({bank for bank in banks if bank})
    if len(found) > 1:
        raise ValueError(f"of two groups one alone has a pair of {min({*found[0]} ^ {*found[1]})!r}")


def threshold_document_of(parts: Sequence[Largest], split_digest: str) -> dict[str, Any]:
    """The document ``thresholds.json`` of groups that come in parts, in any order.

    Args:
        parts: What it is fitted on, of at least one group in all.
        split_digest: Digest of ``split.json``.

    Raises:
        ValueError: Groups of two parts have not the same actions.
    """
    one_bank(part.actions for part in parts)
    fitted = thresholds_of_largest(
        np.concatenate([part.values for part in parts]), np.concatenate([part.has_pedestrian for part in parts])
    )
    return {
        "split_digest": split_digest,
        "quantile": QUANTILE,
        "method": "higher",
        "partition": TRAINING,
        "num_groups": fitted.num_groups,
        "pedestrian_support": fitted.support,
        "variables": [
            {
                "name": variable.name,
                "unit": LAYER_TABLES["pairs"][variable.name].unit,
                "criterion": CRITERIA[i >= len(CORE)],
                "judged": bool(fitted.judged[i]),
                "floor": float(FLOORS[i]),
                "value": float(fitted.values[i]) if np.isfinite(fitted.values[i]) else None,
            }
            for i, variable in enumerate(VARIABLES)
        ],
    }


def thresholds_of(document: Mapping[str, Any]) -> Thresholds:
    """Thresholds of a document ``thresholds.json``.

    Raises:
        ValueError: Its variables are not those of this version, in their order.
    """
    names = [variable["name"] for variable in document["variables"]]
    if names != [variable.name for variable in VARIABLES]:
        raise ValueError(f"thresholds of {names}, not of {[variable.name for variable in VARIABLES]}")
    judged = np.array([variable["judged"] for variable in document["variables"]], np.bool_)
    values = [np.inf if variable["value"] is None else variable["value"] for variable in document["variables"]]
    return Thresholds(
        np.where(judged, np.array(values, np.float64), np.nan),
        judged,
        int(document["num_groups"]),
        int(document["pedestrian_support"]),
    )


def with_passes(pairs: Frame, thresholds: Thresholds) -> dict[str, Values]:
    """Rows of `pairs` with the columns `core_pass` and `extended_pass`, nominal replays included.

    Raises:
        ValueError: A discrepancy is negative or NaN.
    """
    passed = passes(discrepancies_of(pairs)[:, None, :], thresholds)
    return {**pairs, "core_pass": passed.core[:, 0], "extended_pass": passed.extended[:, 0]}


def near_thresholds(pairs: Frame, thresholds: Thresholds, tolerance: float) -> NDArray[np.bool_]:
    """Discrepancies whose last bits may decide ``[pairs, 12]``: those that lie beside their threshold, not at it.

    Args:
        pairs: Rows of `pairs`; no flag of theirs is read.
        thresholds: Of the training groups.
        tolerance: Largest distance that is near, in units of ``1 + threshold``.
    """
    values, limits = discrepancies_of(pairs), thresholds.values
    with np.errstate(invalid="ignore"):
        return np.asarray((values != limits) & (np.abs(values - limits) <= tolerance * (1 + limits)))


def with_validity(groups: Frame, pairs: Frame) -> dict[str, Values]:
    """Rows of `group_quality` with the columns `core_valid` and `extended_valid`.

    A group is valid if it is eligible and every pair of its bank passes; nominal replays decide nothing.

    Args:
        groups: Rows, of which `group_id` and `eligible` are read.
        pairs: Rows with `core_pass` and `extended_pass`.

    Raises:
        ValueError: An eligible group lacks a pair that others have.
    """
    return {**groups, **validity(groups, pairs).columns}


class Validity(NamedTuple):
    """Which groups are valid.

    Attributes:
        flags: By criterion ``[groups, criteria]``.
        actions: Actions of each bank, sorted; none without an eligible group.
    """

    flags: NDArray[np.bool_]
    actions: tuple[str, ...]

    @property
    def columns(self) -> dict[str, Values]:
        """Columns of `group_quality`."""
        return {f"{criterion}_valid": self.flags[:, place] for place, criterion in enumerate(CRITERIA)}


def validity(groups: Frame, pairs: Frame) -> Validity:
    """Which groups are valid, and of which actions their banks are; takes and raises what `with_validity` does."""
    eligible = np.asarray(groups["eligible"], np.bool_)
    rows = bank_rows(pairs, groups["group_id"][eligible].tolist())
    flags = np.zeros((len(eligible), len(CRITERIA)), np.bool_)
    for place, criterion in enumerate(CRITERIA):
        flags[eligible, place] = np.asarray(pairs[f"{criterion}_pass"], np.bool_)[rows].all(axis=1)
    return Validity(flags, bank_actions(pairs, rows))


class PassingCounts(NamedTuple):
    """Interventions of groups that pass.

    Attributes:
        values: Those that pass each criterion, and all of them ``[groups, criteria + 1]``.
        actions: Actions of each bank, sorted; none without a group.
    """

    values: Index
    actions: tuple[str, ...]


def passing_counts(pairs: Frame, group_ids: list[str]) -> PassingCounts:
    """Interventions of each group that pass each criterion, and all of them.

    Raises:
        ValueError: A group lacks a pair that others have.
    """
    rows = bank_rows(pairs, group_ids)
    passed = [np.asarray(pairs[f"{criterion}_pass"], np.bool_)[rows].sum(axis=1) for criterion in CRITERIA]
    counts = np.stack([*passed, np.full(len(rows), rows.shape[1])], axis=1).astype(np.int64)
    return PassingCounts(counts, bank_actions(pairs, rows))


def retention_document_of(
    counts: Index, homes: Sequence[str], *, thresholds_digest: str, split_digest: str, seed: int
) -> dict[str, Any]:
    """The document ``retention.json`` of integrity-complete groups, in any order.

    Args:
        counts: Values of `passing_counts` ``[groups, criteria + 1]``.
        homes: Partition of each group.
        thresholds_digest: SHA-256 of the bytes of ``thresholds.json``.
        split_digest: Digest of ``split.json``.
        seed: Seed of the resamples, in ``[0, 2^64)``.

    Raises:
        ValueError: The seed is out of range.
    """
    present = [name for name in PARTITIONS if name in {*homes}]
    found = []
    for place, criterion in enumerate(CRITERIA if len(homes) else ()):
        rows_of = retention(counts[:, [place, -1]], homes, partitions=present, seed=seed)
        found += [{"criterion": criterion, **row._asdict(), "met": row.met} for row in rows_of]
    return {
        "seed": seed,
        "num_resamples": NUM_RESAMPLES,
        "level": LEVEL,
        "split_digest": split_digest,
        "thresholds_digest": thresholds_digest,
        "rows": found,
    }


def bank_rows(pairs: Frame, group_ids: list[str]) -> Index:
    """Rows of `pairs` with the interventions of groups, ``[groups, actions]``, actions in sorted order.

    Raises:
        ValueError: A group has no pair, the same action twice, or other actions than the first group.
    """
    place = {group_id: i for i, group_id in enumerate(group_ids)}
    banks: list[dict[str, int]] = [{} for _ in group_ids]
    is_intervention = np.asarray(pairs["kind"] == "intervention", np.bool_)
    for row in np.flatnonzero(is_intervention).tolist():
        i = place.get(pairs["group_id"][row])
        if i is None:
            continue
        if pairs["action_key"][row] in banks[i]:
            raise ValueError(f"group {group_ids[i]!r} has two pairs of the action {pairs['action_key'][row]!r}")
        banks[i][pairs["action_key"][row]] = row
    actions = sorted(banks[0]) if banks else []
    for group_id, bank in zip(group_ids, banks, strict=True):
        if not bank:
            raise ValueError(f"group {group_id!r} has no pair of an intervention")
        if bank.keys() != banks[0].keys():
            action = min(bank.keys() ^ banks[0].keys())
            raise ValueError(f"of the groups {group_ids[0]!r} and {group_id!r} one alone has a pair of {action!r}")
    rows = np.array([[bank[action] for action in actions] for bank in banks], np.int64)
    return rows.reshape(len(banks), len(actions))


def discrepancies_of(pairs: Frame) -> NDArray[np.float64]:
    """Discrepancies ``[pairs, 12]``, infinite where a column is masked."""
    columns = []
    for variable in VARIABLES:
        values = np.asarray(np.ma.getdata(pairs[variable.name]), np.float64)
        columns.append(np.where(np.ma.getmaskarray(pairs[variable.name]), np.inf, values))
    return np.stack(columns, axis=1)
