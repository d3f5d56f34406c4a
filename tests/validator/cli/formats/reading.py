"""How the programs that reports are for read them: written from what those programs document, not from the writers."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from jsonschema import Draft202012Validator
from markdown_it import MarkdownIt
from markdown_it.token import Token

__all__ = ["annotations", "junit_cases", "markdown_tokens", "sarif_run"]

_SARIF = Draft202012Validator(json.loads((Path(__file__).parent / "sarif-subset.schema.json").read_text("utf-8")))

_COMMAND = re.compile(r"::(?P<name>[a-z-]+)(?: (?P<properties>[^:]*))?::(?P<message>.*)")
"""A workflow command as the runner of GitHub Actions takes it apart, at the first `::` after the name."""

_JUNIT: dict[str, tuple[set[str], set[str], set[str]]] = {
    "testsuites": ({"name", "tests", "failures", "errors"}, {"time"}, {"testsuite"}),
    "testsuite": ({"name", "tests", "failures", "errors"}, {"skipped", "time"}, {"testcase"}),
    "testcase": ({"name"}, {"classname", "time"}, {"failure", "error", "skipped"}),
    "failure": (set(), {"message", "type"}, set()),
    "error": (set(), {"message", "type"}, set()),
    "skipped": (set(), {"message", "type"}, set()),
}
"""Elements of JUnit XML that Jenkins reads and reports use: required attributes, further ones, and children."""


def annotations(text: str) -> list[tuple[str, dict[str, str], str]]:
    """Name, properties and message of every command; whatever is no command is an error."""
    found = []
    for line in text.split("\n")[:-1]:
        assert line.isprintable() and line.isascii(), line
        match = _COMMAND.fullmatch(line)
        assert match, line
        parts = (part.partition("=") for part in (match["properties"] or "").split(","))
        properties = {key: _decoded(value, (":", ",")) for key, _, value in parts}
        assert match["name"] in ("error", "warning", "notice"), line
        assert set(properties) <= {"title", "file"}, line
        found.append((match["name"], properties, _decoded(match["message"])))
    assert text.endswith("\n")
    return found


def _decoded(text: str, further: tuple[str, ...] = ()) -> str:
    for character in (*further, "\r", "\n"):
        text = text.replace(f"%{ord(character):02X}", character)
    return text.replace("%25", "%")


def sarif_run(text: str) -> dict[str, Any]:
    """The run of a SARIF file that meets the schema, with rules that results and notifications point at."""
    document = json.loads(text)
    assert [error.message for error in _SARIF.iter_errors(document)] == []
    (run,) = document["runs"]
    rules = run["tool"]["driver"]["rules"]
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
    for notification in run["invocations"][0]["toolExecutionNotifications"]:
        if rule := notification.get("associatedRule"):
            assert rules[rule["index"]]["id"] == rule["id"]
    found: dict[str, Any] = run
    return found


def junit_cases(text: str) -> list[tuple[str, str, str]]:
    """Name, result and message of every test case; counts must be those of the cases."""
    root = ElementTree.fromstring(text)
    assert root.tag == "testsuites"
    for element in root.iter():
        required, further, children = _JUNIT[element.tag]
        assert required <= set(element.attrib) <= required | further
        assert {child.tag for child in element} <= children
        if element.tag in ("testsuites", "testsuite"):
            _check_counts(element)
    return [(case.attrib["name"], *_result(case)) for case in root.iter("testcase")]


def _result(case: ElementTree.Element) -> tuple[str, str]:
    for child in case:
        return child.tag, child.attrib["message"]
    return "passed", ""


def _check_counts(element: ElementTree.Element) -> None:
    cases = list(element.iter("testcase"))
    counts = {"tests": len(cases)}
    for tag, name in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        counts[name] = sum(case.find(tag) is not None for case in cases)
    for name, count in counts.items():
        if name in element.attrib:
            assert int(element.attrib[name]) == count


def markdown_tokens(text: str) -> Iterator[Token]:
    """All tokens of a Markdown text with tables, inline ones after their block."""
    for token in MarkdownIt("commonmark").enable(["table", "strikethrough"]).parse(text):
        yield token
        yield from token.children or ()
