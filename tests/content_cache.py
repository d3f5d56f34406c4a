"""Expensive fixtures, built once a checkout: by workers of one run, and by runs one after another.

An entry lies in a folder of ``build/test-cache`` that is named by a digest of everything it can depend on: the
sources of packages, schemas and tests, the interpreter, the installed distributions, and settings of numerical
libraries. It is built under a lock, written aside and renamed, so that nobody reads a part of it.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from importlib.metadata import distributions
from inspect import isgeneratorfunction
from pathlib import Path
from typing import Any, TypeVar

__all__ = ["kept", "kept_folder", "remembered"]

Value = TypeVar("Value")

ROOT = Path(__file__).resolve().parents[1]
STORE = ROOT / "build/test-cache"
SOURCES = ("schemas", "validator", "reference_impl", "tests")
SUFFIXES = (".py", ".json", ".md")
SETTINGS = ("ARROW_", "ATEN_", "BLIS_", "GLIBC_", "MKL_", "NPY_", "NUMBA_", "OMP_", "ONEDNN_", "OPENBLAS_")
"""Beginnings of environment variables that choose kernels."""

MAX_KEPT = 8
"""Folders of the store; the least recently used go first."""


@cache
def _digest() -> str:
    digest = hashlib.sha256()
    paths = (p for folder in SOURCES for p in (ROOT / folder).rglob("*") if p.suffix in SUFFIXES and p.is_file())
    for path in sorted(paths):
        digest.update(f"{path.relative_to(ROOT)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    installed = sorted(f"{found.name} {found.version}" for found in distributions())
    settings = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(SETTINGS))
    digest.update(repr((sys.version, platform.platform(), platform.node(), installed, settings)).encode())
    return digest.hexdigest()


@cache
def _folder() -> Path:
    """Folder of the entries that are good now; folders that nobody used for long are removed."""
    folder = STORE / _digest()[:32]
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    ages = sorted((path for path in STORE.iterdir() if path.is_dir()), key=lambda p: p.stat().st_mtime, reverse=True)
    for old in ages[MAX_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


@contextmanager
def _built(entry: Path, write: Callable[[Path], object]) -> Iterator[Path]:
    """The path of an entry, which `write` makes where it is missing."""
    if not entry.exists():
        with entry.with_name(f"{entry.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not entry.exists():
                with tempfile.TemporaryDirectory(dir=entry.parent, prefix="unfinished-") as aside:
                    made = Path(aside) / entry.name
                    write(made)
                    made.rename(entry)
    yield entry


def kept(name: str, build: Callable[[], Value]) -> Value:
    """What `build` returns; a value of its own in every process."""

    def write(path: Path) -> None:
        path.write_bytes(pickle.dumps(build(), protocol=pickle.HIGHEST_PROTOCOL))

    with _built(_folder() / f"{name}.pickle", write) as path:
        value: Value = pickle.loads(path.read_bytes())
    return value


def kept_folder(name: str, build: Callable[[Path], object], copy: Path) -> Path:
    """The new folder `copy` with what `build` writes into the new folder that it is given; `copy`."""
    with _built(_folder() / name, build) as path:
        shutil.copytree(path, copy)
    return copy


@cache
def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, whose results are kept by the content of its arguments; each caller gets a copy.

    What a generator yields comes as a list.
    """
    known: dict[bytes, bytes] = {}

    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        key = hashlib.sha256(pickle.dumps((arguments, options))).digest()
        if key not in known:
            result = function(*arguments, **options)
            known[key] = pickle.dumps(list(result) if isgeneratorfunction(function) else result)
        return pickle.loads(known[key])

    return call
