"""Reports for other programs: each form holds for every verdict, and whatever text a dataset has."""

from __future__ import annotations

import json
import string
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.validator.cli.formats.reading import annotations, junit_cases, markdown_tokens, sarif_run
from tests.validator.engine.datasets import DEPARTURES, write
from tests.validator.engine.test_report import SITUATIONS

from branchdrive.cli.formats.outcome import level_of, verdict_level
from branchdrive.cli.formats.table import FORMATS, renderer
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.engine.waiver import Waiver, WaiverOutcome


@pytest.fixture(scope="module", params=SITUATIONS)
def report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Report:
    situation: Callable[[Path], Report] = SITUATIONS[request.param]
    return situation(tmp_path_factory.mktemp("situation") / "dataset")


# --- what is not valid is never green


def test_annotations_tell_the_verdict_and_every_rule_that_failed(report: Report) -> None:
    found = annotations(renderer("github")(report))
    name, properties, message = found[0]
    wanted = {"error": "error", "warning": "warning", "note": "notice"}[verdict_level(report)]
    assert (name, properties["title"]) == (wanted, f"BranchDrive: {report.verdict}")
    assert message.startswith(f"{report.verdict} - ")
    titles = [properties["title"].split()[0] for _, properties, _ in found]
    assert {tally.rule_id for tally in report.tallies if tally.status in ("fail", "error")} <= set(titles)
    assert any(name != "notice" for name, *_ in found) or (report.verdict == "valid" and not report.exit_code)


def test_sarif_tells_the_verdict_and_every_finding(report: Report) -> None:
    run = sarif_run(renderer("sarif")(report))
    (invocation,) = run["invocations"]
    assert invocation["exitCode"] == report.exit_code
    assert invocation["executionSuccessful"] == (report.verdict != "error")
    assert invocation["toolExecutionNotifications"][0]["level"] == verdict_level(report)
    assert run["properties"]["verdict"] == report.verdict
    failures = [result for result in run["results"] if result["kind"] == "fail"]
    assert len(failures) == len(report.findings)
    if report.verdict == "invalid":
        assert any(result["level"] == "error" and "suppressions" not in result for result in failures)
    if report.verdict == "partial":
        assert any(result["kind"] == "open" for result in run["results"])
    prints = [tuple(result["partialFingerprints"].values()) for result in failures]
    places = {(finding.rule, str(finding.location)) for finding in report.findings}
    assert len(set(prints)) == len(places)


def test_junit_tells_the_verdict_and_every_rule(report: Report) -> None:
    cases = junit_cases(renderer("junit")(report))
    results = {name.split()[0]: result for name, result, _ in cases[1:]}
    name, result, _ = cases[0]
    wanted = {"valid": "passed", "valid-with-waivers": "skipped", "invalid": "failure"}.get(report.verdict, "error")
    assert (name, result) == (f"verdict {report.verdict}", wanted)
    assert set(CATALOGUE) <= set(results)
    for tally in report.tallies:
        assert (results[tally.rule_id] == "passed") == (tally.status == "pass")
        assert (results[tally.rule_id] in ("failure", "error")) == (level_of(tally, report) == "error")
    if report.exit_code:
        assert any(result in ("failure", "error") for _, result, _ in cases)


def test_markdown_tells_the_verdict_first_and_names_pages(report: Report) -> None:
    text = renderer("markdown")(report)
    sign = text.split()[1]
    assert report.verdict in text.split("\n")[0]
    assert (sign == "✅") == (report.verdict == "valid" and not report.exit_code)
    for tally in report.tallies:
        if tally.status in ("fail", "error"):
            title = tally.info.broken if tally.status == "fail" else tally.info.title
            assert f"### {tally.rule_id} {title}" in text


def test_json_names_the_page_of_every_rule(report: Report) -> None:
    document = json.loads(renderer("json")(report))
    assert {rule["id"]: rule["url"] for rule in document["rules"]} == {
        rule: info.url for rule, info in CATALOGUE.items()
    }


def test_refusals_of_strictness_are_errors(tmp_path: Path) -> None:
    report = replace(SITUATIONS["valid"](tmp_path / "dataset"))
    tally = next(tally for tally in report.tallies if tally.info.kind == "diagnostic" and tally.status == "pass")
    tally.num_findings = 1
    assert level_of(tally, report) == "warning"
    strict = replace(report, options=replace(report.options, is_strict=True))
    assert (level_of(tally, strict), verdict_level(strict), strict.exit_code) == ("error", "error", 1)
    assert (tally.rule_id, "skipped") in [(n.split()[0], r) for n, r, _ in junit_cases(renderer("junit")(report))]
    assert (tally.rule_id, "failure") in [(n.split()[0], r) for n, r, _ in junit_cases(renderer("junit")(strict))]


# --- text of others stays text


Spoil = Callable[[str], Report]


