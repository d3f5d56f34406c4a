"""What a leakage audit may see: facts of every replay from before its branch, and nothing else.

Of every group and action there is one replay up to the branch; the nominal's row is an independent replay
of the nominal drive, since the nominal itself differs from its replays by design. Action metadata, identifiers
as values, paths, what follows the branch and outcomes have no place here.

The digest is SHA-256 over a line of JSON that names everything, and the arrays in little-endian float64, those of
streams as they are. They follow from raw columns by arithmetic that every processor rounds alike, so all bits count.

Of the features of the gate, discrepancies and availability are one each; every variable of the ego history is one at
each of 16 observations, and every control one for each mean over 5 ticks.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md#inputs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.timing import (
    CONTROL_HISTORY_TICKS,
    HISTORY_OBSERVATIONS,
    HISTORY_OFFSETS,
    OBSERVATION_STRIDE_TICKS,
)
from branchdrive.leakage.streams import Streams
from branchdrive.quality.threshold import VARIABLES

__all__ = ["CONTROL_SPANS", "GateFeature", "ReplayInputs", "Source", "gate_columns", "gate_features", "pooled_controls"]

Array = NDArray[np.float64]
Source = Literal["discrepancy", "ego", "controls", "availability"]

CONTROL_SPANS = tuple(
    (start, start + OBSERVATION_STRIDE_TICKS - 1)
    for start in range(-CONTROL_HISTORY_TICKS, 0, OBSERVATION_STRIDE_TICKS)
)
"""First and last offset from ``t_b`` of the controls that one mean is taken over: -80 .. -76, .. -5 .. -1."""

_DIGESTED_AT_ONCE = 256
"""Groups whose values are brought into the form of the digest at once."""

_ARRAYS = ("availability", "discrepancy", "ego", "controls")


@dataclass(frozen=True, eq=False, repr=False)
class ReplayInputs:
    """Facts of replays from before the branch; NaN where unavailable.

    Attributes:
        group_ids: Sorted; they order the groups and enter no feature.
        partitions: Partition of every group ``[groups]``.
        action_keys: In the order of the bank, the nominal's among them.
        nominal_index: Place of the nominal among the actions.
        availability_names: What `availability` is the share of.
        ego_names: Variables of `ego`, with units.
        control_names: Variables of `controls`.
        availability: ``[groups, actions, availabilities]``, share of the expected rows that are there, 0 .. 1.
        discrepancy: ``[groups, actions, 12]`` to the group's nominal, in the order of `VARIABLES`, ``inf`` allowed.
        ego: ``[groups, actions, 16, variables]`` at the observations ``t_b - 75 .. t_b``.
        controls: ``[groups, actions, 80, variables]`` applied at ``t_b - 80 .. t_b - 1``.
        has_nominal_replay: ``[groups]``, whether the nominal's row is there; without it that row is NaN.
        streams: Recorded columns of the interventions; None is no column.

    Raises:
        ValueError: Names are missing, repeat or are not in order, a shape is wrong, or a value is one that cannot be.
    """

    group_ids: tuple[str, ...]
    partitions: tuple[str, ...]
    action_keys: tuple[str, ...]
    nominal_index: int
    availability_names: tuple[str, ...]
    ego_names: tuple[str, ...]
    control_names: tuple[str, ...]
    availability: Array
    discrepancy: Array
    ego: Array
    controls: Array
    has_nominal_replay: NDArray[np.bool_]
    streams: Streams = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name in ("group_ids", "partitions", "action_keys", "availability_names", "ego_names", "control_names"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if list(self.group_ids) != sorted(set(self.group_ids)):
            raise ValueError("`group_ids` are not sorted, or repeat")
        if len(self.partitions) != len(self.group_ids):
            raise ValueError(f"{len(self.partitions)} partitions of {len(self.group_ids)} groups")
        for name in ("action_keys", "availability_names", "ego_names", "control_names"):
            if not getattr(self, name) or len(set(getattr(self, name))) != len(getattr(self, name)):
                raise ValueError(f"`{name}` are empty, or repeat")
        if len(self.action_keys) < 3 or not 0 <= self.nominal_index < len(self.action_keys):
            raise ValueError(f"nominal {self.nominal_index} of {len(self.action_keys)} actions, at least 3")
        object.__setattr__(self, "has_nominal_replay", _owned(self.has_nominal_replay, np.bool_))
        if self.has_nominal_replay.shape != (self.num_groups,):
            raise ValueError(f"`has_nominal_replay` has shape {list(self.has_nominal_replay.shape)}, not [groups]")
        rows = (self.num_groups, len(self.action_keys))
        wanted = {
            "availability": (*rows, len(self.availability_names)),
            "discrepancy": (*rows, len(VARIABLES)),
            "ego": (*rows, HISTORY_OBSERVATIONS, len(self.ego_names)),
            "controls": (*rows, CONTROL_HISTORY_TICKS, len(self.control_names)),
        }
        for name, shape in wanted.items():
            values = _owned(getattr(self, name), np.float64)
            if values.shape != shape:
                raise ValueError(f"`{name}` has shape {list(values.shape)}, not {list(shape)}")
            if name != "discrepancy" and np.isinf(values).any():
                raise ValueError(f"`{name}` holds an infinite value")
            if not np.isnan(values[~self.has_nominal_replay, self.nominal_index]).all():
                raise ValueError(f"`{name}` has values of a nominal replay that is not there")
            object.__setattr__(self, name, values)
        if self.streams is None:
            object.__setattr__(self, "streams", Streams.none(self.num_groups, len(self.action_keys) - 1))
        if self.streams.ranks.shape[:2] != (self.num_groups, len(self.action_keys) - 1):
            raise ValueError(f"`streams` has ranks of shape {list(self.streams.ranks.shape)}")
        if ((self.availability < 0) | (self.availability > 1)).any():
            raise ValueError("`availability` is a share, and not in 0 .. 1")
        if (self.discrepancy < 0).any():
            raise ValueError("`discrepancy` is negative")

    def __repr__(self) -> str:
        shapes = ", ".join(f"{name} {list(getattr(self, name).shape)}" for name in _ARRAYS)
        return f"ReplayInputs({shapes} float64, {self.has_nominal_replay.sum()} nominal replays)"

    @property
    def num_groups(self) -> int:
        """Groups."""
        return len(self.group_ids)

    @property
    def interventions(self) -> tuple[int, ...]:
        """Places of all actions but the nominal."""
        return tuple(index for index in range(len(self.action_keys)) if index != self.nominal_index)

    def in_partition(self, name: str) -> NDArray[np.bool_]:
        """Whether a group is of the partition, ``[groups]``."""
        return np.array([partition == name for partition in self.partitions], np.bool_)

    def digest(self) -> str:
        """SHA-256 of names, identifiers and values, 64 hexadecimal digits; NaN is one value, and so is 0."""
        head = {
            "group_ids": self.group_ids,
            "partitions": self.partitions,
            "action_keys": self.action_keys,
            "nominal_index": self.nominal_index,
            "availability_names": self.availability_names,
            "discrepancy_names": [variable.name for variable in VARIABLES],
            "ego_names": self.ego_names,
            "control_names": self.control_names,
            "has_nominal_replay": self.has_nominal_replay.tolist(),
            "streams": [list(column) for column in self.streams.columns],
        }
        sha = hashlib.sha256(json.dumps(head, sort_keys=True, separators=(",", ":")).encode() + b"\n")
        for name in _ARRAYS:
            for part in _in_blocks(getattr(self, name)):
                values = part + 0.0
                sha.update(np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes())
        for part in _in_blocks(self.streams.ranks):
            sha.update(part.astype("<i2").tobytes())
        sha.update(self.streams.spread.astype("<f4").tobytes())
        return sha.hexdigest()


def _in_blocks(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Rows of some groups at a time, one after the other, so that what is computed of them is small."""
    return (values[start : start + _DIGESTED_AT_ONCE] for start in range(0, len(values), _DIGESTED_AT_ONCE))


