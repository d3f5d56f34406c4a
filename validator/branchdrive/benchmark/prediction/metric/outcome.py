"""Outcomes of complete banks and predictions of them, in physical units.

``N`` groups, ``A`` candidates in the order of the bank, 6 targets in the order of
`branchdrive.driving.target.TARGETS`, 10 steps with the components of `branchdrive.driving.target.TRAJECTORY`.
A candidate's path counts where all ten of its steps are there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.target import TARGETS, TRAJECTORY

__all__ = ["MAX_MAGNITUDE", "Outcomes", "Predictions"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

MAX_MAGNITUDE = 1e12
"""Larger numbers are no quantity in these units, and their squares would not add up."""

_SCALARS = (len(TARGETS),)
_PATH = (FUTURE_OBSERVATIONS, len(TRAJECTORY))


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What was recorded.

    Attributes:
        scalars: ``[N, A, 6]``; 0 where not available.
        available: ``[N, A, 6]``.
        paths: ``[N, A, 10, 5]``; 0 where not complete.
        complete: ``[N, A]``, whether all steps of a path are there.
    """

    scalars: Array
    available: Mask
    paths: Array
    complete: Mask

    @classmethod
    def of(cls, scalars: ArrayLike, available: ArrayLike, trajectories: ArrayLike) -> Outcomes:
        """Outcomes ``[N, A, 6]`` with their mask, and ``[N, A, 10, 5]`` with NaN at a step that is not there.

        Raises:
            ValueError: Shapes do not match, or a value that is there is no number.
        """
        values, mask = np.asarray(scalars, np.float64), np.asarray(available, np.bool_)
        paths = np.asarray(trajectories, np.float64)
        _check_shapes(values, paths)
        if mask.shape != values.shape:
            raise ValueError(f"a mask of shape {list(mask.shape)} does not match values {list(values.shape)}")
        complete = np.asarray(~np.isnan(paths).any(axis=(2, 3)))
        values = np.where(mask, values, 0.0)
        paths = paths if complete.all() else np.where(complete[:, :, None, None], paths, 0.0)
        _check_numbers("an available outcome", values, paths)
        return cls(values, mask, paths, complete)

    @property
    def num_groups(self) -> int:
        """``N``."""
        return len(self.scalars)

    def take(self, groups: Index) -> Outcomes:
        """Outcomes of these groups, in this order."""
        return Outcomes(self.scalars[groups], self.available[groups], self.paths[groups], self.complete[groups])


@dataclass(frozen=True, eq=False)
class Predictions:
    """What one model of one seed said.

    Attributes:
        scalars: ``[N, A, 6]``, finite.
        paths: ``[N, A, 10, 5]``, finite; sine and cosine need no norm of 1.
    """

    scalars: Array
    paths: Array

    @classmethod
    def of(cls, scalars: ArrayLike, trajectories: ArrayLike) -> Predictions:
        """Predictions ``[N, A, 6]`` and ``[N, A, 10, 5]``.

        Raises:
            ValueError: Shapes do not match, or a value is not a number.
        """
        values, paths = np.asarray(scalars, np.float64), np.asarray(trajectories, np.float64)
        _check_shapes(values, paths)
        _check_numbers("a prediction", values, paths)
        return cls(values, paths)

    def take(self, groups: Index) -> Predictions:
        """Predictions for these groups, in this order."""
        return Predictions(self.scalars[groups], self.paths[groups])


def _check_shapes(scalars: Array, paths: Array) -> None:
    bank = scalars.shape[:2]
    if scalars.ndim != 3 or scalars.shape[2:] != _SCALARS or paths.shape != (*bank, *_PATH) or not all(bank):
        raise ValueError(
            f"scalars {list(scalars.shape)} and trajectories {list(paths.shape)} do not match: "
            f"[groups, candidates, {_SCALARS[0]}] and [groups, candidates, {_PATH[0]}, {_PATH[1]}], neither empty"
        )


def _check_numbers(what: str, *arrays: Array) -> None:
    for values in arrays:
        if not (values.min() >= -MAX_MAGNITUDE and values.max() <= MAX_MAGNITUDE):  # NaN is no such number either
            wrong = values[~(np.abs(values) <= MAX_MAGNITUDE)]
            raise ValueError(f"{what} is {float(wrong[0])!r}, not a finite number within +-{MAX_MAGNITUDE:g}")
