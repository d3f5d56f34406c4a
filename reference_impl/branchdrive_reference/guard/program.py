"""Convex programs, solved to optimality or refused.

The solver is Clarabel by name: with cvxpy 1.9.3 its default for linear programs, HiGHS, calls some feasible
ones infeasible. Clarabel on one thread is deterministic.
"""

from __future__ import annotations

import importlib
from typing import Any

from branchdrive.errors import BranchDriveError

try:
    # Its functions are exported in a way that a type checker does not follow.
    cvxpy: Any = importlib.import_module("cvxpy")
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"`branchdrive_reference.guard` needs the package {error.name!r}: pip install 'branchdrive[guard]'",
        name=error.name,
    ) from error

__all__ = ["ProgramError", "cvxpy", "solve"]


class ProgramError(BranchDriveError):
    """A convex program that was not solved to optimality."""


def solve(problem: Any, name: str) -> float:
    """Optimal value of `problem`; its variables and dual variables hold the optimum afterwards.

    Raises:
        ProgramError: The solver failed, or ended with another status than ``optimal``.
    """
    try:
        problem.solve(solver=cvxpy.CLARABEL, max_threads=1)
    except cvxpy.error.SolverError as error:
        raise ProgramError(
            f"the {name} was not solved: Clarabel failed ({error}); check the scale of its data"
        ) from error
    if problem.status != cvxpy.OPTIMAL:
        raise ProgramError(
            f"the {name} was not solved: Clarabel ended with {problem.status!r}, expected 'optimal'; "
            "check the scale of its data"
        )
    return float(problem.value)
