"""Files that travel with the package, found in an installed wheel or in a checkout: `schemas/`, pages of rules.

And where the repository's files are on the web, as far as the distribution says so.
"""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any

from branchdrive.errors import BranchDriveError

__all__ = ["SPEC_VERSION", "load_resource", "project_url", "rule_page", "rule_page_text", "schema_dir"]

SPEC_VERSION = "0.1"
"""Version of the dataset specification that this library implements."""

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


@cache
def project_url() -> str:
    """Where the files of the repository are found under their paths: `Homepage` of the distribution's metadata.

    Empty where they name none; links are then left out.
    """
    try:
        declared = metadata("branchdrive").get_all("Project-URL") or []
    except PackageNotFoundError:
        return ""
    return next((line.split(", ", 1)[1].rstrip("/") for line in declared if line.startswith("Homepage, ")), "")


def rule_page(rule_id: str) -> str:
    """The page of a rule, Markdown: what it demands and why, an example, what to do.

    Raises:
        BranchDriveError: The installation lacks the page.
    """
    installed = _PACKAGE_DIR / "_rules"
    checkout = _PACKAGE_DIR.parents[1] / "docs" / "rules"
    for folder in (installed, checkout):
        page = folder / f"{rule_id}.md"
        if page.is_file():
            return page.read_text(encoding="utf-8")
    raise BranchDriveError(f"no page of {rule_id} in {installed} or {checkout}; reinstall `branchdrive`")


def rule_page_text(rule_id: str) -> str:
    """What the page of a rule says below its table of facts, without targets of links into the repository.

    Raises:
        BranchDriveError: The installation lacks the page.
    """
    page = rule_page(rule_id)
    sections = page[page.index("## ") : page.index("<!-- end")]
    return re.sub(r"\[([^\[\]]+)\]\([^)]+\)", r"\1", sections)
