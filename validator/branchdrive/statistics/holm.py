"""Holm's step-down adjustment of p-values.

With ``p_(1) <= .. <= p_(m)``, the adjusted ``p_(i)`` is ``max_{j <= i} min(1, (m - j + 1) p_(j))``. Rejecting
where it is at most ``alpha`` keeps the family-wise error at ``alpha`` under any dependence.

Source: Holm 1979.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["holm"]


def holm(p_values: ArrayLike) -> NDArray[np.float64]:
    """Adjusted p-values of one family ``[tests]``, in the given order.

    Raises:
        ValueError: The shape is not ``[tests]``, or a value is not in ``[0, 1]``.
    """
    p = np.asarray(p_values, np.float64)
    if p.ndim != 1 or not ((p >= 0) & (p <= 1)).all():
        raise ValueError(f"p-values are {p.tolist()!r}, not [tests] with values in 0 .. 1")
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return adjusted
