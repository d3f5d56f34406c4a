"""Columns of a leakage audit: replay-specific features, standardised within groups.

A feature gives two columns, its value and its absolute deviation, so that means and spreads are both
seen; a feature that is anywhere unavailable gives a third. With the group median ``m_g`` over available
rows and the robust standard deviation ``s`` of the feature over all groups::

    value        z = clip((x - m_g) / s, -6, 6)
    deviation    |z|
    unavailable  1 where x is NaN, else 0

    s = 1.4826 median |x - m_g|       over rows where it is finite; the root mean square where that median is 0

What is unavailable takes the group median, which is to say ``z = 0``; that it was unavailable remains in
its own column. Infinite is a value, further than all others. A column that is constant within every
group is left out. Every step treats the rows of a group alike, so exchangeable rows stay exchangeable.

Columns are stored as whole numbers of a step, small enough that sums over all groups are exact in
float32, whatever their order.

Source: this project's choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.protocol import CLIP_SD

__all__ = [
    "MAX_GROUPS",
    "Column",
    "Kind",
    "Table",
    "checked",
    "median_of_available",
    "robust_sd",
    "rows_agree",
    "step_limit",
    "tabulate",
    "within_group_rank",
]

Array = NDArray[np.float64]
Steps = NDArray[np.float32]
Kind = Literal["value", "deviation", "unavailable"]

MAX_GROUPS = 2**16
"""Largest number of groups, at which a column still has 255 steps to each side."""

_EXACT = 2**24 - 1
_MAD_TO_SD = 1.4826


class Column(NamedTuple):
    """One column: index of its feature, and what of that feature it holds."""

    feature: int
    kind: Kind


@dataclass(frozen=True, eq=False)
class Table:
    """Standardised columns of a data set.

    Attributes:
        steps: Columns in whole steps ``[groups * actions, columns]``.
        ranks: Centred doubled ranks of the same columns, ``[groups * actions, columns]``.
        step: Size of one step: standard deviations for values and deviations.
        columns: What each column holds.
        sd: Robust standard deviation of every feature ``[features]``, in the feature's unit.
        num_groups: Groups.
        num_actions: Actions of a group.
    """

    steps: Steps
    ranks: Steps
    step: float
    columns: tuple[Column, ...]
    sd: Array
    num_groups: int
    num_actions: int

    @property
    def values(self) -> Array:
        """Columns as numbers, ``[groups, actions, columns]``."""
        return self.steps.reshape(self.num_groups, self.num_actions, self.steps.shape[1]) * np.float64(self.step)


def checked(features: ArrayLike) -> Array:
    """Features in float64.

    Raises:
        ValueError: The shape is not ``[groups, actions, features]`` with at least two actions and at most
            `MAX_GROUPS` groups.
    """
    array = np.asarray(features, np.float64)
    if array.ndim != 3 or array.shape[1] < 2:
        raise ValueError(
            f"features have shape {list(array.shape)}, not [groups, actions, features] with two actions or more"
        )
    if array.shape[0] > MAX_GROUPS:
        raise ValueError(f"features have {array.shape[0]} groups, not at most {MAX_GROUPS}")
    return array


def rows_agree(values: ArrayLike, *, atol: float = 0.0) -> bool:
    """Whether all rows of every group agree.

    Such values cannot tell the actions of a group apart: bit-identical replays pass, and a classifier with such scores
    is inconclusive, for whatever it was shown it made nothing of it.

    Args:
        values: ``[groups, rows, ...]``, features or scores of a classifier; NaN agrees with NaN alone.
        atol: Largest difference between rows that agree, in the unit of `values`.

    Raises:
        ValueError: There is no axis of rows.
    """
    array = np.asarray(values, np.float64)
    if array.ndim < 2:
        raise ValueError(f"values have shape {list(array.shape)}, not [groups, rows, ...]")
    with np.errstate(over="ignore"):
        return bool(np.isclose(array, array[:, :1], rtol=0.0, atol=atol, equal_nan=True).all())


def step_limit(num_groups: int) -> int:
    """Largest integer whose sums over `num_groups` groups are exact in float32."""
    return _EXACT // max(num_groups, 1)


def tabulate(features: ArrayLike, *, columns: tuple[Column, ...] | None = None, sd: Array | None = None) -> Table:
    """Table of features.

    Args:
        features: ``[groups, actions, features]``.
        columns: Columns by kind and then by feature; None is all that vary.
        sd: Standard deviation of every feature ``[features]``; None estimates it.

    Raises:
        ValueError: The shape is wrong.
    """
    x = checked(features)
    num_groups, num_actions, _ = x.shape
    unavailable = np.isnan(x)
    low, high = _middle(x, ~unavailable)
    median = _half_way(low, high)
    x = np.where(unavailable, median, x)
    with np.errstate(over="ignore", invalid="ignore"):
        # Equal and opposite in every bit for the middle two of an even number, whose deviations tie.
        half = x / 2
        signed = half - low / 2
        signed += np.subtract(half, high / 2, out=half)
        is_finite = np.isfinite(low) & np.isfinite(high)
        if not is_finite.all():
            signed = np.where(is_finite, signed, np.where(x == median, 0.0, x - median))
    signed[unavailable] = 0.0
    deviation = np.abs(signed)
    sd = robust_sd(deviation, unavailable) if sd is None else sd
    raw: dict[Kind, NDArray[Any]] = {"value": x, "deviation": deviation, "unavailable": unavailable}
    columns = _varying(raw) if columns is None else columns

    step = CLIP_SD / step_limit(num_groups)
    scale = np.where(sd > 0, sd, 1.0)
    steps, ranks = (np.empty((num_groups, num_actions, len(columns)), np.float32) for _ in range(2))
    start = 0
    for kind, values in raw.items():
        of = [column.feature for column in columns if column.kind == kind]
        place = np.s_[:, :, start : start + len(of)]
        start += len(of)
        ranks[place] = within_group_rank(values[:, :, of])
        if kind == "unavailable":
            steps[place] = np.rint(values[:, :, of] / step)
            continue
        with np.errstate(over="ignore"):
            z = (signed if kind == "value" else deviation)[:, :, of] / scale[of]
        np.clip(z, -CLIP_SD, CLIP_SD, out=z)
        z /= step
        steps[place] = np.rint(z, out=z)
    shape = (num_groups * num_actions, len(columns))
    return Table(steps.reshape(shape), ranks.reshape(shape), step, columns, sd, num_groups, num_actions)


def within_group_rank(values: NDArray[Any]) -> Steps:
    """Centred doubled ranks within groups, ties averaged: ``r_i = #{x_j < x_i} - #{x_j > x_i}``.

    Args:
        values: ``[groups, actions, columns]``, no NaN.
    """
    ranks = np.zeros(values.shape, np.int16)
    for other in range(values.shape[1]):
        ranks += values > values[:, other : other + 1]
        ranks -= values < values[:, other : other + 1]
    return ranks.astype(np.float32)


def _varying(raw: dict[Kind, NDArray[Any]]) -> tuple[Column, ...]:
    """Columns that vary within some group, by kind and then by feature."""
    found = []
    for kind, values in raw.items():
        varies = (values != values[:, :1]).any(axis=(0, 1))
        found += [Column(int(feature), kind) for feature in np.flatnonzero(varies)]
    return tuple(found)


def median_of_available(x: Array, available: NDArray[np.bool_]) -> Array:
    """Median over the available rows of each group, ``[groups, 1, features]``; 0 where there is none."""
    return _half_way(*_middle(x, available))


def _middle(x: Array, available: NDArray[np.bool_]) -> tuple[Array, Array]:
    """The middle two of the available rows of each group, or the middle one twice, each ``[groups, 1, features]``."""
    ordered = np.sort(x, axis=1)
    count = available.sum(axis=1, keepdims=True)
    low, high = (np.take_along_axis(ordered, np.maximum(place, 0), axis=1) for place in ((count - 1) // 2, count // 2))
    return low, high


def _half_way(low: Array, high: Array) -> Array:
    with np.errstate(invalid="ignore"):
        median = np.where(low == high, low, low / 2 + high / 2)
    return np.where(np.isnan(median), 0.0, median)


def robust_sd(deviation: Array, unavailable: NDArray[np.bool_]) -> Array:
    """Robust standard deviation over available rows of finite deviation, ``[features]``; 0 where nothing deviates."""
    use = ~unavailable & np.isfinite(deviation)
    sd = np.zeros(deviation.shape[2])
    for feature in range(len(sd)):
        found = deviation[:, :, feature][use[:, :, feature]]
        largest = found.max(initial=0.0)
        if largest > 0:
            sd[feature] = _MAD_TO_SD * np.median(found) or largest * _root_mean_square(found / largest)
    return np.minimum(sd, np.finfo(np.float64).max)


def _root_mean_square(values: Array) -> float:
    """Of values ``[n]``; their sum is rounded once, so that no order of summation changes it."""
    return math.sqrt(math.fsum(np.square(values).tolist()) / len(values))