def _owned(values: ArrayLike, dtype: type[np.generic]) -> NDArray[Any]:
    """Values that cannot be written to: a copy, or they themselves where they are read-only."""
    if isinstance(values, np.ndarray) and values.dtype == dtype and values.base is None and not values.flags.writeable:
        return values
    array = np.array(values, dtype)
    array.flags.writeable = False
    return array


class GateFeature(NamedTuple):
    """One feature.

    Attributes:
        source: Array of `ReplayInputs` that it is taken from.
        name: Variable.
        offset_ticks: First and last offset from ``t_b``; None where it is of the whole window.
    """

    source: Source
    name: str
    offset_ticks: tuple[int, int] | None


def pooled_controls(inputs: ReplayInputs) -> Array:
    """Controls averaged over 5 ticks, ``[groups, actions, 16, controls]``; NaN where one of the five is missing."""
    groups, actions, _, controls = inputs.controls.shape
    spans = inputs.controls.reshape(groups, actions, len(CONTROL_SPANS), OBSERVATION_STRIDE_TICKS, controls)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(spans.mean(axis=3))


def gate_columns(inputs: ReplayInputs) -> tuple[GateFeature, ...]:
    """What the features of a gate are."""
    return (
        *(GateFeature("discrepancy", variable.name, None) for variable in VARIABLES),
        *(GateFeature("ego", name, (tick, tick)) for tick in HISTORY_OFFSETS for name in inputs.ego_names),
        *(GateFeature("controls", name, span) for span in CONTROL_SPANS for name in inputs.control_names),
        *(GateFeature("availability", name, None) for name in inputs.availability_names),
    )


def gate_features(inputs: ReplayInputs) -> tuple[Array, tuple[GateFeature, ...]]:
    """Features of all interventions ``[groups, actions - 1, features]``, and what they are; the nominal stays out."""
    groups, actions = inputs.num_groups, len(inputs.action_keys)
    blocks = [
        inputs.discrepancy,
        inputs.ego.reshape(groups, actions, len(HISTORY_OFFSETS) * len(inputs.ego_names)),
        pooled_controls(inputs).reshape(groups, actions, len(CONTROL_SPANS) * len(inputs.control_names)),
        inputs.availability,
    ]
    return np.concatenate(blocks, axis=2)[:, list(inputs.interventions)], gate_columns(inputs)
