"""Conformance of a pilot: the validator's verdict, and every rule that fails with its remedy."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from branchdrive.contract.text import counted
from branchdrive.engine.finding import location_text
from branchdrive.engine.tally import Tally
from branchdrive.exit_code import EXIT_OF_VERDICT
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section

__all__ = ["conformance"]

_QUIET = ("not-claimed", "skipped")

_BANK = "BD-BNK-001"
"""The rule that every group fails of which a collector records the nominal alone."""

_WITHOUT_BRANCH = ("BD-TIC-003", _BANK)
"""Rules that every seed without a branch fails, once."""


def conformance(pilot: Pilot, causes: Sequence[Section]) -> Section:
    """Verdict, rules that fail, and what no rule could look at.

    Args:
        pilot: What was read.
        causes: Sections that name causes of failures.
    """
    report = pilot.report
    counts = {status: sum(tally.status == status for tally in report.tallies) for status in ("pass", "fail")}
    lenient = counts["fail"] and not EXIT_OF_VERDICT[report.verdict]
    facts = [
        f"The validator's verdict is {report.verdict}: {counted(counts['pass'], 'rule')} hold on what is recorded, "
        f"{counts['fail']} fail"
        + (", which costs groups their qualification or is a recommendation." if lenient else "."),
    ]
    if report.funnel is not None:
        facts.append(
            f"{report.funnel.qualified} of {counted(report.funnel.discovered, 'group')} qualify for a release."
        )
    unclaimed = [tally.rule_id for tally in report.tallies if tally.status == "not-claimed" and not tally.info.layer]
    if unclaimed:
        facts.append(f"The descriptor claims no stream of {', '.join(unclaimed)}, so that they examine nothing.")
    failed = {tally.rule_id: tally for tally in report.tallies if tally.num_findings}
    bare, bare_facts = _without_replays(pilot, failed)
    concerns = [
        *(_concern(tally) for rule_id, tally in failed.items() if rule_id not in (*bare, *_explained(causes))),
        *_consequences([tally for rule_id, tally in failed.items() if rule_id not in bare], causes),
    ]
    concerns += [
        Concern(f"The validator itself failed: {message.splitlines()[-1]}", "Please report it.")
        for message in report.errors
    ]
    return Section(
        "conformance",
        "Conformance",
        [*facts, *bare_facts],
        concerns,
        not_examined=_not_examined(report.tallies),
        figures={
            "verdict": report.verdict,
            "exit_code": EXIT_OF_VERDICT[report.verdict],
            "rules": {tally.rule_id: tally.status for tally in report.tallies if tally.status not in _QUIET},
            "num_violations": {rule_id: tally.num_findings for rule_id, tally in failed.items()},
        },
    )


def _explained(causes: Sequence[Section]) -> dict[str, Section]:
    """The section that names the cause of a rule's failures, by rule."""
    return {rule_id: section for section in reversed(causes) for rule_id in section.explains}


def _consequences(failed: Sequence[Tally], causes: Sequence[Section]) -> Iterator[Concern]:
    """A concern for all rules that fail for what one section names."""
    explained, of_section = _explained(causes), defaultdict[str, list[Tally]](list)
    for tally in failed:
        if tally.rule_id in explained:
            of_section[explained[tally.rule_id].title].append(tally)
    for title, tallies in of_section.items():
        names = ", ".join(tally.rule_id for tally in tallies)
        yield Concern(
            f"{names} {'fails' if len(tallies) == 1 else 'fail'}; what {title} names is the likely cause.",
            "Settle that first. What still fails then has a cause of its own, and is named here with its remedy.",
            any(_costs(tally) for tally in tallies),
        )


def _without_replays(pilot: Pilot, failed: dict[str, Tally]) -> tuple[list[str], list[str]]:
    """Rules that fail for groups of a nominal alone and nothing else, and facts that say which groups these are."""
    unbranched, alone = _groups_of_one(pilot)
    refused = {g for rule_id, tally in failed.items() if rule_id not in _WITHOUT_BRANCH for g in _groups(tally)} & alone
    bare = [r for r in _WITHOUT_BRANCH if r in failed and failed[r].num_findings == len(unbranched)]
    if _BANK in failed and refused == alone and failed[_BANK].num_findings == len(unbranched | alone):
        bare = [r for r in _WITHOUT_BRANCH if r in (*bare, _BANK)]
    facts = []
    if bare and unbranched:
        rules = [rule_id for rule_id in bare if rule_id in failed]
        facts.append(
            f"{', '.join(rules)}: {counted(len(unbranched), 'group')} without a branch, which the funnel counts; "
            "nothing happened there that an expert reacts to."
        )
    if _BANK in bare and alone:
        facts.append(
            f"{_BANK}: {counted(len(alone), 'group')} of a nominal alone, which breaks a rule that costs the group, so "
            "that the collector spent no replays on it."
        )
    return bare, facts


def _groups_of_one(pilot: Pilot) -> tuple[set[str], set[str]]:
    """Groups without a branch, and those with a branch whose nominal is their only rollout."""
    unbranched, alone = set(), set()
    for part in pilot.parts:
        view = part.view
        sizes = np.bincount(view.group, minlength=len(view.group_ids))
        has_branch = np.bincount(view.group, view.branched, minlength=len(view.group_ids)) > 0
        unbranched |= {view.group_ids[i] for i in np.flatnonzero((sizes > 0) & ~has_branch)}
        alone |= {view.group_ids[i] for i in np.flatnonzero((sizes == 1) & has_branch)}
    return unbranched, alone


def _groups(tally: Tally) -> set[str]:
    return {str(finding.location["group_id"]) for finding in tally.findings if "group_id" in finding.location}


def _costs(tally: Tally) -> bool:
    """Whether a failure costs the dataset its validity or groups their qualification."""
    return tally.info.decides or tally.info.kind == "qualification"


def _concern(tally: Tally) -> Concern:
    info = tally.info
    what = f"{info.id} ({info.title})"
    if info.grain != "dataset":
        what += f": {counted(tally.num_findings, 'violation')} in {counted(tally.examined, info.grain)}"
    what += "."
    if tally.findings:
        first = tally.findings[0]
        what += f" First at {location_text(first.location)}: expected {first.expected}; found {first.found}."
    return Concern(what, info.remedy, _costs(tally))


def _not_examined(tallies: tuple[Tally, ...]) -> list[str]:
    """Rules of claimed streams that had nothing to examine, by reason."""
    reasons: dict[str, list[str]] = {}
    for tally in tallies:
        if tally.status == "skipped" and tally.reason:
            reasons.setdefault(tally.reason, []).append(tally.rule_id)
    return [f"{', '.join(rule_ids)}: {reason}" for reason, rule_ids in reasons.items()]
