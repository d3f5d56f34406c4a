"""Examples in docstrings say what comes out."""

from __future__ import annotations

import doctest
from importlib import import_module
from pathlib import Path

import pytest
from tests.repo.checkout import ROOT, files

_SOURCES = (ROOT / "validator", ROOT / "reference_impl", ROOT / "conformance_tests", ROOT)
"""Folders that modules are found in, the innermost first."""


def _module(path: Path) -> str:
    """Name of the module in a file."""
    source = next(folder for folder in _SOURCES if path.is_relative_to(folder))
    return ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__")


def _with_examples() -> list[str]:
    packages = [path for path in files(".py") if not path.is_relative_to(ROOT / "tests")]
    found = [_module(path) for path in packages if ">>> " in path.read_text("utf-8")]
    assert "branchdrive.contract.layout" in found
    return found


@pytest.mark.parametrize("name", _with_examples())
def test_examples_come_to_what_they_show(name: str) -> None:
    if name.startswith("branchdrive_reference.learning."):
        pytest.importorskip("torch")
    failed, attempted = doctest.testmod(import_module(name))
    assert attempted and not failed
