"""One fit on several processors: the kernels of BLAS and numpy decide no figure of the guard."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy._core._multiarray_umath as umath
import pytest
from tests.validator.derive.guard.banks import banks

from branchdrive.derive.utility import fit_scale

pytest.importorskip("cvxpy")
module = pytest.importorskip("branchdrive_reference.guard.fit")

TRAINING = banks(40, seed=5)
SCALE = fit_scale(TRAINING.outcomes)
ROOT = Path(__file__).resolve().parents[3]
THERE = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__[name]]
WIDE = [name for name in THERE if "AVX512" in name or name == "X86_V4"]
PROCESSORS = {"Nehalem": THERE, "Haswell": WIDE} | ({"SkylakeX": []} if WIDE else {})
"""Kernels of OpenBLAS, each with the features of numpy that such a processor does not have."""


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


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="kernels of x86-64 are compared")
def test_every_processor_fits_the_same_risk() -> None:
    expected = numbers(hard_fit())
    for kernel, lacking in PROCESSORS.items():
        variables = {
            "OPENBLAS_CORETYPE": kernel,
            "NPY_DISABLE_CPU_FEATURES": " ".join(lacking),
            "PYTHONPATH": str(ROOT),
        }
        ran = subprocess.run(
            [sys.executable, "-W", "error", "-m", "tests.reference_impl.guard.test_processor"],
            env=os.environ | variables, cwd=ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert not ran.returncode, f"{kernel}: {ran.stderr}"
        np.testing.assert_allclose(numbers(json.loads(ran.stdout)), expected, rtol=1e-9, atol=1e-9, err_msg=kernel)


if __name__ == "__main__":
    json.dump(hard_fit(), sys.stdout)
