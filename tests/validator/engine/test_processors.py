"""One release with a benchmark is valid on every processor, and results of ties are those of this one to 1e-9.

Each setting of `tests.processors` takes a process of its own, which validates the release and computes the results of a
benchmark on a lattice, where errors, sums, resamples, scores and losses tie in many places.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy._core._multiarray_umath as umath
import pytest
from tests.processors import SETTINGS, Setting, blas_kernels, can_run
from tests.sampling import sampled
from tests.validator.benchmark.lattice import tied
from tests.validator.benchmark.samples import noise, risk_fit
from tests.validator.engine.rules.benchmark_release import BenchmarkDraft

from branchdrive.benchmark.results import results_document
from branchdrive.contract.comparison import TOLERANCE, document_mismatches

ROOT = Path(__file__).parents[3]

_STEP = 0.5

_SLOW = "BD-LKG"
"""Rules that take most of the time; they are left out under kernels alone, which the settings have as well."""

_JUDGE = f"""
import json, sys
from tests.validator.benchmark.lattice import tied
from tests.validator.benchmark.samples import noise, risk_fit
from branchdrive.engine.validate import validate
from branchdrive.benchmark.results import results_document

results = results_document(*tied({_STEP}), risk_fit(), noise())
report = validate(sys.argv[1], ignore=sys.argv[2:])
failed = [tally.rule_id for tally in report.tallies if tally.status == "fail"]
print(json.dumps({{"verdict": report.verdict, "failed": failed, "results": results}}))
"""

_LAST_BITS = """
import numpy as np
values = np.linspace(0.0, 9.0, 200 * 200).reshape(200, 200)
print(((values @ values).tobytes() + np.exp(values).tobytes()).hex())
"""


def restricted() -> list[Setting]:
    """Every restricted setting that this processor can run."""
    return [setting for setting in SETTINGS if setting.variables and can_run(setting)]


def baseline() -> list[Setting]:
    """The most restricted of them."""
    return restricted()[-1:]


def others() -> list[Setting]:
    """The others of them."""
    return restricted()[:-1]


def kernels() -> list[Setting]:
    """Every kernel that this processor can run and no restricted setting has."""
    covered = {setting.variables["OPENBLAS_CORETYPE"] for setting in restricted()}
    return [kernel for kernel in blas_kernels() if kernel.name not in covered]


def run(setting: Setting, code: str, *arguments: str) -> str:
    environment = setting.environment() | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-P", "-c", code, *arguments]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert not ran.returncode, ran.stderr
    return ran.stdout


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return BenchmarkDraft().write(tmp_path_factory.mktemp("processors") / "dataset")


@pytest.mark.parametrize("settings", sampled([baseline, others, kernels], every=3))
def test_a_release_is_valid_and_results_are_the_same_under_every_kernel_and_setting(
    release: Path, settings: Callable[[], list[Setting]]
) -> None:
    expected = results_document(*tied(_STEP), risk_fit(), noise())
    for setting in settings():
        is_whole = setting in SETTINGS
        found: dict[str, Any] = json.loads(run(setting, _JUDGE, str(release), *([] if is_whole else [_SLOW])))
        verdict = "valid" if is_whole else "partial"
        assert (setting.name, found["verdict"]) == (setting.name, verdict), found["failed"]
        mismatches = list(document_mismatches(expected, found["results"], tolerance=TOLERANCE))
        assert (setting.name, mismatches) == (setting.name, [])


@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64") or not umath.__cpu_features__.get("FMA3"),
    reason="the settings are of x86-64 with FMA",
)
def test_settings_round_last_bits_differently() -> None:
    """Otherwise the test above would show nothing."""
    tried = [setting for setting in SETTINGS if can_run(setting)]
    assert len({run(setting, _LAST_BITS) for setting in tried}) >= min(2, len(tried))
