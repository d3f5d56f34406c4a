"""Solving: an optimum is a number, and everything else an error that says why."""

from __future__ import annotations

import builtins
import importlib
from typing import Any

import pytest

from branchdrive.errors import BranchDriveError

cp = pytest.importorskip("cvxpy")
program = pytest.importorskip("branchdrive_reference.guard.program")


def test_an_optimum_is_returned() -> None:
    x = cp.Variable()
    assert program.solve(cp.Problem(cp.Minimize((x - 3) ** 2 + 1), [x <= 2]), "square") == pytest.approx(2, abs=1e-6)
    assert x.value == pytest.approx(2, abs=1e-6)


@pytest.mark.parametrize(("sign", "bound", "status"), [(1, 1, "infeasible"), (-1, -1, "unbounded")])
def test_what_is_not_optimal_is_an_error_with_the_status(sign: int, bound: int, status: str) -> None:
    x = cp.Variable()
    constraints = [x >= 0] if sign < 0 else [x >= bound, x <= -bound]
    with pytest.raises(
        program.ProgramError, match=f"^the line was not solved: Clarabel ended with '{status}'"
    ) as found:
        program.solve(cp.Problem(cp.Minimize(sign * x), constraints), "line")
    assert isinstance(found.value, BranchDriveError)


def test_a_solver_that_fails_is_the_same_error() -> None:
    class Failing:
        def solve(self, **options: Any) -> None:
            assert options["solver"] == "CLARABEL"
            raise cp.error.SolverError("numbers")

    with pytest.raises(program.ProgramError, match=r"Clarabel failed \(numbers\)"):
        program.solve(Failing(), "line")


def test_without_cvxpy_the_remedy_is_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.import_module

    def missing(name: str, *others: Any) -> Any:
        if name == "cvxpy":
            raise ModuleNotFoundError("No module named 'cvxpy'", name="cvxpy")
        return find(name, *others)

    monkeypatch.setattr(importlib, "import_module", missing)
    source = program.__spec__.loader.get_source(program.__name__)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'branchdrive\[guard\]'"):
        exec(builtins.compile(source, "program.py", "exec"), {"__name__": "without_cvxpy"})
