"""Regressions stated in cvxpy and decided by a certificate.

A solver's word is not the measure: the same program ends as ``optimal`` on one processor and as
``optimal_inaccurate`` on another. Whatever point a solver leaves is polished by Newton steps and accepted where
`Certificate.distance` is small enough; else the next solver is tried, and last the steps from 0. Two accepted
points are nearer to each other than twice the accuracy, whichever solver and processor found them. So a solver may see
fewer rows: it takes some 9 kB of memory for each, and leads to where the steps begin.

Clarabel comes first by name, on one thread; cvxpy's own choice depends on what is installed.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.errors import ToolError
from branchdrive.runtime.environment import install_command
from branchdrive_reference.benchmark.guard.regression import Regression, polished

try:
    # Its functions are exported in a way that a type checker does not follow.
    cvxpy: Any = importlib.import_module("cvxpy")
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"`branchdrive_reference.benchmark.guard` needs the package {error.name!r}: {install_command('guard')}",
        name=error.name,
    ) from error

__all__ = ["ACCURACY", "SOLVERS", "ProgramError", "cvxpy", "cvxpy_problem", "solve"]

Array = NDArray[np.float64]

ACCURACY = 1e-10
"""Largest distance of an accepted point from the minimum, weights and offset together."""

START_ROWS = 20_000
"""Of more rows a solver sees a part."""

SOLVERS = {"CLARABEL": {"max_threads": 1}, "SCS": {"max_iters": 500}}
"""Solvers and their options, in the order in which they are tried."""


class ProgramError(ToolError):
    """A convex program whose minimum was not found by any solver."""


def cvxpy_problem(program: Regression, loss: Callable[[Any, Array], Any]) -> Any:
    """The same program as a problem of cvxpy, with the variables ``w`` and ``b``.

    Args:
        program: What is minimised.
        loss: Expression of the losses of the rows from that of their values, and from their truths.
    """
    rows, signs = program.rows[:, :-1], program.signs[:-1]
    weights, offset = cvxpy.Variable(rows.shape[1], name="w"), cvxpy.Variable(name="b")
    bound = signs != 0
    kept = [cvxpy.multiply(signs[bound], weights[bound]) >= 0] if bound.any() else []
    mean_loss = cvxpy.sum(loss(rows @ weights + offset, program.truth)) / len(rows)
    return cvxpy.Problem(cvxpy.Minimize(mean_loss + program.penalty * cvxpy.sum_squares(weights)), kept)


def solve(program: Regression, loss: Callable[[Any, Array], Any], name: str) -> Array:
    """Point ``[features + 1]`` within `ACCURACY` of the minimum, by certificate.

    Args:
        program: What is minimised.
        loss: As in `cvxpy_problem`.
        name: What an error calls it.

    Raises:
        ProgramError: No start led to a point with such a certificate.
    """
    tried = []
    for origin, start in _starts(cvxpy_problem(program.thinned(START_ROWS), loss)):
        if start is None or not np.isfinite(start).all():
            tried.append(f"{origin} and left no numbers")
            continue
        point = polished(program, start)
        found = program.certificate(point)
        if found.distance <= ACCURACY:
            return point
        tried.append(
            f"{origin}, Newton steps from there at a residual of {found.residual:.1e} with a curvature of "
            f"{found.curvature:.1e}, at most {found.distance:.1e} from the minimum"
        )
    raise ProgramError(
        f"the {name} was not solved: expected a point at most {ACCURACY:g} from the minimum; {'; '.join(tried)}"
    )


def _starts(problem: Any) -> Iterator[tuple[str, Array | None]]:
    """Where Newton steps can start, each with how it was found; a solver runs when its turn comes."""
    variables = {variable.name(): variable for variable in problem.variables()}
    weights, offset = variables["w"], variables["b"]
    for solver, options in SOLVERS.items():
        try:
            with warnings.catch_warnings():
                # What cvxpy warns of, the certificate judges.
                warnings.simplefilter("ignore")
                problem.solve(solver=solver, **options)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # however a solver fails, the next one is tried; a panic in Rust is no Exception
            yield f"{solver} failed ({type(error).__name__}: {error})", None
            continue
        is_solved = weights.value is not None and offset.value is not None
        start = np.append(weights.value, offset.value).astype(np.float64) if is_solved else None
        yield f"{solver} ended with {problem.status!r}", start
    yield "0 was the last start", np.zeros(weights.size + 1)
