"""The ledger of clauses: every clause has a number and an entry, every rule judges a clause, numbers survive merges."""

from __future__ import annotations

import re
from typing import Any

import pytest
from tests.each import each
from tests.repo.checkout import CHAPTERS, ROOT, RULES

from branchdrive.contract.generate.clause import LEDGER, clauses_of, ledger_faults, number_clauses
from branchdrive.contract.resources import load_resource

TEXTS = {path.name: path.read_text("utf-8") for path in CHAPTERS}
STORED = (ROOT / "spec" / LEDGER).read_text("utf-8")
ENTRIES: dict[str, dict[str, Any]] = load_resource("clauses.json")["clauses"]


def test_every_clause_has_a_number() -> None:
    assert [(name, c.words) for name, text in TEXTS.items() for c in clauses_of(text) if c.number is None] == []


def test_clauses_and_entries_and_rules_name_each_other() -> None:
    assert ledger_faults(TEXTS) == []
    assert {rule for entry in ENTRIES.values() for rule in entry.get("rules", ())} == {rule["id"] for rule in RULES}


def test_tests_that_judge_clauses_exist() -> None:
    named = {path for entry in ENTRIES.values() for path in entry.get("tests", ())}
    assert [path for path in sorted(named) if not (ROOT / path).is_file()] == []


def test_entries_are_in_the_order_of_their_numbers_and_stand_once() -> None:
    text = (ROOT / "schemas" / "v0.1" / "clauses.json").read_text("utf-8")
    numbers = re.findall(r'^    "(\d+)-(\d+)"', text, re.MULTILINE)
    assert numbers == sorted(set(numbers), key=lambda number: (int(number[0]), int(number[1])))


def test_numbers_that_a_merge_lost_come_back() -> None:
    without = {name: re.sub(r"(\[[PVIC/]+) \d+-\d+\]$", r"\1]", text, flags=re.M) for name, text in TEXTS.items()}
    assert number_clauses(without, STORED) == TEXTS


def chapter(*lines: str) -> dict[str, str]:
    return {"99-trial.md": "\n".join(['<a id="place"></a>', "## 99.1 Place", *lines, ""])}


LEDGER_ROW = '| <a id="c99-4"></a>[99-4](99-trial.md#place) | A value MUST be small. |  |\n'


@each(
    ("lines", "numbered"),
    [
        pytest.param(["- A value MUST be small. [C]"], ["- A value MUST be small. [C 99-4]"], id="known words"),
        pytest.param(["- Any value MUST be small. [C]"], ["- Any value MUST be small. [C 99-4]"], id="reworded"),
        pytest.param(["- Nothing SHOULD stop. [P/C]"], ["- Nothing SHOULD stop. [P/C 99-5]"], id="new"),
        pytest.param(
            ["- A value MUST be small. [C 99-4]", "- A value MUST be small. [C]"],
            ["- A value MUST be small. [C 99-4]", "- A value MUST be small. [C 99-5]"],
            id="a number in use",
        ),
        pytest.param(["- A value MAY be small. [C]"], ["- A value MAY be small. [C]"], id="no demand"),
        pytest.param(["- A finding of level SHOULD. [C]"], ["- A finding of level SHOULD. [C]"], id="a level"),
        pytest.param(["| MUST [C] |"], ["| MUST [C] |"], id="a table"),
    ],
)
def test_clauses_get_numbers(lines: list[str], numbered: list[str]) -> None:
    assert number_clauses(chapter(*lines), LEDGER_ROW) == chapter(*numbered)


@each(
    ("line", "fault"),
    [
        pytest.param("- It MUST be. [C 99-1]\n- It MUST be. [C 99-1]", "clause 99-1 stands 2 times", id="twice"),
        pytest.param("- It MUST be. [C 1-1]", "clause 1-1 is in another chapter", id="another chapter"),
        pytest.param("- It MUST be. [C 99-1]", "clause 99-1 has no entry", id="no entry"),
    ],
)
def test_faults_are_named(line: str, fault: str) -> None:
    assert any(found.startswith(fault) for found in ledger_faults(chapter(line)))


def test_an_entry_without_its_clause_is_named() -> None:
    assert "clauses.json has 1-1, which no chapter has" in ledger_faults(chapter())


def test_a_rule_without_a_clause_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ENTRIES, "5-33", {"rules": ["BD-NEW-001"]})
    faults = ledger_faults(TEXTS)
    assert "BD-BOX-001 judges no clause" in faults
    assert "clauses.json names BD-NEW-001, which is not in rules.json" in faults
