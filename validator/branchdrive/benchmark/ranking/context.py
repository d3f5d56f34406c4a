"""What a baseline sees of a group before its branch: labels that make cells, and summaries of histories.

A summary of a history ``x [T, F]`` is the value of each feature at its last available row, its mean, least and
greatest available value, and the share of rows in which it is available::

    [last, mean, min, max, share]      NaN where no row of the window is available; its share is 0

Source: spec/14-benchmark.md#baselines.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.protocol.selection import Baseline, Prior
from branchdrive.driving.feature import InputContract
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import pack_history, pack_surroundings
from branchdrive.statistics.rounding import slack
from branchdrive.tables.frame import Frame

__all__ = ["Contexts", "contexts_of", "standardised", "summaries"]

Array = NDArray[np.float64]

CLIP = 8.0
"""Magnitude to which a standardised summary is clipped."""

_OF_CONTEXTS = ("scenario_type", "town")
_COMMAND = "command_"
_BRANCH = 0
"""Offset of the observation at the branch."""


@dataclass(frozen=True, eq=False)
class Contexts:
    """Labels and summaries of all groups of a model layer.

    Attributes:
        row: Place of every group on the first axis.
        labels: By feature of a cell, the label of every group ``[N]``.
        histories: By name of an input contract, summaries ``[N, D]``, NaN where not available; ``None`` for a
            contract that reads evidence which the dataset lacks.
    """

    row: Mapping[str, int]
    labels: Mapping[str, Sequence[Hashable]]
    histories: Mapping[str, Array | None]

    def cells(self, by: Sequence[str], groups: Sequence[str]) -> list[Hashable]:
        """The cell of every group ``[n]``: its labels together."""
        return [tuple(self.labels[feature][self.row[group]] for feature in by) for group in groups]

    def history(self, contract: str, groups: Sequence[str]) -> Array | None:
        """Summaries of the groups ``[n, D]``; ``None`` as in `histories`."""
        found = self.histories[contract]
        return None if found is None else found[[self.row[group] for group in groups]]

    def joined(self, other: Contexts) -> Contexts:
        """These groups and others, of which the same was seen.

        Raises:
            KeyError: The others lack a label or a history.
        """
        row = {**self.row, **{group: len(self.row) + place for group, place in other.row.items()}}
        labels = {feature: [*values, *other.labels[feature]] for feature, values in self.labels.items()}
        histories: dict[str, Array | None] = {}
        for contract, values in self.histories.items():
            further = other.histories[contract]
            histories[contract] = None if values is None or further is None else np.concatenate([values, further])
        return Contexts(row, labels, histories)

    def __repr__(self) -> str:
        shapes = {name: None if found is None else list(found.shape) for name, found in self.histories.items()}
        return f"Contexts({len(self.row)} groups, labels {sorted(self.labels)}, histories {shapes})"


def contexts_of(frame_of: Callable[[str], Frame], groups: Sequence[str], declared: Sequence[Baseline]) -> Contexts:
    """What the declared baselines see, and nothing else is read.

    Args:
        frame_of: Gives a table of the model layer.
        groups: Ids of all groups of these tables.
        declared: Baselines.

    Raises:
        DatasetError: A table lacks a row, repeats or does not know a key, or holds a value that is not a number.
    """
    features = {feature for baseline in declared if isinstance(baseline, Prior) for feature in baseline.by}
    contracts = {baseline.contract for baseline in declared if not isinstance(baseline, Prior)}
    labels: dict[str, Sequence[Hashable]] = {}
    if of_contexts := sorted(features & set(_OF_CONTEXTS)):
        contexts = frame_of("contexts")
        place = {group: row for row, group in enumerate(contexts["group_id"].tolist())}
        for feature in of_contexts:
            values = contexts[feature].tolist()
            labels[feature] = [values[place[group]] for group in groups]
    if of_route := sorted(features - set(_OF_CONTEXTS)):
        labels |= _route_labels(frame_of("state"), groups, of_route)
    histories = {name: _history(frame_of, groups, InputContract.named(name)) for name in sorted(contracts)}
    return Contexts({group: row for row, group in enumerate(groups)}, labels, histories)


def _route_labels(state: Frame, groups: Sequence[str], features: Sequence[str]) -> dict[str, Sequence[Hashable]]:
    """Command and speed limit at the branch; ``None`` where the dataset does not record one."""
    at_branch = np.flatnonzero(np.ma.getdata(state["offset_ticks"]) == _BRANCH)
    row = dict(zip(np.ma.getdata(state["group_id"])[at_branch].tolist(), at_branch.tolist(), strict=True))
    if missing := [group for group in groups if group not in row]:
        raise DatasetError(f"table `state`: no row of `group_id` {missing[0]!r} at the branch")
    rows = [row[group] for group in groups]
    found: dict[str, Sequence[Hashable]] = {}
    if "speed_limit" in features:
        found["speed_limit"] = state["speed_limit_mps"][rows].tolist()
    if "command" in features:
        names = sorted(name for name in state if name.startswith(_COMMAND))
        given = np.stack([np.ma.filled(state[name][rows], 0.0) for name in names], axis=1) > 0
        found["command"] = [tuple(one) for one in given.tolist()]
    return found


def _history(frame_of: Callable[[str], Frame], groups: Sequence[str], contract: InputContract) -> Array | None:
    parts = [summaries(pack_history([frame_of(table)], table, groups)) for table in ("state", "past_controls")]
    if contract is not InputContract.SENSOR:
        parts.append(summaries(pack_history([frame_of("expert")], "expert", groups)))
    if contract is InputContract.PRIVILEGED:
        surroundings = pack_surroundings([frame_of("surroundings")], groups)
        if surroundings is None:
            return None
        parts.append(summaries(surroundings.values))
    return np.concatenate(parts, axis=1)


def summaries(values: Array) -> Array:
    """Summaries ``[N, 5 F]`` of windows ``[N, T, F]``, NaN in both where nothing is available."""
    there = np.isfinite(values)
    share = there.mean(axis=1)
    num_rows = values.shape[1]
    last = num_rows - 1 - there[:, ::-1].argmax(axis=1)
    at_last = np.take_along_axis(values, last[:, None], axis=1)[:, 0]
    with np.errstate(over="ignore"):
        total = np.where(there, values, 0.0).sum(axis=1)
    mean = np.divide(total, there.sum(axis=1), out=np.full(total.shape, np.nan), where=share > 0)
    least = np.where(there, values, np.inf).min(axis=1)
    greatest = np.where(there, values, -np.inf).max(axis=1)
    least, greatest = (np.where(share > 0, found, np.nan) for found in (least, greatest))
    return np.concatenate([at_last, mean, least, greatest, share], axis=1)


def standardised(train: Array, values: Array) -> Array:
    """Summaries ``[n, D]`` with the mean and the spread of those of `train` ``[m, D]``, clipped to 8.

    A summary that is not available is 0, the mean; so is one that does not vary in `train`.
    """
    there = np.isfinite(train)
    count = np.maximum(there.sum(axis=0), 1)
    known = np.where(there, train, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        centre = known.sum(axis=0) / count
        spread = np.sqrt((np.where(there, train - centre, 0.0) ** 2).sum(axis=0) / count)
        varies = np.isfinite(spread) & (spread > slack(np.abs(known).max(axis=0, initial=0.0)))
        difference = values - centre
    scaled = np.divide(difference, spread, out=np.zeros(values.shape), where=varies & np.isfinite(difference))
    clipped: NDArray[Any] = np.clip(scaled, -CLIP, CLIP)
    return clipped
