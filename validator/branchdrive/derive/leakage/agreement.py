"""Whether the rows of a group agree: such values cannot tell its actions apart.

Bit-identical replays give such features, and pass. A classifier with such scores is *inconclusive*, never a
pass: whatever it was shown, it made nothing of it.

Source: this project's choice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["rows_agree"]


def rows_agree(values: ArrayLike, *, atol: float = 0.0) -> bool:
    """Whether all rows of every group agree.

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
