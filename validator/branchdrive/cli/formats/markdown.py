"""The report as Markdown, for the summary of a CI run or a comment of a review.

Text of a dataset or of a waiver stands in code spans, outside of tables, where no renderer finds markup, links,
mentions or HTML in it.
"""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.cli.formats.causes import causes, causes_text
from branchdrive.cli.formats.outcome import (
    RULE_EXPLAINED,
    Level,
    also_in,
    failures,
    folded,
    headline,
    refusals,
    sizes,
    summary,
    unjudged,
    waiver_text,
    with_companions,
)
from branchdrive.cli.funnel import funnel_table, lost_groups_table
from branchdrive.contract.text import counted
from branchdrive.engine.finding import location_text
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import is_waived
from branchdrive.text.markdown import code_span, section_lines

__all__ = ["render"]

FINDINGS_SHOWN = 5
GROUPS_SHOWN = 1000

_SIGNS: dict[str, str] = {
    "valid": "✅", "valid-with-waivers": "⚠️", "partial": "⚠️", "invalid": "❌", "error": "💥",
}  # fmt: skip
_HEADS: dict[Level, str] = {
    "error": "What is wrong",
    "warning": "What is not as recommended",
    "note": "Why attempts and groups do not qualify, and what is waived",
}


def render(report: Report) -> str:
    """Verdict, rules with findings, funnel, waivers."""
    return (
        "\n".join([*_head_lines(report), *_rule_lines(report), *_funnel_lines(report), *_waiver_lines(report)]) + "\n"
    )


def _head_lines(report: Report) -> Iterator[str]:
    facts = report.dataset
    sign = "❌" if refusals(report) else _SIGNS[report.verdict]
    yield f"# {sign} BranchDrive: {headline(report)}"
    yield ""
    name = f"{facts.dataset_id} {facts.dataset_version}" if facts.dataset_id else "dataset with an unusable descriptor"
    yield (
        f"{code_span(name)} at {code_span(facts.path)}: {sizes(report)}, {counted(facts.num_shards, 'shard')}"
        f"{with_companions(report)}"
    )
    yield ""
    for refusal in refusals(report):
        yield f"- **{refusal}**"
    for condition in report.conditions:
        yield f"- {code_span(condition)}"
    for message in report.errors:
        yield f"- the tool failed: {code_span(message)}"


def _rule_lines(report: Report) -> Iterator[str]:
    found = failures(report)
    for level, head in _HEADS.items():
        tallies = [tally for its_level, tally in found if its_level == level]
        if tallies:
            yield from ("", f"## {head}")
        for tally in tallies:
            yield from _tally_lines(tally, report)
    if any(tally.status == "fail" for _, tally in found):
        yield from ("", f"{RULE_EXPLAINED}.")
    if reasons := unjudged(report):
        yield from ("", "## What was not judged", "", *(f"- {code_span(reason)}" for reason in reasons))


def _tally_lines(tally: Tally, report: Report) -> Iterator[str]:
    info = tally.info
    result = summary(tally) if tally.status == "fail" else code_span(summary(tally))
    name = f"[{info.id}]({info.url})" if info.url else info.id
    yield from ("", f"### {name} {info.title}", "", f"{info.kind}: {result}", "")
    shown = folded(tally.findings)[:FINDINGS_SHOWN]
    for part in shown:
        finding = part[0]
        more = (f" ({finding.count:,} places)" if finding.count > 1 else "") + also_in(part)
        yield f"- {code_span(location_text(finding.location))}{more}  "
        yield f"  expected {code_span(finding.expected)}, found {code_span(finding.found)}"
    left = tally.num_findings - sum(map(tally.places, shown))
    if left > 0 and tally.findings:
        yield f"- ... and {left:,} more"
    if tally.status == "fail" and (rules := causes(tally, report)):
        yield from ("", f"This {causes_text(rules)}.")
    if tally.status == "fail" and not is_waived(tally):
        yield from ("", f"To do: {info.remedy}")


def _funnel_lines(report: Report) -> Iterator[str]:
    yield ""
    if report.funnel is None:
        yield from ("## Funnel", "", "not judged")
    else:
        yield from section_lines(funnel_table(report.funnel))
    if lost := lost_groups_table(report, GROUPS_SHOWN):
        yield from ("", *section_lines(lost))


def _waiver_lines(report: Report) -> Iterator[str]:
    if report.waivers:
        yield from ("", "## Waivers", "")
    for outcome in report.waivers:
        w = outcome.waiver
        use = code_span(waiver_text(outcome, report))
        yield f"- {w.rule} at {code_span(w.location)}: {use}: {code_span(w.reason)}"
