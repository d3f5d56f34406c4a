"""`make compat`: the suite with other versions of libraries, on other Pythons, and as other processors calculate.

What is declared is tried::

    lowest     the lowest declared version of every dependency but torch's family, on a Python that has wheels of them
    newest     the newest version of every dependency of the light core, on every Python that is found
    below      pyarrow below its bound: one line and exit code 4, never a finding about data
    processor  the numeric tests as three kinds of processors calculate, see `tests/processors.py`
    kernel     one release with a benchmark, judged by all rules, under every OpenBLAS kernel that can run here

Every environment gets a folder of its own below ``build/compat`` and is made again when the declarations change.
``--quick`` is what continuous integration runs: `lowest` with the light core alone, and the oldest processor, each with
a part of the tests.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table
from tests.processors import SETTINGS, blas_kernels, can_run

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "build" / "compat"

_PROBE = "import ensurepip, venv, sys; print(sys.executable)"

PYTHONS = ("3.11", "3.12", "3.13")
"""Pythons that are looked for."""

LOWEST_PYTHONS = ("3.11", "3.12")
"""Those that the lowest versions of all libraries have wheels for."""

CORE_TESTS = ("tests/validator",)
"""Tests that need nothing but the light core and the tools of the extra `test`."""

QUICK_CORE_TESTS = (
    "tests/validator/formats",
    "tests/validator/raw",
    "tests/validator/writer/test_round_trip.py",
    "tests/validator/contract",
    "tests/validator/statistics/test_drawn_words.py",
)

EXTRA_TESTS = (
    "tests/reference_impl/benchmark/guard",
    "tests/reference_impl/drawing",
    "tests/reference_impl/geometry",
    "tests/reference_impl/simulation",
    "tests/reference_impl/world",
)
"""Tests of the extras that have lowest versions to try."""

NUMERIC_TESTS = (
    "tests/validator/driving",
    "tests/validator/statistics",
    "tests/validator/quality",
    "tests/validator/leakage",
    "tests/validator/model",
    "tests/validator/benchmark",
    "tests/validator/engine/test_mutated_benchmark.py",
    "tests/reference_impl/benchmark/guard",
    "tests/reference_impl/learning",
    "tests/reference_impl/leakage",
    "tests/reference_impl/geometry",
    "tests/reference_impl/world",
    "tests/reference_impl/simulation",
)
QUICK_NUMERIC_TESTS = (
    "tests/validator/benchmark/guard/test_calibration.py",
    "tests/validator/benchmark/prediction/metric",
    "tests/validator/benchmark/ranking",
    "tests/validator/statistics",
    "tests/reference_impl/benchmark/guard/test_fit.py",
    "tests/reference_impl/benchmark/guard/test_program.py",
    "tests/reference_impl/geometry",
)

LOWEST_EXTRAS = ("sim", "plots", "guard", "test")
QUICK_EXTRAS = ("test",)
NO_LOWEST = ("torch", "safetensors", "onnx", "onnxruntime", "onnxscript")
"""Dependencies whose lowest versions are not tried; the bound of torch is the version that everything is tried with."""

OF_THEIR_TIME = ("pyparsing<3.3",)
"""What the lowest versions need too: matplotlib 3.9 calls what pyparsing 3.3 deprecates, and tests allow no warning."""

RELEASE = FOLDER / "release"

DEMO = ROOT / "build" / "demo" / "dataset"


class Outcome(NamedTuple):
    """One line of the table.

    Attributes:
        what: What was tried.
        found: What came of it.
        seconds: How long it took.
        is_good: Whether it is as it should be.
    """

    what: str
    found: str
    seconds: float
    is_good: bool


class Environment(NamedTuple):
    """A virtual environment with other versions.

    Attributes:
        name: Of its folder.
        python: The interpreter that makes it.
        extras: Of the distribution.
        bounds: Requirements that hold versions fixed, one for each line of a constraints file.
        newest: Whether everything is upgraded to the newest version.
    """

    name: str
    python: str
    extras: tuple[str, ...]
    bounds: tuple[str, ...]
    newest: bool = False

    @property
    def folder(self) -> Path:
        return FOLDER / self.name

    @property
    def interpreter(self) -> Path:
        return self.folder / "bin" / "python"

    def make(self) -> None:
        """Install the distribution, in editable mode, unless just this was installed before."""
        text = "\n".join([self.python, *self.extras, *self.bounds, declarations(), str(self.newest)])
        stamp, digest = self.folder / "made", hashlib.sha256(text.encode()).hexdigest()
        with suppress(OSError):
            if stamp.read_text() == digest and not self.newest:
                return
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        constraints = self.folder / "constraints.txt"
        constraints.write_text("\n".join(self.bounds) + "\n")
        run([self.python, "-m", "venv", str(self.folder)])
        upgrade = ["--upgrade", "--upgrade-strategy", "eager"] if self.newest else []
        target = f"{ROOT}[{','.join(self.extras)}]" if self.extras else str(ROOT)
        run([*self.pip, "install", "--quiet", *upgrade, "-c", str(constraints), "-e", target])
        stamp.write_text(digest)

    @property
    def pip(self) -> list[str]:
        return [str(self.interpreter), "-m", "pip", "--disable-pip-version-check"]

    def versions(self, *names: str) -> str:
        """Installed versions of some packages, for the table."""
        code = "import sys; from importlib.metadata import version; print(*(f'{n} {version(n)}' for n in sys.argv[1:]))"
        return run([str(self.interpreter), "-P", "-c", code, *names]).stdout.strip()


class TrialError(Exception):
    """A command that ended with another exit code than it should."""


def run(
    command: Sequence[str], *, codes: Sequence[int] = (0,), environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command in the root of the repository.

    Raises:
        TrialError: It ended with a code that is not in `codes`; the message ends with what it printed last.
    """
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode not in codes:
        printed = "\n".join((done.stdout + done.stderr).splitlines()[-40:])
        raise TrialError(f"{' '.join(command)}\nended with {done.returncode}, expected {codes}\n{printed}")
    return done


