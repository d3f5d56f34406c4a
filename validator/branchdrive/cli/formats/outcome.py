"""What a report means to who looks at it: how grave each rule's result is, and the verdict in words.

Every form takes its colours from here, so that none shows green what is not `valid`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple, Self

from branchdrive.cli.formats.causes import CauseText, cause_texts, causes_text, remedy_text, violations
from branchdrive.cli.formats.where import further_text
from branchdrive.cli.funnel import NO_GROUPS
from branchdrive.contract.rule import RuleInfo, cause_order
from branchdrive.contract.text import counted
from branchdrive.engine.finding import Finding, location_text
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import Verdict, is_waived
from branchdrive.engine.waiver import Waiver, WaiverOutcome
from branchdrive.text.brief import brief

__all__ = [
    "MEANING", "RULE_EXPLAINED", "Failure", "Level", "Outcome", "Place", "also_in", "cautions", "failures",
    "files_text", "folded", "headline", "level_of", "more_text", "refusals", "sizes", "summary", "unjudged",
    "verdict_level", "waiver_text", "with_companions",
]  # fmt: skip

Level = Literal["error", "warning", "note"]

_RULES_SHOWN = 12

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?(?!\w|\.\d)")
"""A number that is no part of a name."""

_ABOUT = ("table", "column", "camera", "action_key")
"""Parts of a place that findings which say the same have in common."""

RULE_EXPLAINED = "`branchdrive rules ID` explains a rule: why it is, its clauses, an example, and what to do"
"""How a reader of a report comes to the page of a rule."""

MEANING: Mapping[Verdict, str] = MappingProxyType(
    {
        "valid": "the dataset conforms to the specification",
        "valid-with-waivers": "it conforms except where a waiver accepts that it does not",
        "partial": "what was judged conforms to the specification, but not everything was judged",
        "invalid": "the dataset breaks the specification",
        "error": "the validator itself failed; this says nothing about the dataset",
    }
)

_VERDICT_LEVEL: Mapping[Verdict, Level] = MappingProxyType(
    {"valid": "note", "valid-with-waivers": "warning", "partial": "warning", "invalid": "error", "error": "error"}
)


_HEADS: Mapping[Level, str] = MappingProxyType(
    {
        "error": "What is wrong",
        "warning": "What is not as recommended",
        "note": "Why attempts and groups do not qualify, and what is waived",
    }
)


class Place(NamedTuple):
    """Where a rule does not hold.

    Attributes:
        findings: The findings that it stands for.
        where: Its location.
        more: What else the finding stands for, to stand behind it.
        expected: What was expected.
        found: What was found.
    """

    findings: tuple[Finding, ...]
    where: str
    more: str
    expected: str
    found: str


class Failure(NamedTuple):
    """A rule that failed, or that the tool failed at.

    Attributes:
        info: The rule.
        is_error: Whether the tool failed at it.
        summary: What became of it.
        places: The first places, those that say the same together.
        num_left: Violations at no place of these.
        follows: How far it may follow from other rules, in words; empty where it does not.
        remedy: What to do; empty where it is waived.
    """

    info: RuleInfo
    is_error: bool
    summary: str
    places: tuple[Place, ...]
    num_left: int
    follows: str
    remedy: str


@dataclass(frozen=True)
class Outcome:
    """What a page says of a report.

    Attributes:
        level: How grave the verdict is.
        headline: The verdict, what it means, and how many groups qualify.
        sizes: How many groups and rollouts there are.
        companions: How many names beside the dataset were not looked at, to stand behind what it holds.
        refusals: What the caller's own demands refuse.
        cautions: What the verdict does not say, and a reader may take it to say.
        causes: What to look at first, in words.
        sections: Rules that failed by how grave that is, the gravest first, each with a head.
        unjudged: What kept rules from a judgement.
        waivers: Each waiver with what became of it.
    """

    level: Level
    headline: str
    sizes: str
    companions: str
    refusals: tuple[str, ...]
    cautions: tuple[str, ...]
    causes: tuple[CauseText, ...]
    sections: tuple[tuple[Level, str, tuple[Failure, ...]], ...]
    unjudged: tuple[str, ...]
    waivers: tuple[tuple[Waiver, str], ...]

    @classmethod
    def of(cls, report: Report, num_places: int) -> Self:
        """What is said of a report, with so many places of a rule at most."""
        found: dict[Level, list[Failure]] = {level: [] for level in _HEADS}
        for level, tally in failures(report):
            found[level].append(_failure(tally, report, num_places))
        return cls(
            verdict_level(report),
            headline(report),
            sizes(report),
            with_companions(report),
            tuple(refusals(report)),
            tuple(cautions(report)),
            tuple(cause_texts(report)),
            tuple((level, _HEADS[level], tuple(rules)) for level, rules in found.items() if rules),
            tuple(unjudged(report)),
            tuple((outcome.waiver, waiver_text(outcome, report)) for outcome in report.waivers),
        )


def _failure(tally: Tally, report: Report, num_places: int) -> Failure:
    parts, has_failed = folded(tally.findings)[:num_places], tally.status == "fail"
    left = tally.num_findings - sum(map(tally.places, parts))
    return Failure(
        tally.info,
        not has_failed,
        summary(tally),
        tuple(map(_place, parts)),
        left if tally.findings else 0,
        causes_text(tally, report) if has_failed else "",
        remedy_text(tally, report) if has_failed and not is_waived(tally) else "",
    )


def _place(part: tuple[Finding, ...]) -> Place:
    finding = part[0]
    return Place(part, location_text(finding.location), more_text(part), *brief(finding.expected, finding.found))


def more_text(part: Sequence[Finding]) -> str:
    """What findings stand for beside the location of the first, to stand behind it."""
    extent = further_text(part[0])
    return (f" ({extent})" if extent else "") + also_in(part)


def headline(report: Report) -> str:
    """The verdict, what it means, and how many groups qualify."""
    qualified = ""
    if report.is_of_drives:
        qualified = f"; {NO_GROUPS}"
    elif report.num_qualified is not None and report.verdict != "error":
        num_groups = report.dataset.num_groups if report.num_groups is None else report.num_groups
        verb = "qualifies" if num_groups == 1 else "qualify"
        qualified = f"; {report.num_qualified:,} of {counted(num_groups, 'group')} {verb}"
    return f"{report.verdict} - {MEANING[report.verdict]}{qualified}"


def sizes(report: Report) -> str:
    """How many groups and rollouts there are; of a release without its raw layer, the groups that it claims."""
    facts = report.dataset
    if not facts.num_shards and report.num_groups is not None:
        return f"{counted(report.num_groups, 'branch group')} as the release claims; no raw layer to count rollouts in"
    return f"{counted(facts.num_groups, 'branch group')}, {counted(facts.num_rollouts, 'rollout')}"


def files_text(report: Report) -> str:
    """How many files there are, and whether the manifest is one more than those that it lists."""
    found = counted(report.dataset.num_files, "file")
    listed = next((tally.examined for tally in report.tallies if tally.rule_id == "BD-LAY-002"), 0)
    return f"{found} with the manifest" if listed and report.dataset.num_files == listed + 1 else found


def verdict_level(report: Report) -> Level:
    """How grave the verdict is.

    Where the exit code refuses a valid dataset it is as grave as of an invalid one, and a warning where none of its
    groups can be used.
    """
    if refusals(report):
        return "error"
    level = _VERDICT_LEVEL[report.verdict]
    return "warning" if level == "note" and cautions(report) else level


def cautions(report: Report) -> list[str]:
    """What the verdict does not say, and a reader may take it to say, one sentence each."""
    is_accepted = report.exit_code == 0 and not report.is_of_drives
    if not is_accepted or report.num_qualified != 0 or report.options.require_groups is not None:
        return []
    return [
        "No branch group qualifies: the files are as they must be, and none of the groups in them can be used. "
        "The exit code says nothing of that; with `--require-groups N` it is 1 where fewer than N groups qualify."
    ]


def refusals(report: Report) -> list[str]:
    """What the caller's own demands refuse, one sentence each."""
    refused = []
    if report.lacks_groups:
        found = report.num_qualified or 0
        refused.append(f"{found} of {report.options.require_groups} required branch groups qualify")
    if report.options.is_strict and report.noted:
        failed = ", ".join(tally.rule_id for tally in report.noted)
        refused.append(f"--strict refuses what these diagnostics and recommendations found: {failed}")
    return refused


