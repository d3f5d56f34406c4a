"""Selectors against each other: captured share of the oracle gap, agreement of seeds, the non-worsening gate.

::

    captured share = sum_g (value - nominal) / sum_g (oracle - nominal)
    agreement_g    = share of the pairs of seeds that choose the same candidate in group g
    gate fails iff   mean_g mean_s (separation of the choice - separation of the reference) < -TIE

Source: paper VI-D and VI-E.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.measure import Measures
from branchdrive.driving.utility import RANGE, TIE

__all__ = ["Gate", "captured_share", "non_worsening", "seed_agreement"]

Array = NDArray[np.float64]


class Gate(NamedTuple):
    """Outcome of the non-worsening gate.

    Attributes:
        difference_m: Separation of the choice minus that of the reference ``[groups]``, metres.
        mean_m: Their mean, metres.
        passed: Whether the mean is not negative, but for rounding.
    """

    difference_m: Array
    mean_m: float
    passed: bool


def captured_share(found: Measures, oracle: Measures) -> float | None:
    """Part of the gap from nominal to oracle that a selector gains; `None` where the mean gap is at most `RANGE`.

    A ratio of means over groups: a bootstrap resamples `Measures.difference` of both.
    """
    gap = float(oracle.difference.mean())
    return float(found.difference.mean()) / gap if gap > RANGE else None


def seed_agreement(shares: Array) -> Array:
    """Agreement of the seeds ``[groups]``.

    Args:
        shares: One-hot choices ``[seeds, groups, candidates]``, at least two seeds.

    Raises:
        ValueError: There are fewer than two seeds.
    """
    if len(shares) < 2:
        raise ValueError(f"{len(shares)} seed has nothing to agree with; give at least two")
    chosen = shares.argmax(axis=2)
    agree = [chosen[one] == chosen[other] for one, other in combinations(range(len(shares)), 2)]
    return np.asarray(np.mean(agree, axis=0))


def non_worsening(separation_m: Array, shares: Array, reference: int) -> Gate:
    """The gate of one selector, against a candidate that is always the same.

    Args:
        separation_m: Executed minimum separation ``[groups, candidates]``, metres, of ranked groups.
        shares: Shares of the selector ``[seeds, groups, candidates]``; a seed that chooses another candidate of the
            same separation as the reference differs from it by nothing.
        reference: The candidate that ActionPrior takes.

    Raises:
        ValueError: There is no group, or a separation is no number.
    """
    if not separation_m.size or not np.isfinite(separation_m).all():
        raise ValueError("the gate needs groups in which every candidate has a separation")
    difference = (shares * (separation_m - separation_m[:, reference, None])).sum(axis=2).mean(axis=0)
    mean = float(difference.mean())
    return Gate(difference, mean, mean >= -TIE)