def declarations() -> str:
    """What an environment is a function of."""
    return (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def lowest_versions() -> tuple[str, ...]:
    """``name==bound`` for every declared dependency, but for those that `NO_LOWEST` names, and what they need."""
    project = tomllib.loads(declarations())["project"]
    declared, extras = list(project["dependencies"]), list(LOWEST_EXTRAS)
    for extra in extras:  # it grows by the extras that extras name
        for requirement in project["optional-dependencies"][extra]:
            if (of_its_own := re.fullmatch(r"branchdrive\[([\w,-]+)\]", requirement)) is not None:
                extras += of_its_own[1].split(",")
            else:
                declared.append(requirement)
    bounds = dict(re.fullmatch(r"([\w-]+)>=([\d.]+)", requirement).groups() for requirement in declared)  # type: ignore[union-attr]
    lowest = tuple(f"{name}=={bound}" for name, bound in sorted(bounds.items()) if name not in NO_LOWEST)
    return (*lowest, *OF_THEIR_TIME)


def pythons() -> dict[str, str]:
    """Interpreter of every Python of `PYTHONS` that is found and can make a virtual environment, by version."""
    found = {}
    for version in PYTHONS:
        for place in interpreters(version):
            with suppress(OSError):
                done = subprocess.run([place, "-c", _PROBE], capture_output=True, text=True)
                if done.returncode == 0:
                    found[version] = done.stdout.strip()
                    break
    return found


def interpreters(version: str) -> Iterator[str]:
    """Places to look for a Python: this one, the path, and the versions that pyenv keeps."""
    if version == f"{sys.version_info.major}.{sys.version_info.minor}":
        yield getattr(sys, "_base_executable", sys.executable)
    if (place := shutil.which(f"python{version}")) is not None:
        yield place
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    for folder in sorted((root / "versions").glob(f"{version}.*"), reverse=True):
        yield str(folder / "bin" / "python")


def pytest(interpreter: str | Path, tests: Sequence[str], jobs: int, environment: dict[str, str] | None = None) -> str:
    """Last line of a run of tests, which must pass."""
    command = [str(interpreter), "-m", "pytest", "-q", "-n", str(jobs), "--dist", "worksteal", "-p", "no:cacheprovider"]
    return run([*command, *tests], environment=environment).stdout.splitlines()[-1]


def in_environment(environment: Environment, tests: Sequence[str], jobs: int) -> str:
    """The light core's tests and, where there is one, the demo's dataset, in an environment with other versions."""
    environment.make()
    found = [environment.versions("numpy", "pyarrow", "pydantic")]
    if DEMO.is_dir():
        run([str(environment.folder / "bin" / "branchdrive-validate"), str(DEMO), "--jobs", str(jobs)])
        found.append("demo valid")
    found.append(pytest(environment.interpreter, tests, jobs))
    return ", ".join(found)


def below_the_bound(environment: Environment) -> str:
    """A library that is too old is one line and exit code 4."""
    environment.make()
    run([*environment.pip, "install", "--quiet", "--no-deps", "pyarrow==17.0.0"])
    done = run([str(environment.folder / "bin" / "branchdrive-validate"), str(ROOT)], codes=(4,))
    if done.stdout or done.stderr.count("\n") != 1 or "pyarrow>=" not in done.stderr:
        raise TrialError(f"expected one line with the bound of pyarrow, found {done.stdout!r} and {done.stderr!r}")
    return done.stderr.strip()


def as_processor(variables: dict[str, str], tests: Sequence[str], jobs: int) -> str:
    """The numeric tests under a setting of `tests/processors.py`."""
    return pytest(sys.executable, tests, jobs, variables)


def under_kernel(variables: dict[str, str]) -> str:
    """All rules on a synthetic release with a benchmark, which is built once, as this processor calculates."""
    if not RELEASE.is_dir():
        FOLDER.mkdir(parents=True, exist_ok=True)
        build = "import sys; from tests.validator.engine.rules.benchmark_release import BenchmarkDraft as Draft; "
        run([sys.executable, "-c", f"{build}Draft().write(__import__('pathlib').Path(sys.argv[1]))", str(RELEASE)])
    printed = run([str(Path(sys.executable).with_name("branchdrive-validate")), str(RELEASE)], environment=variables)
    return printed.stdout.splitlines()[-1]


def tried(what: str, action: Callable[[], str], console: Console) -> Outcome:
    """The outcome of one trial; a failure is printed at once and the others go on."""
    started = time.monotonic()
    with console.status(f"{what} ..."):
        try:
            found, is_good = action(), True
        except TrialError as error:
            found, is_good = "failed, see above", False
            console.print(f"[bold red]{what}[/]", highlight=False)
            console.print(str(error), markup=False, highlight=False)
    seconds = time.monotonic() - started
    console.print(f"{'ok    ' if is_good else 'failed'} {what} ({seconds:.0f} s)", markup=False, highlight=False)
    return Outcome(what, found, seconds, is_good)


def trials(*, quick: bool, jobs: int) -> Iterator[tuple[str, Callable[[], str]]]:
    """All that is tried, in order."""
    found = pythons()
    tests = QUICK_CORE_TESTS if quick else (*CORE_TESTS, *EXTRA_TESTS)
    for first in [version for version in LOWEST_PYTHONS if version in found][:1]:
        name, extras = ("lowest-core", QUICK_EXTRAS) if quick else ("lowest", LOWEST_EXTRAS)
        lowest = Environment(f"{name}-{first}", found[first], extras, lowest_versions())
        yield f"lowest versions, Python {first}", partial(in_environment, lowest, tests, jobs)
        if not quick:
            below = Environment(f"below-{first}", found[first], (), ())
            yield "pyarrow below its bound", partial(below_the_bound, below)
    if not quick:
        for version, python in found.items():
            newest = Environment(f"newest-{version}", python, ("test",), (), newest=True)
            yield f"newest versions, Python {version}", partial(in_environment, newest, CORE_TESTS, jobs)
        for kernel in blas_kernels():
            yield f"kernel: {kernel.name}", partial(under_kernel, kernel.environment())
    numeric = QUICK_NUMERIC_TESTS if quick else NUMERIC_TESTS
    for setting in SETTINGS[-1:] if quick else SETTINGS:
        if can_run(setting):
            yield f"processor: {setting.name}", partial(as_processor, setting.environment(), numeric, jobs)


def main() -> int:
    """Try everything and print a table; 1 where anything failed."""
    parser = argparse.ArgumentParser(prog="make compat", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--quick", action="store_true", help="the part that continuous integration runs")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes of each run of tests (default: 2)")
    args = parser.parse_args()
    console = Console(stderr=True, soft_wrap=True)
    found = pythons()
    missing = [f"Python {version}" for version in PYTHONS if version not in found]
    if not set(LOWEST_PYTHONS) & set(found):
        missing.append(f"the lowest versions, which need Python {' or '.join(LOWEST_PYTHONS)}")
    shutil.rmtree(RELEASE, ignore_errors=True)
    outcomes = [tried(what, action, console) for what, action in trials(quick=args.quick, jobs=args.jobs)]
    table = Table(title="compatibility", title_justify="left")
    for heading in ("tried", "outcome", "found"):
        table.add_column(heading, overflow="fold")
    table.add_column("seconds", justify="right")
    for outcome in outcomes:
        word = "ok" if outcome.is_good else "failed"
        table.add_row(outcome.what, word, outcome.found, f"{outcome.seconds:.0f}")
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    if missing:
        sys.stdout.write(f"not tried here: {', '.join(missing)}\n")
    return 0 if all(outcome.is_good for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