def level_of(tally: Tally, report: Report) -> Level | None:
    """How grave the result of a rule is; ``None`` where there is nothing to say of it.

    An error is what fails a dataset or the tool, or what `--strict` refuses. A warning is what keeps a verdict from
    being `valid` without making it `invalid`, and what a diagnostic or a recommendation found. A note is what a waiver
    covers, and why attempts and groups do not qualify.
    """
    info = tally.info
    match tally.status:
        case "error":
            return "error"
        case "fail" if info.decides:
            return "note" if is_waived(tally) else "error"
        case "fail" if info.kind == "qualification":
            return "note"
        case "fail":
            return "error" if report.options.is_strict else "warning"
        case "inconclusive":
            return "warning"
        case _:
            return "warning" if tally.is_claimed and tally.unjudged and info.decides else None


def failures(report: Report) -> list[tuple[Level, Tally]]:
    """Rules that failed, or that the tool failed at, the gravest first, then causes before their consequences."""
    order = ("error", "warning", "note")
    found = [
        (level, tally)
        for tally in report.tallies
        if tally.status in ("fail", "error") and (level := level_of(tally, report))
    ]
    return sorted(found, key=lambda item: (order.index(item[0]), cause_order(item[1].rule_id)))


def folded(findings: Sequence[Finding]) -> list[tuple[Finding, ...]]:
    """Findings of a rule, those that say the same together, in the order of the first of each.

    Attempts of one group are shown once for each table and column, and groups once of which the first findings differ
    in numbers alone. Each table and column comes before the second place of one that was shown.
    """
    of_groups: dict[object, list[Finding]] = {}
    for place, finding in enumerate(findings):
        about = finding.location
        said: object = place
        if "rollout_id" in about and finding.group_id is not None:
            said = (finding.group_id, about.get("table"), about.get("column"))
        of_groups.setdefault(said, []).append(finding)
    parts: dict[object, list[Finding]] = {}
    for place, found in enumerate(of_groups.values()):
        parts.setdefault(place if found[0].group_id is None else _wording(found[0]), []).extend(found)
    shown: Counter[object] = Counter()
    rounds = []
    for part in parts.values():
        column = part[0].location.get("table"), part[0].location.get("column")
        rounds.append(shown[column])
        shown[column] += 1
    order = sorted(range(len(rounds)), key=rounds.__getitem__)
    every = [tuple(part) for part in parts.values()]
    return [every[place] for place in order]


