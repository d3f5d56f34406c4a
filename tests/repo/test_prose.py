"""Texts of the repository: links, anchors, key words, tags, sentences, decision records."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from tests.each import each
from tests.repo.checkout import CHAPTERS, ROOT, anchors, files, heading_slugs, name, prose

MARKDOWN = files(".md")
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("*.md"))
KEY_WORD = re.compile(r"\b(MUST|SHALL|SHOULD|MAY|REQUIRED|RECOMMENDED|OPTIONAL)\b")
TAG = re.compile(r" \[[PVIC](/[PVIC])*( \d+-\d+(: [^]]+)?)?\]$")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")

each_chapter = each("path", CHAPTERS, ids=name)


def targets(path: Path) -> list[str]:
    text = re.sub(r"^```.*?^```", "", path.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [target for target in LINK.findall(text) if not re.match(r"[a-z]+:", target)]


@each("path", MARKDOWN, ids=name)
def test_relative_links_resolve(path: Path) -> None:
    for target in targets(path):
        file, _, anchor = target.partition("#")
        there = (path.parent / file).resolve() if file else path
        assert there.is_relative_to(ROOT), target
        assert there.exists(), target
        if anchor:
            assert anchor in {*anchors(there), *heading_slugs(there)}, target


@each("path", MARKDOWN, ids=name)
def test_anchors_are_unique(path: Path) -> None:
    assert [anchor for anchor, count in Counter(anchors(path)).items() if count > 1] == []


@each_chapter
def test_every_clause_has_an_anchor(path: Path) -> None:
    lines = path.read_text("utf-8").split("\n")
    for number, line in enumerate(lines):
        if line.startswith("## "):
            assert lines[number - 1].startswith('<a id="'), line


@each_chapter
def test_every_requirement_says_where_it_comes_from(path: Path) -> None:
    for number, line in prose(path):
        if KEY_WORD.search(line):
            assert TAG.search(line), f"{name(path)}:{number}"


@each_chapter
def test_one_sentence_per_line(path: Path) -> None:
    for number, line in prose(path):
        text = re.sub(r"`[^`]*`", "x", TAG.sub("", line))
        assert not re.search(r"[.?!]\s+\S", text), f"{name(path)}:{number}"


@each("path", [p for p in MARKDOWN if p.parent.name != "spec"], ids=name)
def test_key_words_stand_in_the_specification_only(path: Path) -> None:
    found = [f"{name(path)}:{number}" for number, line in prose(path) if KEY_WORD.search(line)]
    assert found == []


def test_chapters_are_numbered_and_listed() -> None:
    assert [path.name[:2] for path in CHAPTERS] == [f"{i:02d}" for i in range(1, len(CHAPTERS) + 1)]
    assert {path.name for path in CHAPTERS} <= set(targets(ROOT / "spec" / "README.md"))


def test_decisions_are_numbered_without_gaps_and_listed() -> None:
    assert [path.name[:5] for path in DECISIONS] == [f"{i:04d}-" for i in range(1, len(DECISIONS) + 1)]
    assert {f"decisions/{path.name}" for path in DECISIONS} == {
        target for target in targets(ROOT / "docs" / "README.md") if target.startswith("decisions/")
    }


@each("path", DECISIONS, ids=name)
def test_decision_has_its_parts_and_fits_one_page(path: Path) -> None:
    text = path.read_text("utf-8")
    headings = [line[3:] for line in text.split("\n") if line.startswith("## ")]
    assert [h for h in headings if h != "Numbers"] == ["Context", "Decision", "Consequences"]
    assert text.startswith(f"# {path.name[:4]} ")
    assert text.count("\n") <= 70
