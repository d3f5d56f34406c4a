"""What this installation is: its code, its schemas, and the libraries that it computes with, as one digest.

Two results are of one tool where their digests are equal, whatever version the distribution says that it has.
"""

from __future__ import annotations

import hashlib
import json
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from branchdrive.contract.resources import schema_dir
from branchdrive.runtime.environment import requirements

__all__ = ["installation_digest", "library_versions", "own_version", "package_digest"]

_PACKAGE_DIR = Path(__file__).resolve().parents[1]


@cache
def own_version() -> str:
    """Version of the distribution; ``unknown`` where it runs from sources that are not installed."""
    return _version("branchdrive") or "unknown"


def installation_digest(*packages: str) -> str:
    """SHA-256 of all that a result depends on beside its input, hexadecimal.

    Args:
        packages: Other packages whose code counts; they need not be installed.
    """
    about = {"code": package_digest(), "libraries": library_versions()}
    about |= {name: _digest_of(_folders(name)) for name in packages}
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()


@cache
def package_digest() -> str:
    """SHA-256 of every file of this package and of the schemas, hexadecimal."""
    return _digest_of((_PACKAGE_DIR, schema_dir()))


def _folders(package: str) -> tuple[Path, ...]:
    """Where a package is; nowhere if it is not installed."""
    spec = find_spec(package)
    return tuple(map(Path, (spec and spec.submodule_search_locations) or ()))


@cache
def _digest_of(folders: tuple[Path, ...]) -> str:
    """SHA-256 of every file in some folders, hexadecimal."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix != ".pyc" and path.is_file():
                name = path.relative_to(folder).as_posix()
                digest.update(f"{name}\0{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


@cache
def library_versions() -> dict[str, str | None]:
    """Versions of Python and of every library that the distribution or an extra names; ``None`` if not installed.

    Libraries of extras are among them, because which of them are there decides what decodes images.
    """
    python = f"{platform.python_implementation()} {platform.python_version()} {platform.machine()}"
    return {"python": python, **{one.name: _version(one.name) for one in requirements()}}


def _version(distribution: str) -> str | None:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
