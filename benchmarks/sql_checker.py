"""The checker in SQL on a dataset: what judging the rules that it covers takes another engine."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from benchmarks.cost import cost_of
from benchmarks.row import Row
from branchdrive.contract.rule import rules_of
from branchdrive.errors import BranchDriveError
from branchdrive.exit_code import EXIT_OF_VERDICT
from branchdrive.runtime.environment import install_command
from branchdrive.runtime.process import child_environment, python_command

__all__ = ["rows"]

_CHECKER = Path(__file__).parents[1] / "conformance_tests" / "duckdb_checker"


def rows(root: Path, *, num_groups: int) -> Iterator[Row]:
    """Cost of a run of the checker, on as many threads as DuckDB takes."""
    what = f"SQL checker, raw layer, {num_groups} groups"
    if find_spec("duckdb") is None:
        yield Row(what, f"not measured, DuckDB is not installed: {install_command('conformance')}")
        return
    num_covered = len(_run("--claims").split())
    cost = cost_of(lambda: _run(str(root)))
    num_rules = len(rules_of("dataset", "rows", "rollout", "group"))
    yield Row(f"{what}\n{num_covered} of {num_rules} rules, start-up included", str(cost))


def _run(argument: str) -> str:
    done = subprocess.run(  # noqa: S603  (this interpreter, with the checker of this project)
        python_command(str(_CHECKER), argument), capture_output=True, text=True, check=False, env=child_environment()
    )
    if done.returncode not in (EXIT_OF_VERDICT["valid"], EXIT_OF_VERDICT["partial"]):  # it does not judge every rule
        raise BranchDriveError(f"the SQL checker ended with {done.returncode}: {done.stderr}")
    return done.stdout
