"""Processors that this one can play: which kernels numpy, the BLAS, libm, numba and torch use.

A setting is a set of environment variables for a *new* process; libraries read them when they are loaded. The same
program under another setting rounds its last bits as another processor would, so that whatever it decides by them
comes out differently here already::

    native    whatever the libraries choose on this processor
    avx2      AVX2 and FMA, nothing of AVX-512: most laptops and cloud machines
    baseline  SSE4.2 at most, without AVX and FMA: the oldest processors that numpy supports

`KERNELS` are what OpenBLAS can be made to use; several names may mean one kernel, and `blas_kernels` leaves one of
each that this processor can run.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy._core._multiarray_umath as umath

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["KERNELS", "SETTINGS", "Setting", "blas_kernels", "can_run", "runnable"]

KERNELS = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX", "Cooperlake", "SapphireRapids")
"""Values of `OPENBLAS_CORETYPE` on x86-64, the oldest first."""

_AVX512 = re.compile("AVX512|X86_V4|AVX10")
_PROBE = """
import numpy as np
square = np.linspace(0.0, 1.0, 64 * 64).reshape(64, 64)
assert np.isfinite(square @ square).all() and np.isfinite(np.linalg.solve(square + np.eye(64), square)).all()
assert np.isfinite(np.sin(square) + np.exp(square) + np.hypot(square, square)).all()
"""


class Setting(NamedTuple):
    """A processor to play.

    Attributes:
        name: What it is called.
        variables: Environment variables that make it so.
    """

    name: str
    variables: Mapping[str, str]

    def environment(self) -> dict[str, str]:
        """The environment of this process with the variables of the setting, and none that another setting has."""
        others = {name for setting in SETTINGS for name in setting.variables}
        kept = {name: value for name, value in os.environ.items() if name not in others}
        return kept | dict(self.variables)


def _numpy_without(which: re.Pattern[str]) -> dict[str, str]:
    """Switch off the dispatched features of a pattern that this processor has; numpy refuses any other name."""
    off = re.findall(r"\w+", os.environ.get("NPY_DISABLE_CPU_FEATURES", ""))  # has them, but not in this process
    there = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__[name] or name in off]
    named = [name for name in there if which.search(name)]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(named)} if named else {}


SETTINGS = (
    Setting("native", {}),
    Setting(
        "avx2",
        {
            **_numpy_without(_AVX512),
            "OPENBLAS_CORETYPE": "Haswell",
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F",
            "NUMBA_CPU_NAME": "haswell",
            "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+lzcnt,+movbe,+f16c,+popcnt",
            "ATEN_CPU_CAPABILITY": "avx2",
            "ONEDNN_MAX_CPU_ISA": "AVX2",
            "MKL_ENABLE_INSTRUCTIONS": "AVX2",
            "ARROW_USER_SIMD_LEVEL": "AVX2",
        },
    ),
    Setting(
        "baseline",
        {
            **_numpy_without(re.compile("")),
            "OPENBLAS_CORETYPE": "Nehalem",
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4,-AVX",
            "NUMBA_CPU_NAME": "nehalem",
            "NUMBA_CPU_FEATURES": "+sse4.2,+popcnt",
            "ATEN_CPU_CAPABILITY": "default",
            "ONEDNN_MAX_CPU_ISA": "SSE41",
            "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
            "ARROW_USER_SIMD_LEVEL": "SSE4_2",
        },
    ),
)
"""The three settings that everything is tried under, by name in `Setting.name`."""


@cache
def _kernel_of(name: str, variables: tuple[tuple[str, str], ...]) -> str | None:
    """Kernel that OpenBLAS says it uses under a setting, empty where it does not say; `None` if numpy cannot run."""
    environment = Setting(name, dict(variables)).environment() | {"OPENBLAS_VERBOSE": "2"}
    ran = subprocess.run([sys.executable, "-P", "-c", _PROBE], env=environment, capture_output=True, text=True)
    if ran.returncode:
        return None
    said = re.findall(r"^Core: (\w+)", ran.stderr + ran.stdout, re.MULTILINE)
    return said[-1] if said else ""


def can_run(setting: Setting) -> bool:
    """Whether numpy calculates under a setting on this processor, tried in a process of its own."""
    return _kernel_of(setting.name, tuple(setting.variables.items())) is not None


def runnable() -> tuple[Setting, ...]:
    """Those of `SETTINGS` that this processor can run."""
    return tuple(setting for setting in SETTINGS if can_run(setting))


@cache
def blas_kernels() -> tuple[Setting, ...]:
    """One setting for every different OpenBLAS kernel that this processor can run, named as OpenBLAS names it.

    Empty where numpy has another BLAS or OpenBLAS knows none of `KERNELS`.
    """
    found: dict[str, Setting] = {}
    for kernel in KERNELS:
        setting = Setting(kernel, {"OPENBLAS_CORETYPE": kernel})
        said = _kernel_of(setting.name, tuple(setting.variables.items()))
        if said:
            found.setdefault(said, Setting(said, setting.variables))
    return tuple(found.values())
