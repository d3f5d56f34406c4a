"""Conformance of a pilot: the validator's verdict, and every rule that fails with its remedy."""

from __future__ import annotations

import numpy as np

from branchdrive.contract.text import counted
from branchdrive.engine.finding import location_text
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import EXIT_CODES
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section

__all__ = ["conformance"]


def conformance(pilot: Pilot) -> Section:
    """Verdict, rules that fail, and what no rule could look at."""
    report = pilot.report
    counts = {status: sum(tally.status == status for tally in report.tallies) for status in ("pass", "fail")}
    facts = [
        f"The validator's verdict is {report.verdict}: {counted(counts['pass'], 'rule')} hold on what is recorded, "
        f"{counts['fail']} fail.",
    ]
    if report.funnel is not None:
        facts.append(
            f"{report.funnel.qualified} of {counted(report.funnel.discovered, 'group')} qualify for a release."
        )
    unclaimed = [tally.rule_id for tally in report.tallies if tally.status == "not-claimed" and not tally.info.layer]
    if unclaimed:
        facts.append(f"The descriptor claims no stream of {', '.join(unclaimed)}, so that they examine nothing.")
    num_unbranched = _num_unbranched(pilot)
    bare = [t.rule_id for t in report.tallies if t.rule_id in _WITHOUT_BRANCH and 0 < t.num_findings == num_unbranched]
    if bare:
        facts.append(
            f"{', '.join(bare)}: {counted(num_unbranched, 'group')} without a branch, which the funnel counts; nothing "
            "else fails there."
        )
    explained = [tally.rule_id for tally in report.tallies if tally.num_findings and tally.rule_id in _EXPLAINED]
    facts += [f"{rule_id} fails: see {_EXPLAINED[rule_id]}." for rule_id in explained]
    concerns = [
        _concern(tally) for tally in report.tallies if tally.num_findings and tally.rule_id not in (*bare, *explained)
    ]
    concerns += [
        Concern(f"The validator itself failed: {message.splitlines()[-1]}", "Please report it.")
        for message in report.errors
    ]
    return Section(
        "conformance",
        "Conformance",
        facts,
        concerns,
        not_examined=_not_examined(report.tallies),
        figures={
            "verdict": report.verdict,
            "exit_code": EXIT_CODES[report.verdict],
            "rules": {tally.rule_id: tally.status for tally in report.tallies if tally.status not in _QUIET},
            "num_violations": {tally.rule_id: tally.num_findings for tally in report.tallies if tally.num_findings},
        },
    )


_QUIET = ("not-claimed", "skipped")

_EXPLAINED = {"BD-RSP-001": "Physics", **dict.fromkeys(("BD-RSP-002", "BD-RSP-003", "BD-RSP-004"), "Action response")}
"""Rules whose failure another section says more of."""


_WITHOUT_BRANCH = ("BD-TIC-003", "BD-BNK-001")
"""Rules that every seed without a branch fails, once."""


def _num_unbranched(pilot: Pilot) -> int:
    """Groups of which no attempt has a branch."""
    views = [part.view for part in pilot.parts]
    return sum(len(np.unique(view.group)) - len(np.unique(view.group[view.branched])) for view in views)


def _concern(tally: Tally) -> Concern:
    info = tally.info
    what = f"{info.id} ({info.title})"
    if info.grain != "dataset":
        what += f": {counted(tally.num_findings, 'violation')} in {counted(tally.examined, info.grain)}"
    what += "."
    if tally.findings:
        first = tally.findings[0]
        what += f" First at {location_text(first.location)}: expected {first.expected}; found {first.found}."
    return Concern(what, info.remedy, info.decides or info.kind == "qualification")


def _not_examined(tallies: tuple[Tally, ...]) -> list[str]:
    """Rules of claimed streams that had nothing to examine, by reason."""
    reasons: dict[str, list[str]] = {}
    for tally in tallies:
        if tally.status == "skipped" and tally.reason:
            reasons.setdefault(tally.reason, []).append(tally.rule_id)
    return [f"{', '.join(rule_ids)}: {reason}" for reason, rule_ids in reasons.items()]
