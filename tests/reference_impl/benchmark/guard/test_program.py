"""Solving: the statement is the program, a certificate decides, and giving up says what was tried."""

from __future__ import annotations

import builtins
import importlib
import io
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.reference_impl.benchmark.guard.test_regression import LOSSES, example
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.cli.main import run
from branchdrive.driving.utility import fit_scale
from branchdrive.errors import ToolError
from branchdrive.runtime.environment import install_command
from branchdrive_reference.benchmark.guard.regression import LOGISTIC, Regression, polished

cp = pytest.importorskip("cvxpy")
program = pytest.importorskip("branchdrive_reference.benchmark.guard.program")


def statement(regression: Regression) -> Callable[[Any, Any], Any]:
    """Losses of the rows in cvxpy."""
    if regression.loss is LOGISTIC:
        return lambda z, truth: cp.logistic(z) - cp.multiply(truth, z)
    return lambda z, truth: cp.huber(z - truth)


def solved(regression: Regression) -> np.ndarray:
    found = program.solve(regression, statement(regression), "fit of the test")
    assert isinstance(found, np.ndarray)
    return found


def ended(monkeypatch: pytest.MonkeyPatch, solve: Callable[..., Any], status: str) -> list[str]:
    """Let `solve` stand for solvers and `status` for their word; the list is of those that were called."""
    called: list[str] = []

    def instead(problem: Any, solver: str, **options: Any) -> Any:
        called.append(solver)
        return solve(problem, solver, **options)

    monkeypatch.setattr(cp.Problem, "solve", instead)
    monkeypatch.setattr(cp.Problem, "status", property(lambda problem: status))
    return called


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_the_statement_is_the_program(loss: Any) -> None:
    rng = np.random.default_rng(2)
    regression = example(loss, 2)
    problem = program.cvxpy_problem(regression, statement(regression))
    assert problem.is_dcp()
    weights, offset = sorted(problem.variables(), key=lambda variable: -variable.size)
    for scale in (0.0, 0.1, 5.0):
        point = scale * rng.normal(size=7)
        weights.value, offset.value = point[:-1], point[-1]
        assert problem.objective.value == pytest.approx(regression.value(point), rel=1e-12)
        kept = all((constraint.violation() <= 0).all() for constraint in problem.constraints)
        assert kept == bool((point * regression.signs >= 0).all())


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_every_solver_leads_to_the_same_point(loss: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for solvers in ({"CLARABEL": {}}, {"SCS": {}}, {}):
        monkeypatch.setattr(program, "SOLVERS", solvers)
        found.append(solved(example(loss, 3)))
    assert np.ptp(found, axis=0).max() <= 1e-11


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_a_solver_that_sees_a_part_of_the_rows_leads_to_the_same_point(
    loss: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, regression, seen = solved(example(loss, 3)), example(loss, 3), []
    stated = program.cvxpy_problem
    monkeypatch.setattr(
        program, "cvxpy_problem", lambda part, *rest: seen.append(len(part.rows)) or stated(part, *rest)
    )
    for most in (len(regression.rows), len(regression.rows) - 1, 7, 1):
        monkeypatch.setattr(program, "START_ROWS", most)
        assert abs(solved(regression) - whole).max() <= 1e-11
        assert seen[-1] <= most
    assert seen[0] == len(regression.rows)


def test_a_solver_that_doubts_itself_is_judged_by_its_point() -> None:
    # cvxpy warns of what is inaccurate, and warnings are errors here.
    regression = example(LOGISTIC, 4)
    best = polished(regression, np.zeros(7))
    beyond = {"tol_gap_abs": 1e-30, "tol_gap_rel": 1e-30, "tol_feas": 1e-30}
    with pytest.warns(UserWarning, match="inaccurate"):
        problem = program.cvxpy_problem(regression, statement(regression))
        problem.solve(solver="CLARABEL", **beyond)
    assert problem.status == "optimal_inaccurate"
    for options in (beyond, {"max_iter": 2}):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(program, "SOLVERS", {"CLARABEL": options})
            assert abs(solved(regression) - best).max() <= 1e-11


def test_inaccurate_is_accepted_by_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    regression = example(LOGISTIC, 5)
    near = polished(regression, np.zeros(7)) + 1e-4 * regression.signs

    def doubtful(problem: Any, solver: str, **options: Any) -> Any:
        warnings.warn("Solution may be inaccurate. Try another solver", UserWarning, stacklevel=1)
        weights, offset = sorted(problem.variables(), key=lambda variable: -variable.size)
        weights.value, offset.value = near[:-1], near[-1]

    called = ended(monkeypatch, doubtful, "optimal_inaccurate")
    assert regression.certificate(near).distance > program.ACCURACY
    assert regression.certificate(solved(regression)).distance <= program.ACCURACY
    assert called == ["CLARABEL"]


@pytest.mark.parametrize(
    "error",
    [cp.error.SolverError("numbers"), ZeroDivisionError("division"), ValueError("NaN"), TypeError("unknown setting")],
    ids=lambda error: type(error).__name__,
)
def test_a_solver_that_fails_is_followed_by_the_next(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    original = cp.Problem.solve

    def failing(problem: Any, solver: str, **options: Any) -> Any:
        if solver == "CLARABEL":
            raise error
        return original(problem, solver=solver, **options)

    called = ended(monkeypatch, failing, "optimal")
    regression = example(LOGISTIC, 6)
    assert abs(solved(regression) - polished(regression, np.zeros(7))).max() <= 1e-11
    assert called == ["CLARABEL", "SCS"]


def test_without_any_solver_the_steps_start_at_0(monkeypatch: pytest.MonkeyPatch) -> None:
    called = ended(monkeypatch, lambda problem, solver: None, "user_limit")
    monkeypatch.setattr(program, "SOLVERS", {"CLARABEL": {}, "SCS": {}})
    regression = example(LOGISTIC, 7)
    assert regression.certificate(solved(regression)).distance <= program.ACCURACY
    assert called == ["CLARABEL", "SCS"]


def test_giving_up_says_what_was_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(problem: Any, solver: str, **_: Any) -> None:
        if solver == "CLARABEL":
            raise cp.error.SolverError("numbers")

    ended(monkeypatch, failing, "unbounded")
    monkeypatch.setattr(program, "polished", lambda regression, start: np.append(start[:-1], 1e-6))
    with pytest.raises(
        program.ProgramError,
        match=r"^the fit of the test was not solved: expected a point at most 1e-10 from the minimum; "
        r"CLARABEL failed \(SolverError: numbers\) and left no numbers; "
        r"SCS ended with 'unbounded' and left no numbers; 0 was the "
        r"last start, Newton steps from there at a residual of \d\.\de-\d+ with a curvature of \d\.\de-\d+, at most "
        r"inf from the minimum$",
    ) as found:
        solved(example(LOGISTIC, 8))
    assert isinstance(found.value, ToolError)
    assert "scale" not in str(found.value)


def test_what_is_nearly_right_is_not_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    regression = example(LOGISTIC, 9)
    best = polished(regression, np.zeros(7))
    monkeypatch.setattr(program, "SOLVERS", {})
    for beside, accepted in ((1e-12, True), (1e-9, False)):
        monkeypatch.setattr(program, "polished", lambda *_, beside=beside: best + np.append(np.zeros(6), beside))
        if accepted:
            assert solved(regression)[-1] == best[-1] + beside
        else:
            with pytest.raises(program.ProgramError, match=r"expected a point at most 1e-10"):
                solved(regression)


def test_a_fit_that_is_not_solved_ends_in_exit_code_4(monkeypatch: pytest.MonkeyPatch) -> None:
    fold = pytest.importorskip("branchdrive_reference.benchmark.guard.fold")
    train = pytest.importorskip("branchdrive_reference.benchmark.command.train")
    training, protocol = banks(20, seed=3), default_protocol()
    data = SimpleNamespace(part=lambda _: SimpleNamespace(targets=training.outcomes), nominal=0)
    workspace = SimpleNamespace(release="release", folds=Path("folds"))
    monkeypatch.setattr(fold, "fold_tasks", lambda *_: [])
    monkeypatch.setattr(fold, "_out_of_fold", lambda *_, **__: training.scalars)
    monkeypatch.setattr(fold, "utility_scale", lambda *_: fit_scale(training.outcomes))
    monkeypatch.setattr(program, "polished", lambda regression, start: start + 1.0)
    monkeypatch.setattr(train, "run", lambda *_: fold.fit_guard(workspace, protocol, data, device="cpu"))
    stdout, stderr = io.StringIO(), io.StringIO()
    assert run(["train", "release"], stdout, stderr) == 4
    (line,) = stderr.getvalue().splitlines()
    assert line.startswith(
        "branchdrive: release: the logistic fit of violations was not solved: expected a point at most 1e-10 "
    )
    assert line.endswith("use `--no-guard` to go without a guard")


def test_without_cvxpy_the_remedy_is_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.import_module

    def missing(name: str, *others: Any) -> Any:
        if name == "cvxpy":
            raise ModuleNotFoundError("No module named 'cvxpy'", name="cvxpy")
        return find(name, *others)

    monkeypatch.setattr(importlib, "import_module", missing)
    source = program.__spec__.loader.get_source(program.__name__)
    with pytest.raises(ModuleNotFoundError, match=re.escape(install_command("guard"))):
        exec(builtins.compile(source, "program.py", "exec"), {"__name__": "without_cvxpy"})
