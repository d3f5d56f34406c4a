"""Tables as Markdown, to the byte."""

from __future__ import annotations

import pytest
from tests.validator.text.samples import TABLE

from branchdrive.text.markdown import plain, section_lines
from branchdrive.text.table import Passage


def test_a_table_reads_like_this() -> None:
    assert section_lines(TABLE, ["Look <b>out</b>."]) == [
        "## Distances",
        "",
        "> **Warning.** Look &lt;b>out&lt;/b>.",
        "",
        "| Road | By | Mean, m | Spread, m | Judged |",
        "| --- | --- | --: | --: | --- |",
        "| `town.a` | lane | 1.250 | 0.1 | pass |",
        "| `town.a` | route | -0.500 | <= 0.2 | fail, a\\|b &lt;b> |",
        "| `all` | route | 3 | - | not judged |",
        "",
        "A note on &lt;i>.",
    ]


def test_a_passage_reads_like_this() -> None:
    assert section_lines(Passage("Why", ["One.", "<Two>."])) == ["## Why", "", "One.", "", "&lt;Two>."]


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a | b", "a \\| b"), ("p < 1", "p < 1"), ("p <= 1", "p <= 1"), ("</b>", "&lt;/b>"), ("a <", "a &lt;")],
)
def test_text_opens_no_cell_and_no_tag(text: str, shown: str) -> None:
    assert plain(text) == shown
