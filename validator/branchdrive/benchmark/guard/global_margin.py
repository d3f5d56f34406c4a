"""The paper's guard: one margin on predicted separation for all groups and interventions.

On ``n`` calibration groups, with the seed-mean prediction ``p`` of the separation ``y``::

    r_g    = max over interventions a of  p_ga - y_ga              overprediction
    q      = r_(k),   k = ceil(0.95 n)                              84th of 88
    accept   p_a - q >= p_nominal - 1e-9 m;  take the best predicted utility among accepted and nominal

The rank is not the conformal ``ceil(0.95 (n + 1))``, so the margin has no finite-sample guarantee; it is
kept as the paper has it, to compare with. A guard that accepts no intervention is vacuous.

Source: paper VI-E; the rank from its printed coverage, 84 / 88.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.selector import choose
from branchdrive.driving.utility import TIE
from branchdrive.statistics.binomial import exact_fraction

__all__ = ["COVERAGE", "GlobalMargin", "MarginReport", "accepted", "fit_margin", "margin_report", "margin_selection"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COVERAGE = 0.95
"""Share of calibration groups that the margin covers."""


class GlobalMargin(NamedTuple):
    """A fitted margin.

    Attributes:
        margin_m: ``q``, metres; negative where separation is underpredicted throughout.
        rank: ``k``, counted from 1.
        num_groups: ``n``.
    """

    margin_m: float
    rank: int
    num_groups: int


class MarginReport(NamedTuple):
    """What the guard does on a set of groups.

    Attributes:
        covered_candidates: Share of interventions with overprediction at most the margin and 1e-9 m.
        covered_groups: Share of groups in which all interventions are covered.
        acceptance: Share of interventions that are accepted.
        num_actions: Distinct candidates chosen, nominal included.
        vacuous: Whether no intervention is accepted in any group.
    """

    covered_candidates: float
    covered_groups: float
    acceptance: float
    num_actions: int
    vacuous: bool


def fit_margin(predicted_m: Array, separation_m: Array, *, nominal: int, coverage: float = COVERAGE) -> GlobalMargin:
    """Fit the margin on calibration groups.

    Args:
        predicted_m: Seed-mean predicted separation ``[groups, candidates]``, metres.
        separation_m: Executed separation ``[groups, candidates]``, metres.
        nominal: Place of the nominal candidate.
        coverage: In ``(0, 1]``.

    Raises:
        ValueError: Shapes differ, there is no group, or a value is not finite; leave such groups out.
    """
    worst = np.sort(_overprediction(predicted_m, separation_m, nominal).max(axis=1))
    rank = math.ceil(exact_fraction(coverage) * len(worst))
    if not 1 <= rank <= len(worst):
        raise ValueError(f"a coverage of {coverage!r} has no rank among {len(worst)} groups")
    return GlobalMargin(float(worst[rank - 1]), rank, len(worst))


def accepted(predicted_m: Array, margin: GlobalMargin, *, nominal: int) -> Mask:
    """Which interventions are accepted ``[groups, candidates]``; nominal is no intervention and always false."""
    keeps = predicted_m - margin.margin_m >= predicted_m[:, nominal, None] - TIE
    keeps[:, nominal] = False
    return keeps


def margin_selection(predicted_m: Array, utilities: Array, margin: GlobalMargin, *, nominal: int) -> NDArray[np.intp]:
    """Chosen candidates ``[groups]``, by predicted `utilities` ``[groups, candidates]``."""
    allowed = accepted(predicted_m, margin, nominal=nominal)
    allowed[:, nominal] = True
    return choose(np.where(allowed, utilities, -np.inf))


def margin_report(
    predicted_m: Array, separation_m: Array, utilities: Array, margin: GlobalMargin, *, nominal: int
) -> MarginReport:
    """Coverage, acceptance and choices on groups, calibration groups or others; arguments as above.

    Raises:
        ValueError: As `fit_margin`.
    """
    covered = _overprediction(predicted_m, separation_m, nominal) <= margin.margin_m + TIE
    taken = np.delete(accepted(predicted_m, margin, nominal=nominal), nominal, axis=1)
    return MarginReport(
        covered_candidates=float(covered.mean()),
        covered_groups=float(covered.all(axis=1).mean()),
        acceptance=float(taken.mean()),
        num_actions=len(np.unique(margin_selection(predicted_m, utilities, margin, nominal=nominal))),
        vacuous=not taken.any(),
    )


def _overprediction(predicted_m: Array, separation_m: Array, nominal: int) -> Array:
    """Of the interventions, ``[groups, candidates - 1]``."""
    if predicted_m.shape != separation_m.shape or predicted_m.ndim != 2 or not len(predicted_m):
        raise ValueError(
            f"predicted {list(predicted_m.shape)} and executed separations {list(separation_m.shape)} "
            "do not match: [groups, candidates], at least one group"
        )
    found = np.delete(predicted_m - separation_m, nominal, axis=1)
    if not np.isfinite(found).all():
        raise ValueError("a separation is unavailable; leave its group out of the guard")
    return found
