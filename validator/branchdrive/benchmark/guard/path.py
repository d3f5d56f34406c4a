"""The selection path: from always nominal to the unguarded selector, one selection for every multiplier.

With predicted gain ``u_a - u_nominal`` and learned risk ``rho_a`` of a candidate, 0 both for nominal::

    a(lambda) = argmax_a (u_a - u_nominal) - lambda rho_a          lambda = inf > ... > 0;  inf is nominal
    L(lambda) = [a(lambda) not nominal and y_a(lambda) < y_nominal - eps - 1e-9 m]
    envelope  = max over lambda' >= lambda of L(lambda')

Scores within ``1e-9 (1 + lambda)`` of the best are equally good, and the first of them is taken.

The loss itself need not grow along the path, since a smaller multiplier may swap one intervention for a
better one; the envelope does, and bounds it.

Source: this project's choice; a linear program with a violation budget has this selector as its optimum.

The paper's guard: one margin on predicted separation for all groups and interventions.

On ``n`` calibration groups, with the seed-mean prediction ``p`` of the separation ``y``::

    r_g    = max over interventions a of  p_ga - y_ga              overprediction
    q      = r_(k),   k = ceil(0.95 n)                              84th of 88
    accept   p_a - q >= p_nominal - 1e-9 m;  take the best predicted utility among accepted and nominal

The rank is not the conformal ``ceil(0.95 (n + 1))``, so the margin has no finite-sample guarantee; it is
kept as the paper has it, to compare with. A guard that accepts no intervention is vacuous.

Source: paper, "Conservative Calibration and Deployment Boundary"; the rank from its printed coverage, 84 / 88.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.measure import choose
from branchdrive.driving.utility import TIE
from branchdrive.statistics.binomial import exact_fraction

__all__ = [
    "COVERAGE",
    "TOLERANCE_M",
    "GlobalMargin",
    "MarginReport",
    "SelectionPath",
    "accepted",
    "envelope",
    "fit_margin",
    "margin_report",
    "margin_selection",
    "multiplier_grid",
    "selection_path",
    "violations",
    "worst_overprediction",
]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

TOLERANCE_M = 0.25
"""``eps``: how much separation a selection may lose against nominal before it counts as a violation, metres."""

_LEAST_CENTRE = 0.01
_ABOVE, _BELOW = 30.0, 60.0


class SelectionPath(NamedTuple):
    """Selections by multiplier.

    Attributes:
        multipliers: ``lambda``, falling from ``inf`` to 0, ``[multipliers]``.
        selections: Chosen candidate ``[multipliers, groups]``.
    """

    multipliers: Array
    selections: Indices


def multiplier_grid(dual_multiplier: float, *, size: int = 100) -> tuple[float, ...]:
    """Finite positive multipliers, falling evenly in their logarithm from 30 to 1/60 times the dual one, at least 0.01.

    A grid is made once, from training alone, and kept as data; the path adds ``inf`` and 0.

    Raises:
        ValueError: The dual multiplier is negative or no number, or the grid has fewer than two multipliers.
    """
    if not (0 <= dual_multiplier < np.inf) or size < 2:
        raise ValueError(f"no grid of {size} multipliers about {dual_multiplier!r}")
    centre = max(dual_multiplier, _LEAST_CENTRE)
    return tuple(np.geomspace(_ABOVE * centre, centre / _BELOW, size).tolist())


def selection_path(gains: Array, risks: Array, multipliers: Sequence[float], *, nominal: int) -> SelectionPath:
    """The selections at ``inf``, at every one of `multipliers` and at 0.

    Args:
        gains: Predicted utility minus that of nominal ``[groups, candidates]``.
        risks: Learned risk ``[groups, candidates]``, at least 0, and 0 for nominal.
        multipliers: Finite, positive, falling.
        nominal: Place of the nominal candidate.

    Raises:
        ValueError: Shapes differ, values are out of range, or the multipliers do not fall.
    """
    if gains.shape != risks.shape or gains.ndim != 2:
        raise ValueError(f"gains {list(gains.shape)} and risks {list(risks.shape)} are not both [groups, candidates]")
    if not (np.isfinite(gains).all() and np.isfinite(risks).all() and (risks >= 0).all()):
        raise ValueError("gains and risks are finite numbers, and risks at least 0")
    if (gains[:, nominal] != 0).any() or (risks[:, nominal] != 0).any():
        raise ValueError(f"candidate {nominal} is nominal and has neither gain nor risk")
    inner = np.asarray(multipliers, np.float64)
    if not (np.isfinite(inner).all() and (inner > 0).all() and (np.diff(inner) < 0).all()):
        raise ValueError("multipliers are finite and positive and fall along the path")
    grid = np.concatenate(([np.inf], inner, [0.0]))
    selections = np.full((len(grid), len(gains)), nominal, np.intp)
    for place, multiplier in enumerate(grid[1:].tolist(), start=1):
        selections[place] = choose(gains - multiplier * risks, TIE * (1 + multiplier))
    return SelectionPath(grid, selections)


def violations(selections: Indices, separation_m: Array, *, nominal: int, tolerance_m: float = TOLERANCE_M) -> Mask:
    """Whether a selection loses more than the tolerance of separation against nominal, of the shape of `selections`.

    What rounding may leave of a loss of the tolerance itself, 1e-9 m, is none.

    Args:
        selections: Chosen candidates ``[..., groups]``.
        separation_m: Executed separation ``[groups, candidates]``, metres.
        nominal: Place of the nominal candidate; choosing it is no violation.
        tolerance_m: Metres.

    Raises:
        ValueError: A separation is not finite; leave its group out.
    """
    if not np.isfinite(separation_m).all():
        raise ValueError("a separation is unavailable; leave its group out of the guard")
    chosen = separation_m[np.arange(len(separation_m)), selections]
    return np.asarray((selections != nominal) & (chosen < separation_m[:, nominal] - tolerance_m - TIE))


def envelope(losses: Mask) -> Mask:
    """Whether any selection up to a multiplier was a violation, ``[multipliers, groups]`` from the same."""
    return np.asarray(np.logical_or.accumulate(losses, axis=0))


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
        value: Mean executed utility of what the guard chooses.
        nominal_value: That of nominal.
        action_prior_value: That of the candidate with the greatest mean utility in training.
    """

    covered_candidates: float
    covered_groups: float
    acceptance: float
    num_actions: int
    vacuous: bool
    value: float
    nominal_value: float
    action_prior_value: float


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
    worst = np.sort(worst_overprediction(predicted_m, separation_m, nominal=nominal))
    rank = math.ceil(exact_fraction(coverage) * len(worst))
    if not 1 <= rank <= len(worst):
        raise ValueError(f"a coverage of {coverage!r} has no rank among {len(worst)} groups")
    return GlobalMargin(float(worst[rank - 1]), rank, len(worst))


