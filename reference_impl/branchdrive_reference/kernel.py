"""The one door to numba: compiled functions on flat arrays.

Kernels are ordinary scalar Python, compiled at their first call and cached on disk. Fast-math stays off, so that
no operation is reordered or fused and equal inputs give equal bits in every process.

numba decides by the file of a kernel alone whether its cached machine code is still good, but the code of
kernels from other files is compiled into it. So the cache is emptied whenever any source of the package
differs from the sources it was filled from; otherwise an edited or upgraded package could go on
simulating with old code.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

__all__ = ["Records", "are_kernels_cached", "drop_stale_kernels", "kernel"]

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

Records = Any
"""A structured array or one of its rows; its fields are declared by the dtype that the docstring names."""

_STAMP = Path("__pycache__", "kernel-sources.sha256")
_CACHED = ("*.nbi", "*.nbc")


def _load_numba() -> Any:
    """Load numba without the current folder: no file of a dataset may configure it, name its cache or break its import.

    It reads ``.numba_config.yaml`` when it is loaded and whenever it compiles, and unpickles cached kernels from a
    folder that this file may name; without a reader of YAML it does not look for one.
    """
    reader = sys.modules.get("yaml")
    sys.modules["yaml"] = None  # type: ignore[assignment]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a file that is there and cannot be read
            from numba.core import config
    finally:
        del sys.modules["yaml"]
        if reader is not None:
            sys.modules["yaml"] = reader
    config._config_fname = os.devnull  # numba may be loaded already
    config.reload_config()  # type: ignore[no-untyped-call]
    return importlib.import_module("numba")


numba = _load_numba()


def _digest(package_dir: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(package_dir.rglob("*.py")):
        digest.update(path.relative_to(package_dir).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def drop_stale_kernels(package_dir: Path) -> bool:
    """Remove cached kernels below `package_dir` that were compiled from other sources; whether there was a reason to.

    Where the folder cannot be written, numba keeps its cache elsewhere and nothing is done.
    """
    stamp, digest = package_dir / _STAMP, _digest(package_dir)
    with suppress(OSError):
        if stamp.read_text(encoding="ascii") == digest:
            return False
    with suppress(OSError):
        for pattern in _CACHED:
            for path in package_dir.rglob(pattern):
                path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest, encoding="ascii")
    return True


drop_stale_kernels(Path(__file__).resolve().parent)

_cache_folders: set[Path] = set()


def kernel(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Compile `function`, keeping its type."""
    compiled = numba.njit(cache=True, fastmath=False)(function)
    if (folder := compiled.stats.cache_path) is not None:
        _cache_folders.add(Path(folder))
    return cast("Callable[_Parameters, _Result]", compiled)


def are_kernels_cached() -> bool:
    """Whether machine code of the kernels that are declared so far was kept by an earlier process."""
    return any(next(folder.glob("*.nbi"), None) is not None for folder in _cache_folders)
