"""Reports as text for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from io import StringIO
from typing import TYPE_CHECKING, Any, TextIO, get_args

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from branchdrive.cli.formats.causes import CAUSES_HEAD, cause_texts, causes_text, remedy_text, violations
from branchdrive.cli.formats.outcome import (
    RULE_EXPLAINED,
    cautions,
    files_text,
    folded,
    headline,
    more_text,
    refusals,
    sizes,
    waiver_text,
    with_companions,
)
from branchdrive.cli.funnel import funnel_table, lost_groups_table, no_funnel
from branchdrive.cli.population import (
    print_accesses,
    print_filtering,
    print_leakage,
    print_population,
    print_retention,
)
from branchdrive.contract.layout import FILTERING_FILE
from branchdrive.contract.rule import RuleInfo, cause_order
from branchdrive.contract.text import counted, printable, size_text
from branchdrive.engine.finding import location_text
from branchdrive.engine.report import FUNNEL_BASIS, POPULATION_BASIS, Report
from branchdrive.engine.response_summary import ResponseSummary
from branchdrive.engine.response_table import response_doubt, response_table
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE, RuleStatus, Tally
from branchdrive.engine.verdict import is_waived
from branchdrive.text.brief import brief
from branchdrive.text.terminal import print_section
from branchdrive.text.terminal import render as drawn

if TYPE_CHECKING:
    from branchdrive.release.builder import BuildReport

__all__ = ["render", "render_build", "render_report"]

CAUSES_SHOWN = 10
FINDINGS_SHOWN = 5
GROUPS_SHOWN = 10
_NOTED = "failing without deciding"
_STYLE: dict[str, str] = {
    "valid": "bold green", "valid-with-waivers": "bold yellow", "partial": "bold yellow", "invalid": "bold red",
    "error": "bold magenta", "pass": "green", "fail": "red", "skipped": "yellow", "not-claimed": "dim",
    "inconclusive": "yellow", _NOTED: "yellow",
}  # fmt: skip


_SECTIONS: dict[str, Callable[[RuleInfo], bool]] = {
    "Violations": lambda rule: rule.decides,
    "Recommendations": lambda rule: rule.level == "SHOULD",
    "Why attempts and groups do not qualify": lambda rule: rule.kind == "qualification" and rule.level == "MUST",
    "Diagnostics": lambda rule: rule.kind == "diagnostic" and rule.level == "MUST",
}
"""Sections of findings, and the rules of each."""


def render(report: Report) -> str:
    """The report as text for a file."""
    return drawn(partial(_print_report, report=report), StringIO(), is_file=True)


def render_report(report: Report, stdout: TextIO) -> str:
    """The report as text for `stdout`."""
    return drawn(partial(_print_report, report=report), stdout)


def render_build(report: BuildReport, stdout: TextIO) -> str:
    """What a build made, as text: population, replay fidelity and leakage, as far as they were built."""
    return drawn(partial(_print_build, report=report), stdout)


def _print_report(console: Console, report: Report) -> None:
    _print_head(console, report)
    _print_causes(console, report)
    _print_findings(console, report)
    _print_funnel(console, report)
    if report.response is not None:
        _print_response(console, report.response, response_doubt(report))
    if report.population is not None:
        console.print()
        print_population(console, report.population)
        console.print(Text(f"Funnel: {FUNNEL_BASIS}. Population: {POPULATION_BASIS}.", style="dim"))
    _print_waivers(console, report)
    _print_rules(console, report)
    for message in report.errors:
        console.print(Text(message, style="magenta"))
    _print_verdict(console, report)


def _print_build(console: Console, report: BuildReport) -> None:
    layers = ", ".join(report.layers) or "none"
    console.print(Text(f"layers {layers}", style="bold"), Text(f"at {printable(str(report.target))}", style="dim"))
    console.print(Text(f"identity {report.identity}", style="dim"))
    documents = report.documents
    if "quality/population.json" in documents:
        console.print()
        print_population(console, documents["quality/population.json"])
        _print_shortage(console, documents)
        console.print()
        print_retention(console, documents["quality/retention.json"])
        if FILTERING_FILE in documents:
            print_filtering(console, documents[FILTERING_FILE])
        console.print()
        print_accesses(console, documents["quality/ledger.json"])
        print_leakage(console, documents.get("quality/leakage.json"))


def _print_shortage(console: Console, documents: Mapping[str, Any]) -> None:
    """What a benchmark will lack, beyond what the population says by itself.

    Clusters are those of the split: of a partition that lost groups since, no more are left.
    """
    from branchdrive.benchmark.protocol.protocol import default_protocol
    from branchdrive.benchmark.shortage import inconclusive_sentence, unguarded_sentence
    from branchdrive.statistics.bca import LEAST_UNITS

    groups = documents["quality/population.json"]["stages"][-1]["groups"] or {}
    sizes = documents["quality/split.json"]["partitions"]
    clusters = {name: min(size["clusters"], groups.get(name, 0)) for name, size in sizes.items()}
    has_enough_groups = groups.get("test", 0) >= LEAST_UNITS
    found = (
        inconclusive_sentence(groups, clusters) if has_enough_groups else None,
        unguarded_sentence(groups, clusters, default_protocol().guard) if groups.get("calibration") else None,
    )
    for sentence in filter(None, found):
        console.print(Text(sentence, style="yellow"))


def _print_head(console: Console, report: Report) -> None:
    facts = report.dataset
    name = f"{facts.dataset_id} {facts.dataset_version}" if facts.dataset_id else "dataset with an unusable descriptor"
    console.print(Text(name, style="bold"), Text(f"at {facts.path}", style="dim"))
    parts = [
        sizes(report),
        *(f"{facts.rows[table]:,} {table}" for table in ("controls", "observations", "actors") if table in facts.rows),
    ]  # fmt: skip
    console.print(Text(", ".join(parts)))
    files = [counted(facts.num_shards, "shard"), files_text(report), size_text(facts.num_bytes)]
    console.print(Text(", ".join(files) + with_companions(report)))
    if facts.raw_path:
        console.print(Text(f"raw layer at {facts.raw_path}", style="dim"))
    if facts.identity:
        console.print(Text(f"identity {facts.identity}", style="dim"))
    if facts.content_identity:
        console.print(Text(f"content  {facts.content_identity}", style="dim"))


def _print_causes(console: Console, report: Report) -> None:
    texts = cause_texts(report)
    if not texts:
        return
    console.print()
    console.print(Text(CAUSES_HEAD, style="bold"))
    for cause in texts[:CAUSES_SHOWN]:
        style = "red" if cause.info.decides else "yellow"
        console.print(Padding(Text.assemble((cause.info.id, style), f"  {cause.title}"), (0, 0, 0, 2)))
        console.print(Padding(Text(cause.where, style="cyan"), (0, 0, 0, 6)))
        for line in filter(None, (*(text for text, _ in cause.found), cause.follows)):
            console.print(Padding(Text(line), (0, 0, 0, 6)))
        console.print(Padding(Text(f"remedy: {cause.remedy}", style="dim"), (0, 0, 0, 6)))
    if len(texts) > CAUSES_SHOWN:
        more = f"... and {counted(len(texts) - CAUSES_SHOWN, 'other rule')} below"
        console.print(Padding(Text(more, style="dim"), (0, 0, 0, 2)))


def _print_findings(console: Console, report: Report) -> None:
    for title, belongs in _SECTIONS.items():
        failed = [tally for tally in report.tallies if tally.num_findings and belongs(tally.info)]
        failed.sort(key=lambda tally: cause_order(tally.rule_id))
        if failed:
            console.print()
            console.print(Text(title, style="bold"))
        for tally in failed:
            _print_rule_findings(console, tally, report)
    if any(tally.num_findings for tally in report.tallies):
        console.print()
        console.print(Text(f"{RULE_EXPLAINED}.", style="dim"))


def _print_rule_findings(console: Console, tally: Tally, report: Report) -> None:
    info = tally.info
    waived = " (waived)" if is_waived(tally) else ""
    style = "red" if info.decides and not waived else "yellow"
    line = f"  {info.broken}{waived}: {violations(tally)}"
    console.print(Padding(Text.assemble((info.id, style), line), (0, 0, 0, 2)))
    parts = folded(tally.findings)
    for part in parts[:FINDINGS_SHOWN]:
        finding = part[0]
        where = f"{location_text(finding.location)} {more_text(part)}".rstrip()
        console.print(Padding(Text(where, style="cyan"), (0, 0, 0, 6)))
        (said,) = brief(f"expected {finding.expected}; found {finding.found}")
        console.print(Padding(Text(said), (0, 0, 0, 8)))
    # Rules on rows count rows, of which a finding may hold several; the others count findings.
    left = tally.num_findings - sum(map(tally.places, parts[:FINDINGS_SHOWN]))
    if left > 0 and tally.findings:
        more = f"... and {left:,} more (--format json lists up to {MAX_FINDINGS_PER_RULE})"
        console.print(Padding(Text(more, style="dim"), (0, 0, 0, 6)))
    if follows := causes_text(tally, report):
        console.print(Padding(Text(follows), (0, 0, 0, 6)))
    console.print(Padding(Text(f"remedy: {remedy_text(tally, report)}", style="dim"), (0, 0, 0, 6)))


def _print_funnel(console: Console, report: Report) -> None:
    console.print()
    if reason := no_funnel(report):
        console.print(Text(f"Funnel: {reason}", style="yellow" if report.funnel is None else ""))
    if report.funnel is None or reason:
        return
    print_section(console, funnel_table(report.funnel))
    if lost := lost_groups_table(report, GROUPS_SHOWN):
        console.print()
        print_section(console, lost)


def _print_waivers(console: Console, report: Report) -> None:
    if report.waivers:
        console.print()
        console.print(Text("Waivers", style="bold"))
    for outcome in report.waivers:
        w = outcome.waiver
        use = printable(waiver_text(outcome, report))
        line = f"{w.rule} at {printable(w.location)}: {use} - {printable(w.reason)}"
        console.print(Padding(Text(line), (0, 0, 0, 2)))


def _print_rules(console: Console, report: Report) -> None:
    console.print()
    # A failed rule that decides nothing is counted apart, since the verdict above may be `valid`.
    counts = Counter(_NOTED if t.status == "fail" and not t.info.decides else t.status for t in report.tallies)
    parts = [
        (f"{counts[status]} {status}", _STYLE.get(status, ""))
        for status in (*get_args(RuleStatus), _NOTED)
        if counts[status]
    ]
    line = Text("Rules: ", style="bold")
    for i, (text, style) in enumerate(parts):
        line.append(", " if i else "", style="").append(text, style=style)
    console.print(line)
    quiet: dict[str, list[str]] = {}
    for tally in report.tallies:
        if tally.status in ("skipped", "not-claimed"):
            quiet.setdefault(f"{tally.status}: {tally.reason}", []).append(tally.rule_id)
    for reason, rule_ids in quiet.items():
        listed = ", ".join(rule_ids[:6]) + (f" and {len(rule_ids) - 6} more" if len(rule_ids) > 6 else "")
        listed = counted(len(rule_ids), "rule") if reason.startswith("not-claimed") else listed
        console.print(Padding(Text(f"{reason} - {listed}", style="dim"), (0, 0, 0, 2)))


def _print_verdict(console: Console, report: Report) -> None:
    meaning = headline(report).removeprefix(report.verdict)
    console.print(Text.assemble("Verdict: ", (report.verdict, _STYLE[report.verdict]), meaning))
    for condition in report.conditions:
        console.print(Padding(Text(condition, style="dim"), (0, 0, 0, 2)))
    for refusal in refusals(report):
        console.print(Text(refusal, style="bold red"))
    for caution in cautions(report):
        console.print(Text(caution, style="bold yellow"))


def _print_response(console: Console, response: ResponseSummary, doubt: str) -> None:
    """Print what each action did against the nominal, why to doubt it, and which columns never change."""
    if not response.actions:
        return
    console.print()
    print_section(console, response_table(response))
    if doubt:
        console.print(Text(doubt, style="yellow"))
    if response.constant:
        listed = ", ".join(f"{name} {value:.4g}" for name, value in sorted(response.constant.items()))
        console.print(Text(f"The same in every observation: {listed}", style="yellow"))
