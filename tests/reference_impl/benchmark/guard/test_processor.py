"""One fit on several processors: the kernels of BLAS and numpy decide no figure of the guard."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.processors import Setting, blas_kernels, runnable
from tests.validator.benchmark.guard.banks import banks

from branchdrive.driving.utility import fit_scale

pytest.importorskip("cvxpy")
module = pytest.importorskip("branchdrive_reference.benchmark.guard.fit")

TRAINING = banks(40, seed=5)
SCALE = fit_scale(TRAINING.outcomes)
ROOT = Path(__file__).resolve().parents[4]


def hard_fit() -> dict[str, Any]:
    """A fit of few groups with 16 features, two of them equal and one constant, and a handful of violations."""
    scalars = TRAINING.scalars.copy()
    scalars[..., 4] = scalars[..., 3]
    scalars[..., 5] = 0.1
    found = module.fit_risk(scalars, TRAINING.outcomes, nominal=0, scale=SCALE, alpha=1e-3, tolerance_m=6.0)
    return dict(found.model_dump(mode="json"))


def numbers(document: Any) -> list[float]:
    """All numbers of a document in their order."""
    if isinstance(document, dict | list):
        values = document.values() if isinstance(document, dict) else document
        return [number for value in values for number in numbers(value)]
    return [document] if isinstance(document, float) else []


def kernels() -> list[Setting]:
    """Kernels that no setting has along with other features."""
    tried = {setting.variables.get("OPENBLAS_CORETYPE") for setting in runnable()}
    return [kernel for kernel in blas_kernels() if kernel.variables["OPENBLAS_CORETYPE"] not in tried]


@pytest.mark.thorough
@pytest.mark.parametrize("settings", [runnable, kernels])
def test_every_processor_fits_the_same_risk(settings: Callable[[], Sequence[Setting]]) -> None:
    expected = numbers(hard_fit())
    for setting in (setting for setting in settings() if setting.environment() != os.environ):
        program = [sys.executable, "-W", "error", "-m", "tests.reference_impl.benchmark.guard.test_processor"]
        environment = setting.environment() | {"PYTHONPATH": str(ROOT)}
        ran = subprocess.run(program, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
        assert not ran.returncode, f"{setting.name}: {ran.stderr}"
        found = numbers(json.loads(ran.stdout))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9, err_msg=setting.name)


if __name__ == "__main__":
    json.dump(hard_fit(), sys.stdout)
