"""What the distribution needs of a machine, and what it leaves out.

It needs system calls, and libraries within the bounds that its metadata declare.

A lack is the environment's fault: one line that says what to do, and never a finding about data.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.metadata import PackageNotFoundError, distribution, requires, version
from importlib.util import find_spec
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

from branchdrive.errors import PlatformError

__all__ = [
    "MODULES", "Requirement", "check_environment", "check_libraries", "extra", "folder_command", "import_fault",
    "install_command", "leave_out_pandas", "requirements",
]  # fmt: skip

_DISTRIBUTION = "branchdrive"
_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)>=(?P<bound>[\d.]+)(?:; extra == ['\"](?P<extra>\w+)['\"])?")
_VERSION = re.compile(
    r"(?P<epoch>[1-9]\d*!)?(?:0!)?(?P<release>\d+(?:\.\d+)*)[-_.]?(?P<early>a|b|c|rc|alpha|beta|pre|dev)?"
)
"""Epoch, release numbers, and what makes a version an early one of its release."""

MODULES = {
    "commonroad-vehicle-models": "vehiclemodels", "mkdocstrings-python": "mkdocstrings_handlers",
    "opencv-python-headless": "cv2", "pillow": "PIL", "rerun-sdk": "rerun", "scikit-learn": "sklearn",
}  # fmt: skip
"""Module of a distribution whose name tells nothing about it."""


class Requirement(NamedTuple):
    """A library that the core (`extra` is empty) or an extra needs, and its lowest version."""

    name: str
    bound: str
    extra: str


@cache
def requirements() -> tuple[Requirement, ...]:
    """What the metadata of the distribution declare; nothing where it runs from sources that are not installed."""
    try:
        lines = requires(_DISTRIBUTION) or []
    except PackageNotFoundError:
        return ()
    found = map(_REQUIREMENT.fullmatch, lines)
    return tuple(Requirement(one["name"], one["bound"], one["extra"] or "") for one in found if one)


@cache
def check_environment() -> None:
    """Make sure of the system calls and of the core's libraries; the first success is remembered.

    Raises:
        PlatformError: A call is missing, or a library is older than declared.
    """
    lacking = _lacking_calls()
    if lacking:
        raise PlatformError(
            f"branchdrive needs a POSIX system; {sys.platform} lacks {', '.join(lacking)}: "
            "use Linux or macOS, or WSL on Windows"
        )
    check_libraries("")


def leave_out_pandas() -> None:
    """Keep pyarrow from loading pandas, as it does at the first conversion of a process wherever pandas is installed.

    That takes a third of a second, and memory that a worker may need, for data frames that nothing here uses. For
    processes that run no code of others: some libraries (torch) fail where even a search for pandas does.
    """
    sys.meta_path.insert(0, _NoPandas())


class _NoPandas(MetaPathFinder):
    """A finder by which pandas is not installed."""

    def find_spec(self, name: str, *_: object) -> None:
        if name == "pandas":
            raise ModuleNotFoundError("pandas is left out", name=name)


def _lacking_calls() -> list[str]:
    """System calls that safe reading, durable writing and workers rest on and that this platform lacks."""
    names = ("O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "geteuid", "register_at_fork")
    lacking = [f"os.{name}" for name in names if not hasattr(os, name)]
    lacking += ["os.open(dir_fd=...)"] if os.open not in os.supports_dir_fd else []
    lacking += ["os.listdir(fd)"] if os.listdir not in os.supports_fd else []
    lacking += ["signal.pthread_sigmask"] if not hasattr(signal, "pthread_sigmask") else []
    return lacking + ([] if find_spec("fcntl") else ["fcntl"])


def check_libraries(*extras: str) -> None:
    """Compare installed libraries with their lowest versions; one that is not installed is left to its import.

    Args:
        extras: Extras whose libraries are looked at; the empty name is the core.

    Raises:
        PlatformError: Some are older.
    """
    old = []
    for one in requirements():
        if one.extra in extras:
            found = _installed(one.name)
            if found is not None and _is_older(found, one.bound):
                old.append((one, found))
    if old:
        needed = ", ".join(f"{one.name}>={one.bound}, found {found}" for one, found in old)
        install = " ".join(f"'{one.name}>={one.bound}'" for one, _ in old)
        raise PlatformError(f"branchdrive needs {needed}; run: pip install {install}")


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _is_older(found: str, bound: str) -> bool:
    """Whether a version comes before another; one without numbers, of a build from sources say, is not judged."""
    parts, least = _VERSION.match(found), _VERSION.match(bound)
    if parts is None or least is None:
        return False
    mine, its = (_numbers(version["release"]) for version in (parts, least))
    is_early = mine == its and parts["early"] is not None
    return parts["epoch"] is None and (mine < its or is_early)


def _numbers(release: str) -> list[int]:
    """Numbers of a release without zeros at the end, which change nothing."""
    numbers = [int(number) for number in release.split(".")]
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return numbers


@contextmanager
def extra(*names: str, of: str, otherwise: str = "") -> Iterator[None]:
    """Import what extras bring.

    Args:
        names: The extras.
        of: What needs them, as messages name it.
        otherwise: How to go without them.

    Raises:
        PlatformError: A library of theirs is too old, missing, or cannot be imported.
    """
    check_libraries(*names)
    try:
        yield
    except ImportError as error:
        raise import_fault(error, of, *names, otherwise=otherwise) from error


def import_fault(error: ImportError, of: str, *extras: str, otherwise: str = "") -> PlatformError:
    """What to do about an import that failed: install what is missing, or look at what is broken.

    Args:
        error: The failure.
        of: What needed the import.
        extras: Extras to install; by default those that bring the missing package.
        otherwise: How to go without them.
    """
    package = (error.name or "").partition(".")[0]
    matching = [one for one in requirements() if _same_name(one.name, package)]
    if not isinstance(error, ModuleNotFoundError) or error.name != package or not matching:
        place = f" (found at {error.path})" if error.path else ""
        return PlatformError(f"{of} cannot be loaded: {error}{place}; reinstall the package that this belongs to")
    wanted = extras or tuple(dict.fromkeys(one.extra for one in matching if one.extra))[:1]
    install = install_command(*wanted) if wanted else f"pip install '{matching[0].name}>={matching[0].bound}'"
    return PlatformError(
        f"{of} needs the package {matching[0].name!r}: {install}" + (f", or {otherwise}" if otherwise else "")
    )


def install_command(*extras: str) -> str:
    """The command that installs extras from where this distribution came from: an index, a folder, an archive.

    Installers record the place (the direct URL of PEP 610); one that came from an index has its name alone.
    """
    wanted = f"[{','.join(extras)}]" if extras else ""
    url = _origin()
    if url.startswith("file:") and not url.endswith((".whl", ".gz", ".zip")):
        return f"pip install {shlex.quote(unquote(urlsplit(url).path) + wanted)}"
    return f"pip install {shlex.quote(_DISTRIBUTION + wanted + (f' @ {url}' if url else ''))}"


def folder_command(name: str, folder: str) -> str:
    """The command that installs another distribution from where this one came from; a wheel's stands beside it.

    Args:
        name: The distribution.
        folder: Where its `pyproject.toml` is in the source of this one.
    """
    url = _origin()
    if url.endswith(".whl"):
        place, _, wheel = url.rpartition("/")
        url = f"{place}/{name.replace('-', '_')}-{wheel.partition('-')[2]}"
    elif url.startswith("file:") and not url.endswith((".gz", ".zip")):
        return f"pip install {shlex.quote(unquote(urlsplit(url).path) + f'/{folder}')}"
    elif url:
        url += f"#subdirectory={folder}"
    return f"pip install {shlex.quote(name + (f' @ {url}' if url else ''))}"


@cache
def _origin() -> str:
    """URL that the distribution was installed from; empty where it came from an index or is not installed."""
    try:
        recorded = distribution(_DISTRIBUTION).read_text("direct_url.json")
    except PackageNotFoundError:
        return ""
    place = json.loads(recorded) if recorded else {}
    vcs = place.get("vcs_info")
    return f"{vcs['vcs']}+{place['url']}@{vcs['commit_id']}" if vcs else str(place.get("url", ""))


def _same_name(name: str, package: str) -> bool:
    return MODULES.get(name, name.lower().replace("-", "_")).lower() == package.lower()
