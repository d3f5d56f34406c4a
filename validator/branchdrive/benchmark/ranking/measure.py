"""What a selector's choices are worth: six measures, one number for every group.

With executed utilities ``u``, shares ``w`` of a selector, and best and worst of the group::

    value = sum_a w_a u_a        difference = value - u_nominal        top 1 = sum of w_a where u_a >= best - TIE
    regret = (best - value) / (best - worst)                           0 where best - worst <= RANGE

Concordance and NDCG are in `order`. Rows of a learned selector are means of its per-seed measures.

Source: paper VI-D, table of offline policy evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.order import concordance, ndcg
from branchdrive.benchmark.ranking.selector import Selector
from branchdrive.driving.utility import RANGE, TIE

__all__ = ["Measures", "mean_measures", "measures", "without_range"]

Array = NDArray[np.float64]


class Measures(NamedTuple):
    """Measures of one selector, each ``[groups]``; a table prints their means, a test compares them by group.

    Attributes:
        value: Executed utility of the choice.
        difference: Value minus the nominal candidate's utility.
        regret: In ``[0, 1]``, 0 the best.
        concordance: In ``[0, 1]``; NaN where all utilities are equal.
        ndcg: In ``[0, 1]``.
        top_1: Share of the choice that is as good as the best.
    """

    value: Array
    difference: Array
    regret: Array
    concordance: Array
    ndcg: Array
    top_1: Array


def measures(selector: Selector, utilities: Array, *, nominal: int) -> Measures:
    """Measures of `selector` on groups with executed `utilities` ``[groups, candidates]``.

    Raises:
        ValueError: Shapes differ, or a utility is no number; such a group is not ranked.
    """
    if not selector.scores.shape == selector.shares.shape == utilities.shape:
        raise ValueError(
            f"scores {list(selector.scores.shape)}, shares {list(selector.shares.shape)} and utilities "
            f"{list(utilities.shape)} do not match: [groups, candidates]"
        )
    if not np.isfinite(utilities).all():
        raise ValueError("a utility is no number; leave its group out of the ranking")
    best, worst = utilities.max(axis=1), utilities.min(axis=1)
    value = (selector.shares * utilities).sum(axis=1)
    ranged = best - worst > RANGE
    return Measures(
        value=value,
        difference=value - utilities[:, nominal],
        regret=np.divide(best - value, best - worst, out=np.zeros(len(value)), where=ranged),
        concordance=concordance(selector.scores, utilities),
        ndcg=ndcg(selector.scores, utilities),
        top_1=(selector.shares * (utilities >= best[:, None] - TIE)).sum(axis=1),
    )


def mean_measures(seeds: Sequence[Measures]) -> Measures:
    """Mean over the seeds of a learned selector, group by group."""
    return Measures(*(np.mean(field, axis=0) for field in zip(*seeds, strict=True)))


def without_range(utilities: Array) -> int:
    """Number of groups whose utilities have no range to speak of: their regret counts as 0."""
    return int((utilities.max(axis=1) - utilities.min(axis=1) <= RANGE).sum())
