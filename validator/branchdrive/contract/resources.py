"""The normative files of `schemas/`, found in an installed wheel or in a checkout."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from branchdrive.errors import BranchDriveError

__all__ = ["PROJECT_URL", "SPEC_VERSION", "load_resource", "schema_dir"]

SPEC_VERSION = "0.1"
"""Version of the dataset specification that this library implements."""

PROJECT_URL = "https://branchdrive.org"
"""Where the files of the repository are found under their paths; `[project.urls]` of pyproject.toml says the same."""

_PACKAGE_DIR = Path(__file__).resolve().parents[1]


@cache
def schema_dir() -> Path:
    """Folder of the normative files of `SPEC_VERSION`.

    A wheel carries them as package data; an editable install reads the checkout, so that the
    files which are edited are the files which are used.

    Raises:
        BranchDriveError: The installation lacks the files.
    """
    checkout = _PACKAGE_DIR.parents[1] / "schemas"
    installed = _PACKAGE_DIR / "_schemas"
    for root in (installed, checkout):
        folder = root / f"v{SPEC_VERSION}"
        if (folder / "columns.json").is_file():
            return folder
    raise BranchDriveError(
        f"no schemas for version {SPEC_VERSION} in {installed} or {checkout}; reinstall `branchdrive`"
    )


@cache
def load_resource(name: str) -> Any:
    """Parsed JSON of the normative file `name`, shared by all callers: treat it as read-only."""
    return json.loads((schema_dir() / name).read_text(encoding="utf-8"))
