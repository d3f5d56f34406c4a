"""Sources of the repository: length of modules, machine paths, documented public names."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from tests.each import each
from tests.repo.checkout import files, name, texts

import branchdrive

MAX_MODULE_LINES = 400
# Put together here, so that this file does not hold what it looks for.
HOMES = [f"/{folder}/" for folder in ("home", "root", "Users")] + ["C:" + r"\\Users"]


@each("path", files(".py"), ids=name)
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


def test_no_test_reads_a_clock() -> None:
    """What a test says would depend on how busy a machine is; `tests.waiting` has what ends one that hangs."""
    pattern = re.compile(r"\b(monotonic|perf_counter|process_time|thread_time|time\.time)\(")
    tests = [path for path in files(".py") if path.name.startswith("test_") and path.name != Path(__file__).name]
    assert len(tests) > 100
    assert [name(path) for path in tests if pattern.search(path.read_text("utf-8"))] == []


def written_docstring(value: Any) -> str | None:
    """The docstring that stands in the source; not one that a class inherits or a dataclass or tuple generates."""
    definition = ast.parse(textwrap.dedent(inspect.getsource(value))).body[0]
    assert isinstance(definition, ast.ClassDef | ast.FunctionDef)
    return ast.get_docstring(definition)


@dataclass(frozen=True)
class Undocumented:
    number: int


class UndocumentedPair(NamedTuple):
    number: int


@pytest.mark.parametrize("value", [Undocumented, UndocumentedPair])
def test_an_inherited_or_generated_docstring_does_not_count(value: type) -> None:
    assert inspect.getdoc(value)
    assert not written_docstring(value)


@each("public", branchdrive.__all__)
def test_public_name_is_documented(public: str) -> None:
    value = getattr(branchdrive, public)
    if inspect.isclass(value) or inspect.isroutine(value):
        assert written_docstring(value)
    else:
        prose = [path for path in files(".md") if f"`{public}`" in path.read_text("utf-8")]
        assert prose, f"{public} is no class or function; describe it in a Markdown file"


def test_public_names_are_sorted_and_unique() -> None:
    assert sorted(set(branchdrive.__all__), key=str.casefold) == sorted(branchdrive.__all__, key=str.casefold)
