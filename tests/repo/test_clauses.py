"""The ledger of clauses: each names its judge where it stands, every rule judges one, numbers survive merges."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from tests.each import each
from tests.repo.checkout import CHAPTERS, ROOT, RULES

from branchdrive.contract.generate.clause import (
    LEDGER,
    clauses_of,
    entries_text,
    judged,
    ledger_faults,
    ledger_text,
    number_clauses,
)
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


def test_the_machine_form_says_what_the_tags_say() -> None:
    text = (ROOT / "schemas" / "v0.1" / "clauses.json").read_text("utf-8")
    assert text == entries_text(TEXTS)
    assert json.loads(text)["clauses"] == judged(TEXTS)


def test_entries_are_in_the_order_of_their_numbers_and_stand_once() -> None:
    text = entries_text(TEXTS)
    numbers = re.findall(r'^    "(\d+)-(\d+)"', text, re.MULTILINE)
    assert numbers == sorted(set(numbers), key=lambda number: (int(number[0]), int(number[1])))


def test_numbers_that_a_merge_lost_come_back() -> None:
    without = {
        name: re.sub(r"(\[[PVIC/]+) \d+-\d+(: [^]]+\])$", r"\1\2", text, flags=re.M) for name, text in TEXTS.items()
    }
    assert without != TEXTS
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
        pytest.param(["- It MUST. [C: BD-BOX-001]"], ["- It MUST. [C 99-5: BD-BOX-001]"], id="new, with its rule"),
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
    ("judge", "entry"),
    [
        ("BD-BOX-001", {"rules": ["BD-BOX-001"]}),
        ("BD-BOX-002, BD-BOX-001", {"rules": ["BD-BOX-002", "BD-BOX-001"]}),
        ("tests: tests/a.py, tests/b.py", {"tests": ["tests/a.py", "tests/b.py"]}),
        ("people: words; and plans", {"people": "words; and plans"}),
        ("BD-BOX-001; no rule: what is left", {"rules": ["BD-BOX-001"], "no rule": "what is left"}),
        ("tests: tests/a.py; not recorded: a mode", {"tests": ["tests/a.py"], "not recorded": "a mode"}),
    ],
)
def test_tags_say_what_judges(judge: str, entry: dict[str, Any]) -> None:
    assert judged(chapter(f"- It MUST be. [C 99-1: {judge}]"))["99-1"] == entry


def test_a_withdrawn_clause_keeps_its_number_with_a_note() -> None:
    texts = chapter("- Withdrawn: part of 99-2. [C 99-1]", "- It MUST be. [C 99-2: BD-BOX-001]")
    assert judged(texts)["99-1"] == {"withdrawn": "part of 99-2"}
    assert "99-1" not in ledger_text(texts)
    assert number_clauses(chapter("- Withdrawn: no more. [C 99-1]"), "") == chapter("- Withdrawn: no more. [C 99-1]")


def test_a_clause_that_no_chapter_has_stays_in_the_machine_form() -> None:
    assert judged(chapter())["5-33"] == ENTRIES["5-33"]


@each(
    ("line", "fault"),
    [
        pytest.param("- It MUST be. [C 99-1]\n- It MUST be. [C 99-1]", "clause 99-1 stands 2 times", id="twice"),
        pytest.param("- It MUST be. [C 1-1]", "clause 1-1 is in another chapter", id="another chapter"),
        pytest.param("- It MUST be. [C 99-1]", "the tag of clause 99-1 names no rule", id="no judge"),
        pytest.param("- It MUST be. [C 99-1: BD-BOX]", "the tag of clause 99-1 is to name rules", id="no rule's name"),
        pytest.param("- It MUST be. [C 99-1: none]", "the tag of clause 99-1 is to name rules", id="no kind"),
        pytest.param(
            "- It MUST be. [C 99-1: BD-BOX-001; BD-BOX-002]", "the tag of clause 99-1 is to name rules", id="two lists"
        ),
        pytest.param(
            "- It MUST be. [C 99-1: people: words]\n- Withdrawn: gone. [C 99-1]",
            "clause 99-1 is withdrawn and stands in a chapter",
            id="withdrawn",
        ),
    ],
)
def test_faults_are_named(line: str, fault: str) -> None:
    assert any(found.startswith(fault) for found in ledger_faults(chapter(line)))


def test_an_entry_without_its_clause_is_named() -> None:
    fault = "clauses.json has 1-1, which no chapter has; say in its chapter why it is withdrawn"
    assert fault in ledger_faults(chapter())


def test_a_rule_without_a_clause_is_named() -> None:
    faults = ledger_faults({name: text.replace("BD-BOX-001", "BD-NEW-001") for name, text in TEXTS.items()})
    assert "BD-BOX-001 judges no clause" in faults
    assert "a clause names BD-NEW-001, which is not in rules.json" in faults