@pytest.fixture(scope="module")
def spoil(tmp_path_factory: pytest.TempPathFactory) -> Spoil:
    """Gives a report with a waived finding, whose texts are a given one."""
    root = write(tmp_path_factory.mktemp("waived") / "dataset", DEPARTURES["speed out of range"].tables())
    waivers = [Waiver("BD-VAL-002", "*", "known", date(2999, 1, 1), 1)]
    report = validate(root, waivers=waivers, ignore=["BD-CTL"])
    return lambda text: spoiled(report, text)


MARKUP = [
    "::error::forged", "\n::add-mask::x", "%0A::set-env name=A::b", "##[error]x", "::stop-commands::t", "%25", "a:b,c",
    "<script>alert(1)</script>", "<!-- ", "]]>", "&amp;&#10;", "\"'", "| a | b |", "# head", "\n# head", "```\n", "``",
    "[x](http://evil.example)", "![](//evil.example)", "<http://evil.example>", "@everyone", ":smile:", "**bold**", "`",
    "\x1b[31m", "\x00", "\r", "\x85", "\u2028", "\u202e", "\udc80", "\ufffe", "\U0001f600", "", "\\",
]  # fmt: skip
hostile = st.lists(st.sampled_from(MARKUP) | st.text(max_size=8) | st.text(string.printable, max_size=8)).map("".join)


def spoiled(report: Report, text: str) -> Report:
    """A report with few findings as a dataset and waivers with this text would give it, which nothing has escaped."""
    tallies = deepcopy(report.tallies)
    for tally in tallies:
        tally.findings = [
            replace(f, location={"file": text, "rollout_id": text}, expected=text, found=text)
            for f in tally.findings[:2]
        ]
        tally.unjudged = tally.unjudged and text
    waivers = tuple(
        WaiverOutcome(replace(outcome.waiver, location=text, reason=text), 1, "used") for outcome in report.waivers
    )
    facts = replace(report.dataset, dataset_id=text, dataset_version=text, path=f"d/{text}")
    return replace(report, tallies=tallies, waivers=waivers, dataset=facts, errors=(f"failed {text}", f"a\n{text}"))


def shape_of_markdown(text: str) -> list[tuple[Any, ...]]:
    """Tokens of a Markdown text without what stands in code spans."""
    return [
        (token.type, token.tag, token.attrs, "" if token.type in ("code_inline", "inline") else token.content)
        for token in markdown_tokens(text)
    ]


@given(text=hostile)
def test_no_text_forges_a_command(spoil: Spoil, text: str) -> None:
    plain, found = (annotations(renderer("github")(spoil(words))) for words in ("x", text))
    assert [(name, properties["title"]) for name, properties, _ in found] == [
        (name, properties["title"]) for name, properties, _ in plain
    ]


@pytest.fixture(scope="module")
def plain_rules(spoil: Spoil) -> list[str]:
    """Rules of the results of a report whose texts are plain."""
    return [result["ruleId"] for result in json.loads(renderer("sarif")(spoil("x")))["runs"][0]["results"]]


@given(text=hostile)
def test_no_text_breaks_sarif(spoil: Spoil, plain_rules: list[str], text: str) -> None:
    written = renderer("sarif")(spoil(text))
    assert written.isascii()
    run = sarif_run(written)
    assert [result["ruleId"] for result in run["results"]] == plain_rules
    for result in run["results"]:
        shown = [result["message"]["text"], *(it.get("justification", "") for it in result.get("suppressions", ()))]
        assert all(words.isprintable() for words in shown)


@given(text=hostile)
def test_no_text_breaks_junit(spoil: Spoil, text: str) -> None:
    plain, found = (junit_cases(renderer("junit")(spoil(words))) for words in ("x", text))
    assert [case[:2] for case in found] == [case[:2] for case in plain]


@given(text=hostile)
def test_no_text_is_markup(spoil: Spoil, text: str) -> None:
    plain, written = (renderer("markdown")(spoil(words)) for words in ("x", text))
    assert shape_of_markdown(written) == shape_of_markdown(plain)
    assert not any("html" in token.type for token in markdown_tokens(written))


def test_hostile_text_is_shown_in_full(spoil: Spoil) -> None:
    text = "<b>`a|b`</b> :: %0A @x"
    report = spoil(text)
    shown = [message for *_, message in annotations(renderer("github")(report))]
    assert any(f"expected {text}, found {text}" in message for message in shown)
    codes = [token.content for token in markdown_tokens(renderer("markdown")(report)) if token.type == "code_inline"]
    assert text in codes


# --- the table of forms


@each("form", FORMATS)
def test_every_form_is_text_with_an_end(plain: Report, form: str) -> None:
    text = renderer(form)(plain)
    assert text.endswith("\n") and not text.endswith("\n\n")
    assert "\x1b" not in text


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Report:
    return SITUATIONS["invalid"](tmp_path_factory.mktemp("plain") / "dataset")
