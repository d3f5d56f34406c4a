"""Arrays of the model layer, packed from the rows of its tables by key.

The place of a value follows from the key of its row and from the given order of groups and candidates, never
from the place of the row. A table must have exactly one row for each key; values that are there are finite.
Rows come in frames, as those of the files of a table, of which one is looked at after the other.
With ``N`` groups and ``A`` candidates::

    state         [N, 16, 21]     t_b - 75 .. t_b               scalars       [N, A, 6] and mask
    controls      [N, 80, 3]      t_b - 80 .. t_b - 1           trajectories  [N, A, 10, 5]
    expert        [N, 16, 4]      flags are 0 or 1              actions       [A, encoding width]
    surroundings  [N, 16, 11]     and mask; the traffic light is three features red, yellow, green
    objects       [N, 16, 32, 11]     and mask [N, 16, 32]; the class is four features

Source: paper, "Model Inputs and Targets"; spec/12-model.md#features.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.timing import FUTURE_OBSERVATIONS, HISTORY_OFFSETS
from branchdrive.driving.object_sensor import MAX_OBJECTS
from branchdrive.driving.target import TARGETS, TRAJECTORY, Targets, Trajectory
from branchdrive.errors import DatasetError
from branchdrive.model.features import HISTORIES, OBJECT_FEATURES
from branchdrive.tables.frame import Frame, distinct, num_rows, repeated_rows, sort_rows

__all__ = [
    "Masked", "ModelArrays", "PackedObjects", "joined_arrays", "pack_actions", "pack_arrays", "pack_column",
    "pack_history", "pack_objects", "pack_scalars", "pack_surroundings", "pack_trajectories",
]  # fmt: skip

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

STEPS = tuple(range(1, FUTURE_OBSERVATIONS + 1))
"""Steps of a trajectory."""


class Masked(NamedTuple):
    """`values` with NaN exactly where not `available`, both of one shape."""

    values: Array
    available: Mask


class PackedObjects(NamedTuple):
    """Objects of observations: `values` ``[N, 16, 32, 11]``, 0 where not `available` ``[N, 16, 32]``."""

    values: NDArray[np.float32]
    available: Mask


@dataclass(frozen=True)
class ModelArrays:
    """All arrays of a model layer.

    Attributes:
        groups: Ids of the groups, the order of the first axis.
        candidates: Action keys, the order of the candidate axis.
        state: ``[N, 16, 21]``.
        controls: ``[N, 80, 3]``.
        expert: ``[N, 16, 4]``.
        surroundings: ``[N, 16, 11]``; ``None`` where the dataset has no evidence.
        actions: float32 ``[A, encoding width]``; ``None`` where the bank has no encoding.
        scalars: ``[N, A, 6]``, NaN where not available.
        trajectories: ``[N, A, 10, 5]``.
    """

    groups: tuple[str, ...]
    candidates: tuple[str, ...]
    state: Array
    controls: Array
    expert: Array
    surroundings: Masked | None
    actions: NDArray[np.float32] | None
    scalars: Targets
    trajectories: Trajectory


def joined_arrays(parts: Sequence[ModelArrays]) -> ModelArrays:
    """Arrays of the groups of all parts, at least one, in sorted order.

    Raises:
        ValueError: Two parts have the same group, or other candidates, or one alone has surroundings.
    """
    if len(parts) == 1 and [*parts[0].groups] == sorted(parts[0].groups):
        return parts[0]
    first, filled = parts[0], [part for part in parts if part.groups]
    groups = distinct([part.groups for part in parts])
    have = {part.surroundings is not None for part in filled}
    if len(have) > 1 or any(part.candidates != first.candidates for part in parts):
        raise ValueError("parts of a model layer have other arrays")
    order = sorted(range(len(groups)), key=groups.__getitem__)

    def joined(arrays: Iterable[NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([*arrays])[order]

    filled = filled or [first]
    surroundings = [part.surroundings for part in filled if part.surroundings is not None]
    return ModelArrays(
        groups=tuple(groups[place] for place in order),
        candidates=first.candidates,
        state=joined(part.state for part in filled),
        controls=joined(part.controls for part in filled),
        expert=joined(part.expert for part in filled),
        surroundings=Masked(*map(joined, zip(*surroundings, strict=True))) if surroundings else None,
        actions=first.actions,
        scalars=Targets(*map(joined, zip(*(part.scalars for part in filled), strict=True))),
        trajectories=Trajectory(*map(joined, zip(*(part.trajectories for part in filled), strict=True))),
    )


def pack_arrays(frames: Mapping[str, Frame], groups: Sequence[str], candidates: Sequence[str]) -> ModelArrays:
    """Arrays of the tables of a model layer, in the given order of groups and candidates.

    Raises:
        DatasetError: A table lacks a row, repeats or does not know a key, or holds a value that is not a number.
    """
    return ModelArrays(
        tuple(groups),
        tuple(candidates),
        pack_history([frames["state"]], "state", groups),
        pack_history([frames["past_controls"]], "past_controls", groups),
        pack_history([frames["expert"]], "expert", groups),
        pack_surroundings([frames["surroundings"]], groups),
        pack_actions(frames["actions"], candidates),
        pack_scalars([frames["scalars"]], groups, candidates),
        pack_trajectories([frames["trajectories"]], groups, candidates),
    )


def pack_history(frames: Iterable[Frame], table: str, groups: Sequence[str]) -> Array:
    """History `table` as ``[N, rows, features]``; state, past_controls or expert."""
    names = {feature.name: feature.name for feature in HISTORIES[table].features}
    return _pack(frames, table, names, (groups, HISTORIES[table].offsets)).values


def pack_surroundings(frames: Iterable[Frame], groups: Sequence[str]) -> Masked | None:
    """Surroundings as ``[N, 16, 11]``; ``None`` where the table has no row at all, because evidence is missing."""
    filled = (frame for frame in frames if num_rows(frame))
    first = next(filled, None)
    if groups and first is None:
        return None
    table = "surroundings"
    columns = {feature.name: feature.columns[0] for feature in HISTORIES[table].features}
    return _pack(chain(() if first is None else (first,), filled), table, columns, (groups, HISTORIES[table].offsets))


def pack_objects(frame: Frame, groups: Sequence[str]) -> PackedObjects:
    """Objects as float32 ``[N, 16, 32, 11]``; those of an observation in the order of their numbers.

    Raises:
        DatasetError: An object is of no group or no observation, stands twice, is one too many, or has a value that is
            not a number.
    """
    table = "objects"
    rows = sort_rows(frame, ("offset_ticks", "object_index"))
    places = {group: i for i, group in enumerate(groups)}
    owner = np.array([places.get(group, -1) for group in rows["group_id"].tolist()], np.int64)
    offset = np.searchsorted(HISTORY_OFFSETS, rows["offset_ticks"])
    is_known = np.isin(rows["offset_ticks"], HISTORY_OFFSETS) & (owner >= 0)
    moment = owner * len(HISTORY_OFFSETS) + offset
    order = np.argsort(moment, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(moment[order], moment[order], side="left")
    wrong = ~is_known | (rank >= MAX_OBJECTS)
    wrong[repeated_rows(rows, LAYER_TABLES[table].key)] = True
    columns = []
    for name, column in OBJECT_FEATURES:
        cells = np.ma.getdata(rows[column])
        columns.append((cells == name.removeprefix(f"{column}_")) if name != column else cells)
        wrong |= np.zeros(len(cells), bool) if name != column else ~np.isfinite(cells)
    for row in np.flatnonzero(wrong)[:1]:
        found = _format_key(rows, LAYER_TABLES[table].key, int(row))
        raise DatasetError(
            f"table `{table}`: row of {found}: not one of at most {MAX_OBJECTS} objects, in finite numbers, of an "
            "observation of a group of the layer"
        )
    shape = (len(groups), len(HISTORY_OFFSETS), MAX_OBJECTS)
    values, available = np.zeros((*shape, len(OBJECT_FEATURES)), np.float32), np.zeros(shape, bool)
    values[owner, offset, rank] = np.stack(columns, axis=-1) if columns else 0
    available[owner, offset, rank] = True
    return PackedObjects(values, available)


def pack_actions(frame: Frame, candidates: Sequence[str]) -> NDArray[np.float32] | None:
    """Encoded actions, float32 ``[A, encoding width]``; ``None`` where no action is encoded."""
    vectors, available = _column(frame, "actions", "encoding", (candidates,))
    if not available.any():
        return None
    widths = {len(vector) if there else 0 for vector, there in zip(vectors, available, strict=True)}
    if len(widths) != 1:
        raise DatasetError(
            f"table `actions`: encodings have widths {sorted(widths)}; expected one width for all candidates"
        )
    matrix = np.stack([np.asarray(vector, np.float64) for vector in vectors])
    for row, _ in np.argwhere(~np.isfinite(matrix))[:1].tolist():
        raise DatasetError(f"table `actions`: the encoding of {candidates[row]!r} holds a value that is not a number")
    return matrix.astype(np.float32)


def pack_scalars(frames: Iterable[Frame], groups: Sequence[str], candidates: Sequence[str]) -> Targets:
    """Scalar targets as ``[N, A, 6]``."""
    return Targets(*_pack(frames, "scalars", {target.name: target.name for target in TARGETS}, (groups, candidates)))


def pack_trajectories(frames: Iterable[Frame], groups: Sequence[str], candidates: Sequence[str]) -> Trajectory:
    """Trajectories as ``[N, A, 10, 5]``; every step is available."""
    values = _pack(frames, "trajectories", {name: name for name in TRAJECTORY}, (groups, candidates, STEPS)).values
    return Trajectory(values, np.ones(values.shape[:3], bool))


def pack_column(
    frame: Frame, table: str, column: str, groups: Sequence[str], candidates: Sequence[str]
) -> np.ma.MaskedArray[Any, Any]:
    """One column of a keyed table in its own type, ``[N, rows]``, ``[N, A]``, ``[N, A, 10]`` or ``[A]``.

    Raises:
        DatasetError: As `pack_arrays`.
    """
    offsets = HISTORIES[table].offsets if table in HISTORIES else ()
    labels = {"group_id": groups, "action_key": candidates, "offset_ticks": offsets, "step": STEPS}
    values, available = _column(frame, table, column, tuple(labels[name] for name in LAYER_TABLES[table].key))
    return np.ma.MaskedArray(values, ~available)


class _Places:
    """Places of the rows of a table by their keys, each of which is given once.

    Args:
        table: Its name.
        axes: Labels of its key columns, in order.

    Attributes:
        shape: ``(len(axis), ..)``.
    """

    def __init__(self, table: str, axes: Sequence[Sequence[Any]]) -> None:
        self.shape = tuple(len(labels) for labels in axes)
        self._table, self._key, self._axes = table, LAYER_TABLES[table].key, axes
        self._places = [{label: i for i, label in enumerate(labels)} for labels in axes]
        for name, labels, places in zip(self._key, axes, self._places, strict=True):
            if len(places) != len(labels):
                raise ValueError(f"`{name}` {_repeated(labels)!r} is given twice; every label of an axis is given once")
        self._counts = np.zeros(int(np.prod(self.shape)), np.int32)

    def __len__(self) -> int:
        return len(self._counts)

    def take(self, frame: Frame) -> Index:
        """The place of each row of a frame, in an array of the shape that is flat; a key of no place is refused."""
        flat = np.zeros(num_rows(frame), np.int64)
        for name, labels in zip(self._key, self._places, strict=True):
            codes = np.fromiter(map(labels.get, np.ma.getdata(frame[name]).tolist(), repeat(-1)), np.int64, len(flat))
            for row in np.flatnonzero(codes < 0)[:1]:
                found = _format_key(frame, self._key, int(row))
                raise DatasetError(
                    f"table `{self._table}`: row of {found}: this `{name}` is not one of the {len(labels)} expected"
                )
            flat = flat * len(labels) + codes
        np.add.at(self._counts, flat, 1)
        return flat

    def check(self) -> None:
        """Refuse a place that has taken no row, or several."""
        for place in np.flatnonzero(self._counts != 1)[:1]:
            labels = [axis[i] for axis, i in zip(self._axes, np.unravel_index(place, self.shape), strict=True)]
            where = ", ".join(f"`{name}` {label!r}" for name, label in zip(self._key, labels, strict=True))
            found = f"{self._counts[place]} rows of {where}"
            raise DatasetError(f"table `{self._table}`: {found}; expected exactly one for each key")


def _pack(frames: Iterable[Frame], table: str, features: Mapping[str, str], axes: Sequence[Sequence[Any]]) -> Masked:
    """Features, each with its column, as ``[len(axis), .., features]``; `axes` are the labels of the key columns."""
    places = _Places(table, axes)
    values = np.full((len(places), len(features)), np.nan)
    available = np.zeros(values.shape, bool)
    for frame in frames:
        flat = places.take(frame)
        for i, (name, column) in enumerate(features.items()):
            values[flat, i], available[flat, i] = _numbers(frame, table, name, column)
    places.check()
    return Masked(*(found.reshape(*places.shape, len(features)) for found in (values, available)))


def _column(frame: Frame, table: str, column: str, axes: Sequence[Sequence[Any]]) -> tuple[NDArray[Any], Mask]:
    """A column in its own type and its availability, ``[len(axis), ..]``."""
    places = _Places(table, axes)
    flat = places.take(frame)
    places.check()
    rows = np.empty(len(flat), np.int64)
    rows[flat] = np.arange(len(flat))
    values, available = (found[rows].reshape(places.shape) for found in _masked(frame, table, column))
    return values, available


def _repeated(labels: Sequence[Any]) -> Any:
    return next(label for i, label in enumerate(labels) if label in labels[:i])


def _format_key(frame: Frame, key: Sequence[str], row: int) -> str:
    return ", ".join(f"`{name}` {np.ma.getdata(frame[name])[row : row + 1].tolist()[0]!r}" for name in key)


def _masked(frame: Frame, table: str, column: str) -> tuple[NDArray[Any], Mask]:
    """Values and availability of a column; nulls stand exactly where its mask is false."""
    values, there = np.ma.getdata(frame[column]), ~np.ma.getmaskarray(frame[column])
    declared = LAYER_TABLES[table][column].available
    if declared is not None and declared.mask is not None:
        mask = np.ma.getdata(frame[declared.mask]).astype(bool)
        for row in np.flatnonzero(mask != there)[:1]:
            found = _format_key(frame, LAYER_TABLES[table].key, int(row))
            state = "null where its mask is true" if mask[row] else "not null where its mask is false"
            raise DatasetError(f"table `{table}`: row of {found}: `{column}` is {state}, `{declared.mask}`")
    return values, np.asarray(there)


def _numbers(frame: Frame, table: str, feature: str, column: str) -> Masked:
    """A feature in float64, NaN where it is not available: a column of numbers or flags, or a category of one."""
    values, available = _masked(frame, table, column)
    if column != feature:
        values = values == feature.removeprefix(f"{column}_")
    numbers = np.where(available, values.astype(np.float64), np.nan)
    for row in np.flatnonzero(available & ~np.isfinite(numbers))[:1]:
        found = _format_key(frame, LAYER_TABLES[table].key, int(row))
        raise DatasetError(f"table `{table}`: row of {found}: `{column}` is {numbers[row]}, not a finite number")
    return Masked(numbers, available)
