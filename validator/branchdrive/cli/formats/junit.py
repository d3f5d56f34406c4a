"""The report as JUnit XML, the form that CI services read test results in.

A rule is a test case, an area a suite, and the verdict a suite of its own, so that nothing but a `valid` dataset is
all green. There is no standard; elements and attributes are those of the schema that Jenkins reads.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

from branchdrive.cli.formats.causes import remedy_text
from branchdrive.cli.formats.outcome import headline, level_of, refusals, summary
from branchdrive.contract.rule import AREAS
from branchdrive.contract.text import printable
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally

__all__ = ["render"]


class _Case(NamedTuple):
    """A test case; `result` is the name of the element that says why it did not pass, empty if it did."""

    name: str
    result: str = ""
    message: str = ""
    details: tuple[str, ...] = ()


def render(report: Report) -> str:
    """All suites, that of the verdict first."""
    suites = {"verdict": [*_verdict_cases(report)]}
    for tally in report.tallies:
        suites.setdefault(AREAS[tally.rule_id[3:6]], []).append(_rule_case(tally, report))
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<testsuites name="BranchDrive" {_counts([case for cases in suites.values() for case in cases])}>',
        *(line for name, cases in suites.items() for line in _suite_lines(name, cases)),
        "</testsuites>",
    ]
    return "\n".join(lines) + "\n"


def _verdict_cases(report: Report) -> Iterator[_Case]:
    name = f"verdict {report.verdict}"
    result = headline(report)
    match report.verdict:
        case "valid":
            yield _Case(name)
        case "valid-with-waivers":
            yield _Case(name, "skipped", result, report.conditions)
        case "invalid":
            yield _Case(name, "failure", result, report.conditions)
        case _:  # nothing is known to be wrong, and yet the dataset is not known to be right
            yield _Case(name, "error", result, (*report.conditions, *report.errors))
    for refusal in refusals(report):
        yield _Case("required by the caller", "failure", refusal)


def _rule_case(tally: Tally, report: Report) -> _Case:
    """Case of a rule; what fails without deciding is neither passed nor failed, so it counts as skipped."""
    name = f"{tally.rule_id} {tally.info.title}"
    if tally.status == "pass":
        return _Case(name)
    level = level_of(tally, report)
    if tally.status == "fail":
        details = (
            *(finding.message for finding in tally.findings),
            f"remedy: {remedy_text(tally, report)}",
            tally.info.explained,
        )
        return _Case(name, "failure" if level == "error" else "skipped", summary(tally), details)
    return _Case(name, "error" if tally.status == "error" else "skipped", summary(tally), tuple(tally.errors))


def _counts(cases: list[_Case], *, is_suite: bool = False) -> str:
    found = Counter(case.result for case in cases)
    counts = {"tests": len(cases), "failures": found["failure"], "errors": found["error"]}
    counts |= {"skipped": found["skipped"]} if is_suite else {}
    return " ".join(f'{name}="{count}"' for name, count in counts.items())


def _suite_lines(name: str, cases: list[_Case]) -> Iterator[str]:
    yield f"  <testsuite name={_quoted(name)} {_counts(cases, is_suite=True)}>"
    for case in cases:
        head = f"    <testcase classname={_quoted(f'branchdrive.{name}')} name={_quoted(case.name)}"
        if not case.result:
            yield f"{head}/>"
            continue
        details = escape("\n".join(printable(line) for text in case.details for line in text.split("\n")))
        yield f"{head}>"
        yield f"      <{case.result} message={_quoted(case.message)}>{details}</{case.result}>"
        yield "    </testcase>"
    yield "  </testsuite>"


def _quoted(text: str) -> str:
    return quoteattr(printable(text))