def _wording(finding: Finding) -> tuple[object, ...]:
    """What a finding on a group or an attempt of it says, whichever it is and whatever the numbers are."""
    about = finding.location
    said = (_NUMBER.sub("#", text) for text in (finding.expected, finding.found))
    return ("rollout_id" in about, *(about.get(part) for part in _ABOUT), *said)


def also_in(part: Sequence[Finding]) -> str:
    """How many attempts, or groups, the first finding stands for beside its own, to stand behind it."""
    if len(part) < 2:
        return ""
    if "rollout_id" not in part[0].location:
        return f", and {counted(len(part) - 1, 'more group')}"
    groups = {finding.group_id for finding in part}
    where = "of the group" if len(groups) == 1 else f"in {counted(len(groups), 'group')}"
    return f", and {counted(len(part) - 1, 'more attempt')} {where}"


def waiver_text(outcome: WaiverOutcome, report: Report) -> str:
    """What became of a waiver; of one that covers nothing, with what its glob was compared."""
    waiver = outcome.waiver
    use = f"{outcome.state}, {outcome.num_matched} of at most {waiver.max_count}, until {waiver.expires}"
    if outcome.num_matched:
        return use
    found = next((tally.findings for tally in report.tallies if tally.rule_id == waiver.rule), [])
    if not found:
        return f"{use}; the rule has no finding"
    first = location_text(found[0].location)
    return f"{use}; compared with {counted(len(found), 'location')}, the first of them {first}"


def unjudged(report: Report) -> list[str]:
    """What kept rules from a judgement that a verdict rests on, each with the rules, one sentence each."""
    rules: dict[str, list[str]] = {}
    for tally in report.tallies:
        if tally.status not in ("fail", "error") and level_of(tally, report):
            rules.setdefault(summary(tally), []).append(tally.rule_id)
    return [f"{counted(len(ids), 'rule')} {why} - {_listed(ids)}" for why, ids in rules.items()]


def _listed(rule_ids: list[str]) -> str:
    more = f" and {len(rule_ids) - _RULES_SHOWN} more" if len(rule_ids) > _RULES_SHOWN else ""
    return ", ".join(rule_ids[:_RULES_SHOWN]) + more


def summary(tally: Tally) -> str:
    """What became of a rule, in a few words."""
    if tally.status == "fail":
        waived = ", waived" if is_waived(tally) else ""
        return f"{violations(tally)}{waived}"
    return tally.status if tally.reason is None else f"{tally.status}: {tally.reason}"


def with_companions(report: Report) -> str:
    """How many names beside the dataset were not looked at, to be put behind what it holds; empty if none."""
    number = report.dataset.num_beside
    return f", {counted(number, 'companion')} not looked at" if number else ""
