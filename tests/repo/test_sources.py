"""Sources of the repository: length of modules, machine paths, documented public names."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest
from tests.repo.checkout import files, name, texts

import branchdrive

MAX_MODULE_LINES = 400
# Put together here, so that this file does not hold what it looks for.
HOMES = [f"/{folder}/" for folder in ("home", "root", "Users")] + ["C:" + r"\\Users"]


@pytest.mark.parametrize("path", files(".py"), ids=name)
def test_module_is_short(path: Path) -> None:
    assert len(path.read_text("utf-8").splitlines()) <= MAX_MODULE_LINES


def test_no_text_names_a_place_on_one_machine() -> None:
    pattern = re.compile("|".join(map(re.escape, HOMES)))
    found = [
        f"{name(path)}:{number}"
        for path in texts()
        for number, line in enumerate(path.read_text("utf-8").splitlines(), start=1)
        if pattern.search(line)
    ]
    assert found == []


@pytest.mark.parametrize("public", branchdrive.__all__)
def test_public_name_is_documented(public: str) -> None:
    value = getattr(branchdrive, public)
    if inspect.isclass(value) or inspect.isroutine(value):
        assert inspect.getdoc(value)
    else:
        prose = [path for path in files(".md") if f"`{public}`" in path.read_text("utf-8")]
        assert prose, f"{public} is no class or function; describe it in a Markdown file"


def test_public_names_are_sorted_and_unique() -> None:
    assert sorted(set(branchdrive.__all__), key=str.casefold) == sorted(branchdrive.__all__, key=str.casefold)
