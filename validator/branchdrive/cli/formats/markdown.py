"""The report as Markdown, for the summary of a CI run or a comment of a review.

Text of a dataset or of a waiver stands in code spans, outside of tables, where no renderer finds markup, links,
mentions or HTML in it.
"""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.cli.formats.causes import CAUSES_HEAD
from branchdrive.cli.formats.outcome import RULE_EXPLAINED, Failure, Outcome
from branchdrive.cli.funnel import funnel_table, lost_groups_table, no_funnel
from branchdrive.contract.text import counted
from branchdrive.engine.report import Report
from branchdrive.text.markdown import code_span, section_lines

__all__ = ["render"]

FINDINGS_SHOWN = 5
GROUPS_SHOWN = 1000

_SIGNS: dict[str, str] = {
    "valid": "✅", "valid-with-waivers": "⚠️", "partial": "⚠️", "invalid": "❌", "error": "💥",
}  # fmt: skip


def render(report: Report) -> str:
    """Verdict, rules with findings, funnel, waivers."""
    outcome = Outcome.of(report, FINDINGS_SHOWN)
    lines = [
        *_head_lines(report, outcome),
        *_cause_lines(outcome),
        *_rule_lines(outcome),
        *_funnel_lines(report),
        *_waiver_lines(outcome),
    ]
    return "\n".join(lines) + "\n"


def _head_lines(report: Report, outcome: Outcome) -> Iterator[str]:
    facts = report.dataset
    sign = "❌" if outcome.refusals else "⚠️" if outcome.cautions else _SIGNS[report.verdict]
    yield f"# {sign} BranchDrive: {outcome.headline}"
    yield ""
    name = f"{facts.dataset_id} {facts.dataset_version}" if facts.dataset_id else "dataset with an unusable descriptor"
    yield (
        f"{code_span(name)} at {code_span(facts.path)}: {outcome.sizes}, {counted(facts.num_shards, 'shard')}"
        f"{outcome.companions}"
    )
    yield ""
    for refusal in outcome.refusals:
        yield f"- **{refusal}**"
    for caution in outcome.cautions:
        yield f"- **{caution}**"
    for condition in report.conditions:
        yield f"- {code_span(condition)}"
    for message in report.errors:
        yield f"- the tool failed: {code_span(message)}"


def _cause_lines(outcome: Outcome) -> Iterator[str]:
    if outcome.causes:
        yield from ("", f"## {CAUSES_HEAD}", "")
    for cause in outcome.causes:
        name = f"[{cause.info.id}]({cause.info.url})" if cause.info.url else cause.info.id
        found = "".join(f" {code_span(text)}." for text, _ in cause.found)
        follows = f" {cause.follows[0].upper()}{cause.follows[1:]}." if cause.follows else ""
        yield f"- **{name}** {code_span(cause.title)}: {code_span(cause.where)}.{found}{follows} To do: {cause.remedy}"


def _rule_lines(outcome: Outcome) -> Iterator[str]:
    for _, head, failures in outcome.sections:
        yield from ("", f"## {head}")
        for failure in failures:
            yield from _failure_lines(failure)
    if any(not failure.is_error for *_, failures in outcome.sections for failure in failures):
        yield from ("", f"{RULE_EXPLAINED}.")
    if outcome.unjudged:
        yield from ("", "## What was not judged", "", *(f"- {code_span(reason)}" for reason in outcome.unjudged))


def _failure_lines(failure: Failure) -> Iterator[str]:
    info = failure.info
    result = code_span(failure.summary) if failure.is_error else failure.summary
    name = f"[{info.id}]({info.url})" if info.url else info.id
    yield from ("", f"### {name} {info.title if failure.is_error else info.broken}", "", f"{info.kind}: {result}", "")
    for place in failure.places:
        yield f"- {code_span(place.where)}{place.more}  "
        yield f"  expected {code_span(place.expected)}, found {code_span(place.found)}"
    if failure.num_left > 0:
        yield f"- ... and {failure.num_left:,} more"
    if failure.follows:
        yield from ("", f"This {failure.follows}.")
    if failure.remedy:
        yield from ("", f"To do: {failure.remedy}")


def _funnel_lines(report: Report) -> Iterator[str]:
    yield ""
    if reason := no_funnel(report):
        yield from ("## Funnel", "", reason)
    elif report.funnel is not None:
        yield from section_lines(funnel_table(report.funnel))
    if lost := lost_groups_table(report, GROUPS_SHOWN):
        yield from ("", *section_lines(lost))


def _waiver_lines(outcome: Outcome) -> Iterator[str]:
    if outcome.waivers:
        yield from ("", "## Waivers", "")
    for waiver, use in outcome.waivers:
        yield f"- {waiver.rule} at {code_span(waiver.location)}: {code_span(use)}: {code_span(waiver.reason)}"