def worst_overprediction(predicted_m: Array, separation_m: Array, *, nominal: int) -> Array:
    """Largest overprediction of an intervention ``[groups]``, metres; arguments as of `fit_margin`."""
    return np.asarray(_overprediction(predicted_m, separation_m, nominal).max(axis=1))


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
    predicted_m: Array,
    separation_m: Array,
    utilities: Array,
    executed: Array,
    margin: GlobalMargin,
    *,
    nominal: int,
    action_prior: int,
) -> MarginReport:
    """Coverage, acceptance, choices and their worth on groups, calibration groups or others; arguments as above.

    Args:
        predicted_m: Predicted separation.
        separation_m: Executed separation.
        utilities: Predicted utilities.
        executed: Executed utilities ``[groups, candidates]``.
        margin: What was fitted.
        nominal: Place of the nominal candidate.
        action_prior: Place of the candidate with the greatest mean utility in training.

    Raises:
        ValueError: As `fit_margin`.
    """
    covered = _overprediction(predicted_m, separation_m, nominal) <= margin.margin_m + TIE
    taken = np.delete(accepted(predicted_m, margin, nominal=nominal), nominal, axis=1)
    chosen = margin_selection(predicted_m, utilities, margin, nominal=nominal)
    return MarginReport(
        covered_candidates=float(covered.mean()),
        covered_groups=float(covered.all(axis=1).mean()),
        acceptance=float(taken.mean()),
        num_actions=len(np.unique(chosen)),
        vacuous=not taken.any(),
        value=float(executed[np.arange(len(chosen)), chosen].mean()),
        nominal_value=float(executed[:, nominal].mean()),
        action_prior_value=float(executed[:, action_prior].mean()),
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
