"""Scales of the targets, from the available values of the training partition.

For target ``t`` with the available training values ``y``::

    iqr_t = max(q75(y) - q25(y), 1e-6)        linear quantiles
    sd_t  = max(sqrt(mean (y - mean y)^2), 1e-6)

Source: paper, "Experiments" (only the IQR explains its printed errors); the floors are this project's choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.driving.target import TARGETS
from branchdrive.model.normalisation import IQR_FLOOR

__all__ = ["Scale", "target_scale"]

Array = NDArray[np.float64]


class Scale(NamedTuple):
    """Scales ``[6]`` in the units of the targets; NaN where training has no value of a target."""

    iqr: Array
    sd: Array


def target_scale(values: ArrayLike, available: ArrayLike) -> Scale:
    """Scales of training targets ``[..., 6]`` with their mask of the same shape.

    Raises:
        ValueError: Shapes do not match, or a value that is available is not finite.
    """
    y, mask = np.asarray(values, np.float64), np.asarray(available, np.bool_)
    if y.shape != mask.shape or y.shape[-1:] != (len(TARGETS),):
        raise ValueError(f"values {list(y.shape)} and mask {list(mask.shape)} do not match: [..., {len(TARGETS)}]")
    if not np.isfinite(y[mask]).all():
        raise ValueError("an available training value is not finite")
    iqr, sd = np.full((2, len(TARGETS)), np.nan)
    for t in range(len(TARGETS)):
        # In ascending order the sums of `std` do not depend on the order of the groups.
        found = np.sort(y[..., t][mask[..., t]])
        if found.size:
            low, high = np.quantile(found, [0.25, 0.75])
            iqr[t], sd[t] = max(high - low, IQR_FLOOR), max(found.std(), IQR_FLOOR)
    return Scale(iqr, sd)
