"""Thresholds of replay fidelity, fitted on training groups, and who passes them.

For a variable ``v`` with ``d[g, k, v]`` the discrepancy of replay ``k`` of group ``g``::

    threshold_v = max(floor_v, q_v),  q_v = quantile of {max_k d[g, k, v] : training groups g} at 0.99, the higher
                  order statistic
    pair passes  iff  d[g, k, v] is finite and <= threshold_v for every judged v
    bank passes  iff  all its pairs pass

The floors keep replays that are exact from a threshold of 0, which the last bits of others would miss. The offset
of branch ticks has the fixed threshold 0. The gap to the nearest pedestrian is judged only if
at least 100 training groups have a pedestrian in range. What is missing on one side is infinitely far and
never passes, even where the threshold itself is infinite.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" (442 training groups, at most 4 above each
threshold); spec/06-masks.md for what is missing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.limits import threshold_floors
from branchdrive.driving.discrepancy import CORE, EXTENDED

__all__ = [
    "FLOORS", "MIN_SUPPORT", "PEDESTRIAN_GAP", "QUANTILE", "VARIABLES", "Passed", "Thresholds", "fit_thresholds",
    "largest_discrepancies", "passes", "thresholds_of_largest",
]  # fmt: skip

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

QUANTILE = 0.99
"""Share of the training groups that pass a variable, at least."""

MIN_SUPPORT = 100
"""Training groups with a pedestrian in range from which on that gap is judged."""

VARIABLES = (*CORE, *EXTENDED)
"""Variables in the order of the last axis of discrepancies: core, then extended."""

PEDESTRIAN_GAP = next(variable for variable in EXTENDED if variable.name == "pedestrian_gap_m")
"""The extended variable that is judged only where it has support."""

FLOORS = np.array([threshold_floors()[variable.name] for variable in VARIABLES])
"""Least threshold of each variable ``[12]``, in its unit."""

_TICK_OFFSET = [variable.name for variable in VARIABLES].index("tick_offset")


class Thresholds(NamedTuple):
    """Thresholds in the order of `VARIABLES`.

    Attributes:
        values: ``[12]`` in the variables' units, NaN where not judged.
        judged: ``[12]``, whether the variable is judged at all.
        num_groups: Training groups they were fitted on.
        support: Training groups with a pedestrian in range.
    """

    values: Array
    judged: Mask
    num_groups: int
    support: int


class Passed(NamedTuple):
    """Who passes: core variables alone, and core and extended together.

    Attributes:
        core: ``[groups, pairs]``.
        extended: ``[groups, pairs]``, core and extended.
    """

    core: Mask
    extended: Mask

    @property
    def core_bank(self) -> Mask:
        """Groups all of whose pairs pass the core variables, ``[groups]``."""
        return np.asarray(self.core.all(axis=1))


def fit_thresholds(discrepancies: ArrayLike, *, has_pedestrian: ArrayLike) -> Thresholds:
    """Thresholds of structurally eligible training groups, which are all that this function may be given.

    Args:
        discrepancies: ``[groups, pairs, 12]`` in the order of `VARIABLES`, ``inf`` where something is
            missing on one side only.
        has_pedestrian: ``[groups]``, whether a pedestrian is in range of the nominal at any of the 16 observations.

    Raises:
        ValueError: Another shape, no group, no pair, or a discrepancy that is negative or NaN.
    """
    values = _checked(discrepancies)
    there = np.asarray(has_pedestrian, np.bool_)
    if not values.shape[0] or there.shape != values.shape[:1]:
        raise ValueError(f"{len(values)} training groups and `has_pedestrian` of shape {list(there.shape)}: [groups]")
    return thresholds_of_largest(values.max(axis=1), there)


def largest_discrepancies(discrepancies: ArrayLike) -> Array:
    """Largest discrepancy of the pairs of each group ``[groups, 12]``.

    Args:
        discrepancies: ``[groups, pairs, 12]``, as `fit_thresholds` takes them, or of no group.

    Raises:
        ValueError: As `fit_thresholds`.
    """
    values = np.asarray(discrepancies, np.float64)
    return _checked(values).max(axis=1) if len(values) else np.zeros((0, len(VARIABLES)))


def thresholds_of_largest(largest: Array, has_pedestrian: Mask) -> Thresholds:
    """Thresholds of training groups, in any order: order statistics of them and a count.

    Args:
        largest: Largest discrepancy of the pairs of each group ``[groups, 12]``, at least one group.
        has_pedestrian: ``[groups]``, as `fit_thresholds` takes it.
    """
    support = int(has_pedestrian.sum())
    judged = np.ones(len(VARIABLES), np.bool_)
    judged[VARIABLES.index(PEDESTRIAN_GAP)] = support >= MIN_SUPPORT
    quantiles = np.quantile(largest, QUANTILE, axis=0, method="higher")
    quantiles[_TICK_OFFSET] = 0.0
    return Thresholds(np.where(judged, np.maximum(quantiles, FLOORS), np.nan), judged, len(largest), support)


def passes(discrepancies: ArrayLike, thresholds: Thresholds) -> Passed:
    """Who passes, of any partition.

    Args:
        discrepancies: ``[groups, pairs, 12]`` in the order of `VARIABLES`, ``inf`` in every variable of a
            pair that is missing altogether.
        thresholds: Of the training groups.

    Raises:
        ValueError: Another shape, no pair, or a discrepancy that is negative or NaN.
    """
    values = _checked(discrepancies)
    within = (np.isfinite(values) & (values <= thresholds.values)) | ~thresholds.judged
    core = within[..., : len(CORE)].all(axis=2)
    return Passed(np.asarray(core), np.asarray(within.all(axis=2)))


def _checked(discrepancies: ArrayLike) -> Array:
    values = np.asarray(discrepancies, np.float64)
    if values.ndim != 3 or not values.shape[1] or values.shape[2] != len(VARIABLES):
        raise ValueError(f"discrepancies have shape {list(values.shape)}, not [groups, pairs, {len(VARIABLES)}]")
    if not (values >= 0).all():
        raise ValueError("a discrepancy is negative or no number; what is missing on one side is infinite")
    return values
