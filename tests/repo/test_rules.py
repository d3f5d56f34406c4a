"""The rule catalogue refers to things that exist."""

from __future__ import annotations

import re
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

from tests.each import Loop, each
from tests.repo.checkout import CHAPTERS, ROOT, RULES, anchors, files, name

import branchdrive
from branchdrive.contract.columns import STREAMS, TABLES
from branchdrive.contract.resources import load_resource

IDS = {rule["id"] for rule in RULES}
CLAUSE = re.compile(r"spec/[0-9]{2}-[a-z-]+\.md#[a-z0-9-]+")


def clauses() -> set[str]:
    return {f"spec/{chapter.name}#{anchor}" for chapter in CHAPTERS for anchor in anchors(chapter)}


def each_rule() -> Loop:
    return each("rule", RULES, ids=lambda rule: rule["id"])


def test_ids_are_unique() -> None:
    assert len(IDS) == len(RULES)


@each_rule()
def test_area_is_declared(rule: dict[str, Any]) -> None:
    assert rule["id"].split("-")[1] in load_resource("rules.json")["areas"]


@each_rule()
def test_clause_resolves_to_an_anchor(rule: dict[str, Any]) -> None:
    assert rule["clause"] in clauses()


@each_rule()
def test_other_rules_exist(rule: dict[str, Any]) -> None:
    named = {*rule.get("requires", ()), *rule.get("consequences", ())}
    assert named <= IDS - {rule["id"]}


@each_rule()
def test_streams_exist(rule: dict[str, Any]) -> None:
    assert set(rule.get("streams", ())) <= set(STREAMS)


@each_rule()
def test_columns_that_it_reads_exist(rule: dict[str, Any]) -> None:
    for place in rule.get("reads", ()):
        table, _, column = place.partition(".")
        assert table in TABLES
        assert not column or column in {c.name for c in TABLES[table].columns}


def test_requirements_have_no_cycle() -> None:
    TopologicalSorter({rule["id"]: rule.get("requires", ()) for rule in RULES}).prepare()


def known_words() -> set[str]:
    """Names with underscores that a title or remedy can use: columns, streams, vocabulary, documents, API."""
    words = {"t_b", *STREAMS, *TABLES}
    for table in TABLES.values():
        for column in table.columns:
            words |= {column.name, *column.values}
    for schema in ("descriptor.schema.json", "policy.schema.json"):
        words |= set(load_resource(schema)["properties"])
    return words | set(branchdrive.__all__)


@each_rule()
def test_names_in_its_text_exist(rule: dict[str, Any]) -> None:
    text = f"{rule['title']} {rule['remedy']}"
    words = known_words()
    for word in re.findall(r"\b[a-z]+(?:_[a-z0-9]+)*_(?:[a-z0-9]+|\*)", text):
        prefix = word.removesuffix("*")
        assert word in words or (word != prefix and any(known.startswith(prefix) for known in words)), word


def test_rules_are_in_the_order_of_their_areas_and_numbers() -> None:
    areas = list(load_resource("rules.json")["areas"])
    keys = [(areas.index(rule["id"].split("-")[1]), rule["id"]) for rule in RULES]
    assert keys == sorted(keys)


@each("path", [p for p in files(".py", ".json") if not p.is_relative_to(ROOT / "tests")], ids=name)
def test_clauses_that_code_cites_exist(path: Path) -> None:
    assert set(CLAUSE.findall(path.read_text(encoding="utf-8"))) <= clauses()
