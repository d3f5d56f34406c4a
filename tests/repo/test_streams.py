"""Streams of random words are those of chapter 15, and each is named in one place."""

from __future__ import annotations

import ast
import re
from collections import Counter

from tests.repo.checkout import ROOT

NAME = re.compile(r"(fidelity|leakage|metric|guard|model|split)(/[a-z-]+)+/?")
NOT_DRAWN_AGAIN = {"leakage/training"}
"""Seeds of recurrent tests, which no validator repeats."""


def test_the_chapter_lists_the_streams_that_are_named_in_the_source() -> None:
    chapter = (ROOT / "spec/15-random-words.md").read_text().split('<a id="streams">')[1].split("<a id=")[0]
    listed = {re.sub("(PARTITION|GROUP)$", "", name) for name in re.findall(r"^\| `([^`]+)`", chapter, re.MULTILINE)}
    sources = [path.read_text() for path in (ROOT / "validator/branchdrive").rglob("*.py")]
    trees = [ast.parse(source) for source in sources if NAME.search(source)]
    texts = [node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    named = Counter(text for text in texts if isinstance(text, str) and NAME.fullmatch(text))
    assert named == Counter(listed | NOT_DRAWN_AGAIN)
