"""Every rule has a page that says what, why, by which clause, with an example, and what to do."""

from __future__ import annotations

import json

from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.contract.generate.page import AREAS_FILE, EXAMPLES_FILE
from branchdrive.contract.resources import rule_page
from branchdrive.contract.rule import AREAS, CATALOGUE, RuleInfo

PAGES = ROOT / "docs" / "rules"


def test_there_is_a_page_for_every_rule_and_no_other() -> None:
    assert {path.stem for path in PAGES.glob("*.md")} == {*CATALOGUE, "README"}


@each("info", CATALOGUE.values(), ids=lambda info: info.id)
def test_a_page_has_all_its_parts(info: RuleInfo) -> None:
    page = (PAGES / f"{info.id}.md").read_text("utf-8")
    headings = [line for line in page.splitlines() if line.startswith("#")]
    parts = ["## Why", "## Clauses", "## An example", "## What to do"]
    assert headings == [f"# {info.id}: {info.title}", *parts]
    assert f"](../../{info.clause})" in page
    assert info.remedy in page
    assert page.count("\n- [") >= 1
    assert rule_page(info.id) == page


def test_the_index_leads_to_every_page() -> None:
    index = (PAGES / "README.md").read_text("utf-8")
    assert all(f"[{rule}]({rule}.md)" in index for rule in CATALOGUE)


def test_reasons_and_examples_are_those_of_areas_and_rules() -> None:
    reasons = json.loads((ROOT / AREAS_FILE).read_text("utf-8"))
    assert list(reasons)[: len(AREAS)] == list(AREAS)
    of_rules = list(reasons)[len(AREAS) :]
    assert set(of_rules) <= set(CATALOGUE)
    for rule in of_rules:
        assert reasons[rule] in rule_page(rule) and reasons[rule[3:6]] not in rule_page(rule)
    assert list(json.loads((ROOT / EXAMPLES_FILE).read_text("utf-8"))) == list(CATALOGUE)
