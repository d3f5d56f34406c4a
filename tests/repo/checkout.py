"""The checkout as tests about the repository see it: files by kind, anchors of chapters, prose of a text."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branchdrive.contract.resources import load_resource

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]

_FOLDERS = ("spec", "schemas", "docs", "validator", "reference_impl", "conformance_tests", "benchmarks", "tests")
_TEXT_SUFFIXES = {".md", ".py", ".json", ".toml", ".yaml", ".yml", ".txt", ".cfg", ".ini", ""}
_FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
_GENERATED = re.compile(r"<!-- generated: .*?<!-- end generated -->", re.DOTALL)


@cache
def _every_file() -> list[Path]:
    """Files of the repository in order, caches and hidden folders left out."""
    top = [path for path in ROOT.iterdir() if path.is_file() and not path.name.startswith(".")]
    below = (path for folder in _FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file())
    hidden = (".", "__pycache__")
    plain = [p for p in below if not any(part.startswith(hidden) for part in p.relative_to(ROOT).parts)]
    return sorted([*top, *plain])


def files(*suffixes: str) -> list[Path]:
    """Files of the repository with one of the suffixes, as they were when they were first asked for."""
    return [path for path in _every_file() if path.suffix in suffixes]


def texts() -> list[Path]:
    """Every text file of the repository."""
    return files(*_TEXT_SUFFIXES)


def name(path: Path) -> str:
    """Path relative to the checkout, for test ids and messages."""
    return path.relative_to(ROOT).as_posix()


@cache
def anchors(path: Path) -> tuple[str, ...]:
    """Explicit anchors of a Markdown file, in order, repeated ones included."""
    return tuple(re.findall(r'<a id="([^"]*)"></a>', path.read_text(encoding="utf-8")))


@cache
def heading_slugs(path: Path) -> frozenset[str]:
    """Anchors that Markdown renderers derive from headings."""
    text = _FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return frozenset(re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings)


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines of hand-written prose: no code blocks, no generated regions, no tables."""

    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    text = _FENCE.sub(blank, _GENERATED.sub(blank, path.read_text(encoding="utf-8")))
    for number, line in enumerate(text.split("\n"), start=1):
        if line.strip() and not line.startswith("|"):
            yield number, line


CHAPTERS = sorted(path for path in (ROOT / "spec").glob("*.md") if path.name[0].isdigit())
"""Chapters of the specification."""

RULES: list[dict[str, Any]] = load_resource("rules.json")["rules"]
"""Entries of the rule catalogue."""
