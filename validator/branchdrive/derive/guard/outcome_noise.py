"""How far outcomes move when nominal is merely repeated, and which selected differences go beyond that.

For target ``t`` with nominal outcome ``y_g`` and repeated outcomes ``y_gr`` of the training groups::

    n_g = max over repeats r of |y_gr - y_g|         tolerance = 95 % quantile of n_g, numpy method 'higher'

A selected difference ``y_selected - y_nominal`` is beyond noise where its absolute value exceeds the tolerance.
A repeat that has the target where nominal has not, or lacks it where nominal has it, is counted and left out.

Source: this project's choice; the paper has no repeated nominal outcomes (VI-E) and leaves materiality open.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.derive.target import Targets

__all__ = ["QUANTILE", "OutcomeNoise", "SelectedDifferences", "outcome_noise", "selected_differences"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

QUANTILE = 0.95
"""Share of groups whose repeats stay within the tolerance."""


class OutcomeNoise(NamedTuple):
    """Tolerances, each field ``[6]`` in the order of `target.TARGETS`.

    Attributes:
        tolerance: In the units of the targets; NaN where no group has a repeated value. 0 means that repeats are
            identical and that every difference is beyond noise.
        num_groups: Groups with a repeated value.
        num_one_sided: Groups in which only one of nominal and a repeat has the target.
    """

    tolerance: Array
    num_groups: NDArray[np.int64]
    num_one_sided: NDArray[np.int64]


class SelectedDifferences(NamedTuple):
    """Differences of the chosen candidates against nominal, each ``[groups, 6]``.

    Attributes:
        difference: In the units of the targets; NaN where either side is unavailable.
        beyond: Whether the difference exceeds the tolerance; false where either is NaN.
    """

    difference: Array
    beyond: Mask

    @property
    def num_beyond(self) -> NDArray[np.int64]:
        """Groups whose difference is beyond noise ``[6]``."""
        return np.asarray(self.beyond.sum(axis=0))

    @property
    def num_compared(self) -> NDArray[np.int64]:
        """Groups that have a difference ``[6]``."""
        return np.asarray(np.isfinite(self.difference).sum(axis=0))


def outcome_noise(nominal: Targets, repeats: Targets, *, quantile: float = QUANTILE) -> OutcomeNoise:
    """Tolerances from training groups.

    Args:
        nominal: Outcomes of the nominal rollouts ``[groups, 6]``.
        repeats: Outcomes of their replays ``[groups, repeats, 6]``.
        quantile: In ``(0, 1]``.

    Raises:
        ValueError: Shapes do not match.
    """
    if repeats.values.ndim != 3 or nominal.values.shape != repeats.values[:, 0].shape:
        raise ValueError(
            f"nominal {list(nominal.values.shape)} and repeats {list(repeats.values.shape)} do not match: "
            "[groups, targets] and [groups, repeats, targets]"
        )
    both = np.asarray(nominal.available[:, None] & repeats.available)
    one_sided = (nominal.available[:, None] ^ repeats.available).any(axis=1)
    moved = np.abs(np.where(both, repeats.values, 0.0) - np.where(both, nominal.values[:, None], 0.0)).max(axis=1)
    has: Mask = np.asarray(both.any(axis=1))
    columns = [moved[has[:, target], target] for target in range(has.shape[1])]
    tolerance = [np.quantile(column, quantile, method="higher") if len(column) else np.nan for column in columns]
    return OutcomeNoise(np.array(tolerance), has.sum(axis=0), one_sided.sum(axis=0))


def selected_differences(
    outcomes: Targets, selection: NDArray[np.intp], noise: OutcomeNoise, *, nominal: int
) -> SelectedDifferences:
    """Differences of a selection ``[groups]`` on outcomes ``[groups, candidates, 6]``."""
    chosen = outcomes.values[np.arange(len(selection)), selection]
    difference = chosen - outcomes.values[:, nominal]
    return SelectedDifferences(difference, np.asarray(np.abs(difference) > noise.tolerance))
