"""The price of a violation: a knapsack over training groups under one budget.

With predicted gains ``g`` and probabilities ``p`` of the interventions ``a`` of ``N`` groups::

    max sum g_ga x_ga     such that   sum p_ga x_ga <= alpha N,   sum_a x_ga <= 1,   x >= 0

Its dual price ``lambda`` says what a unit of violation is worth at the budget, and at that price the optimum takes
``argmax_a g_ga - lambda p_ga`` in every group, 0 for nominal: the selector of the path.

Source: linear programming duality; the use is this project's choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.guard.program import cvxpy, solve

__all__ = ["Knapsack", "knapsack"]

Array = NDArray[np.float64]


class Knapsack(NamedTuple):
    """Optimum of the program.

    Attributes:
        dual_price: Utility per expected violation, at least 0; 0 where the budget is not used up.
        gain: Mean predicted gain of a group.
    """

    dual_price: float
    gain: float


def knapsack(gains: Array, probabilities: Array, *, alpha: float) -> Knapsack:
    """Dual price of the budget.

    Args:
        gains: Predicted gains of interventions over nominal ``[groups, interventions]``.
        probabilities: Of a violation, of the same shape.
        alpha: Violations allowed per group.

    Raises:
        ProgramError: The program was not solved to optimality.
    """
    num_groups, num_interventions = gains.shape
    takes = cvxpy.Variable((num_groups, num_interventions))
    budget = cvxpy.sum(cvxpy.multiply(probabilities, takes)) <= alpha * num_groups
    problem = cvxpy.Problem(
        cvxpy.Maximize(cvxpy.sum(cvxpy.multiply(gains, takes))), [takes >= 0, cvxpy.sum(takes, axis=1) <= 1, budget]
    )
    total = solve(problem, "knapsack of the violation budget")
    return Knapsack(max(float(budget.dual_value), 0.0), total / num_groups)
