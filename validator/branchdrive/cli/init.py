"""`branchdrive init`: a package for a collector, which works at once around a tiny world.

Its collector is `docs/examples/minimal_collector.py` under another name; a wheel carries that file as package data.
"""

from __future__ import annotations

import argparse
import keyword
import re
import shlex
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TextIO

from branchdrive.errors import BranchDriveError, UsageError

SUMMARY = "write a package for a collector of one's own"
ORDER = 10

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_PACKAGE_DIR = Path(__file__).resolve().parents[1]
_TEXTS_DIR = Path(__file__).with_name("skeleton")

_OPEN_PLACE = "./vendor/branchdrive.whl"
"""Where the workflow looks for branchdrive unless an option says so: a file to be put there or replaced."""

_PLACES: Mapping[str, str] = {
    "pyproject.toml": "pyproject.toml.in",
    "README.md": "README.md.in",
    ".gitignore": "gitignore.in",
    ".github/workflows/validate.yml": "validate.yml.in",
    "tests/test_collector.py": "test_collector.py.in",
}
"""Texts of the skeleton by their place in the package."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("name", metavar="NAME", help="name of the package: lower case, digits and single hyphens")
    parser.add_argument("--output", metavar="FOLDER", type=Path, help="where to write it (default: ./NAME)")
    parser.add_argument(
        "--from", dest="location", metavar="LOCATION",
        help="where pip gets branchdrive from: a folder, an archive, git+https://...; nothing is published under that "
        "name, so that the package's workflow needs it (default: a place that the workflow leaves open)",
    )  # fmt: skip


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Write the package and say how to try it.

    Raises:
        UsageError: The name cannot be used, or the folder exists and is not empty.
    """
    module = args.name.replace("-", "_")
    if not _NAME.fullmatch(args.name) or len(args.name) > 64 or keyword.iskeyword(module) or module == "branchdrive":
        raise UsageError(f"name {args.name!r} cannot be used; take lower-case words with hyphens, such as my-world")
    folder: Path = args.output or Path(args.name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: is there and not empty; choose another folder with --output")
    files = skeleton(args.name, module, args.location)
    for place, text in files.items():
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    stdout.write(f"created   {folder}: {len(files)} files, of which {module}/collector.py is the one to change\n")
    if args.location is None:
        stdout.write("note      the workflow leaves open where branchdrive comes from; --from LOCATION says it\n")
    stdout.write(f"next      cd {shlex.quote(str(folder))} && pip install -e . pytest && pytest\n")
    return 0


def skeleton(name: str, module: str, location: str | None = None) -> dict[str, str]:
    """Texts of the package's files by their place in it.

    Args:
        name: Name of the package.
        module: Name of its module.
        location: Where pip gets branchdrive from; ``None`` leaves it open.
    """
    texts = {place: (_TEXTS_DIR / file).read_text(encoding="utf-8") for place, file in _PLACES.items()}
    here = f"branchdrive>={version('branchdrive')}"
    values = {
        "@name@": name,
        "@module@": module,
        "@requirement@": here if location is None else f"branchdrive @ {_url(location)}",
        "@location@": _OPEN_PLACE if location is None else f"branchdrive @ {_url(location)}",
    }
    for placeholder, value in values.items():
        texts = {place: text.replace(placeholder, value) for place, text in texts.items()}
    collector = _example().replace("python docs/examples/minimal_collector.py", f"python -m {module}.collector")
    collector = collector.replace('"minimal-collector"', f'"{name}"').replace('"minimal"', f'"{name}"')
    return {**texts, f"{module}/__init__.py": f'"""The collector {name}."""\n', f"{module}/collector.py": collector}


def _url(location: str) -> str:
    """A location as a requirement names it: a URL, of a file where it is a path."""
    return Path(location).resolve().as_uri() if Path(location).exists() else location


def _example() -> str:
    """The minimal collector, of an installed wheel or of a checkout."""
    installed = _PACKAGE_DIR / "_examples" / "minimal_collector.py"
    checkout = _PACKAGE_DIR.parents[1] / "docs" / "examples" / "minimal_collector.py"
    for path in (installed, checkout):
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise BranchDriveError(f"no minimal collector in {installed} or {checkout}; reinstall `branchdrive`")
