"""What is wrong in a group, as the player shows it: rules that it fails, and where, in candidates and times.

Whether a group fails a rule is what the validator says. Where it does is told by findings of the validator, and by
those of the shard of the group, see `branchdrive_reference.report.judgement`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from branchdrive.cli.formats.outcome import Level, failures
from branchdrive.contract.rule import CATALOGUE, RuleInfo, cause_order
from branchdrive.contract.text import counted, printable
from branchdrive.engine.finding import Finding
from branchdrive.engine.relation import SIBLINGS
from branchdrive.engine.report import Report
from branchdrive.text.brief import brief
from branchdrive_reference.report.judgement import Judgement
from branchdrive_reference.report.scene import Scene
from branchdrive_reference.study.label import label

__all__ = ["Fault", "Faults", "Spot"]

_MOST_SPOTS = 16
"""Places of a rule in a group."""

_MOST_TEXTS = 4
"""Of what was expected and found in them those that are told."""


class Spot(NamedTuple):
    """One place where a rule does not hold.

    Attributes:
        finding: What was found there.
        future: Place of the candidate among the futures of the scene, -1 where none of them is it.
        tick: Since the branch; ``None`` where it is about no tick, or the attempt has no branch.
        actor_id: ``None`` where it is about no actor.
        attempt: Which attempt it is, in words; empty where a future is it.
    """

    finding: Finding
    future: int
    tick: int | None
    actor_id: int | None
    attempt: str


class Fault(NamedTuple):
    """A rule that a group fails.

    Attributes:
        info: The rule.
        extent: How many of its attempts do, in words; empty where it is about no single ones.
        causes: Rules that fail too, and may be why.
        futures: Places of the candidates that are known to.
        spots: Where.
    """

    info: RuleInfo
    extent: str
    causes: Sequence[str]
    futures: Sequence[int]
    spots: Sequence[Spot]

    def to_json(self) -> dict[str, Any]:
        """As the player reads it: what is said of spots stands once, -1 of a spot that says more than there is room."""
        said = [_said(spot.finding) for spot in self.spots]
        texts, about = [*dict.fromkeys(said)][:_MOST_TEXTS], [_column(spot.finding) for spot in self.spots]
        columns = [*dict.fromkeys(about)]
        spots = [
            [
                spot.future, spot.tick, spot.actor_id, spot.attempt, spot.finding.count,
                texts.index(text) if text in texts else -1, columns.index(column),
            ]
            for spot, text, column in zip(self.spots, said, about, strict=True)
        ]  # fmt: skip
        return {
            "rule": self.info.id,
            "extent": self.extent,
            "causes": list(self.causes),
            "futures": list(self.futures),
            "texts": texts,
            "columns": columns,
            "spots": spots,
        }


class Faults:
    """What a report of the validator says of single groups.

    Args:
        report: The report.
    """

    def __init__(self, report: Report) -> None:
        self._report = report
        self.levels: dict[str, Level] = {tally.rule_id: level for level, tally in failures(report)}
        self._numbers = {
            printable(outcome.group_id[:128]): dict(outcome.failed)
            for outcome in (() if report.funnel is None else report.funnel.outcomes)
        }
        self._kept: dict[str, dict[str, list[Finding]]] = {}
        for finding in report.findings:
            if finding.group_id is not None:
                self._kept.setdefault(finding.group_id, {}).setdefault(finding.rule, []).append(finding)

    def rules_of(self, group_id: str) -> list[str]:
        """Rules that a group or attempts of it fail, causes before their consequences."""
        name = printable(group_id[:128])
        found = {*self._numbers.get(name, ()), *self._kept.get(name, ())}
        return sorted(found & self.levels.keys(), key=cause_order)

    def of(
        self, scene: Scene, records: Sequence[Mapping[str, Any]], rows: Sequence[int], judgement: Judgement | None
    ) -> list[Fault]:
        """What is wrong in a group.

        Args:
            scene: The group.
            records: Rows of the rollouts table of its shard.
            rows: Those of the group.
            judgement: What the rules say of the shard; ``None`` where they cannot judge it.
        """
        name, rules = printable(scene.group_id[:128]), self.rules_of(scene.group_id)
        own = self._findings(name, judgement)
        places_of = {_printed(records[row]["rollout_id"]): row for row in reversed(rows)}
        attempts = {who: records[row] for who, row in places_of.items()}
        places = {_printed(future.rollout_id): place for place, future in enumerate(scene.futures)}
        found = []
        for rule_id in rules:
            spots = _spots(own.get(rule_id, ()), scene, places, attempts)
            futures = {spot.future for spot in spots} - {-1}
            if judgement is not None and rule_id in judgement.failed:
                failed = judgement.failed[rule_id]
                futures |= {place for who, place in places.items() if failed[places_of[who]]}
            number = self._numbers.get(name, {}).get(rule_id, 0)
            extent = f"{number:,} of {counted(len(rows), 'attempt')}" if number else ""
            found.append(Fault(CATALOGUE[rule_id], extent, self._causes(rule_id, rules), sorted(futures), spots))
        return found

    def marks(self, group_id: str, judgement: Judgement | None) -> dict[str, int]:
        """First tick that a finding names of each attempt of a group, by its identity, printed."""
        ticks: dict[str, int] = {}
        own = self._findings(printable(group_id[:128]), judgement)
        for rule_id in self.rules_of(group_id):
            for finding in own.get(rule_id, ()):
                if "tick" in finding.location and "rollout_id" in finding.location:
                    who, tick = str(finding.location["rollout_id"]), int(finding.location["tick"])
                    ticks[who] = min(tick, ticks.get(who, tick))
        return ticks

    def _findings(self, name: str, judgement: Judgement | None) -> dict[str, Sequence[Finding]]:
        """Findings of a group by rule: those of its shard, and of other rules those that the report keeps."""
        own = {} if judgement is None else judgement.findings.get(name, {})
        return {**self._kept.get(name, {}), **{rule: found for rule, found in own.items() if found}}

    def _causes(self, rule_id: str, rules: Sequence[str]) -> list[str]:
        """Rules that a rule may follow from, of those that the group fails and those on the whole dataset."""
        following = self._report.causes.following
        named = (cause for cause, _ in following[rule_id].causes) if rule_id in following else ()
        here = [cause for cause in named if cause in rules or CATALOGUE[cause].scope == "dataset"]
        return [cause for cause in here if cause not in SIBLINGS]


def _printed(rollout_id: object) -> str:
    """The identity of an attempt as locations have it."""
    return printable(str(rollout_id)[:500])[:500]


def _spots(
    findings: Sequence[Finding], scene: Scene, places: Mapping[str, int], attempts: Mapping[str, Mapping[str, Any]]
) -> list[Spot]:
    """Places of findings of a rule: one of each attempt before the second of any, those of candidates first."""
    seen: Counter[object] = Counter()
    order = []
    for finding in findings:
        who = str(finding.location.get("rollout_id", ""))
        order.append((seen[who], places.get(who, len(places))))
        seen[who] += 1
    chosen = sorted(range(len(findings)), key=order.__getitem__)[:_MOST_SPOTS]
    return [_spot(findings[place], scene, places, attempts) for place in chosen]


def _spot(finding: Finding, scene: Scene, places: Mapping[str, int], attempts: Mapping[str, Mapping[str, Any]]) -> Spot:
    about, who = finding.location, str(finding.location.get("rollout_id", ""))
    future, record = places.get(who, -1), attempts.get(who)
    branch_tick: int | None = None if record is None else record["branch_tick"]
    if scene.futures:
        branch_tick = scene.futures[max(future, 0)].branch_tick
    tick = int(about["tick"]) - branch_tick if "tick" in about and branch_tick is not None else None
    actor_id = int(about["actor_id"]) if "actor_id" in about else None
    return Spot(finding, future, tick, actor_id, "" if future >= 0 else _attempt(record, about))


def _attempt(record: Mapping[str, Any] | None, about: Mapping[str, Any]) -> str:
    """Which attempt a finding is about, in words."""
    if record is None:
        return _words(str(about["action_key"])) if "action_key" in about else "the group as a whole"
    key = "replay of the nominal" if record["role"] == "nominal_replay" else _words(str(record["action_key"]))
    return f"{key}, attempt {record['attempt']}"


def _words(action_key: str) -> str:
    return label(action_key).replace("_", " ")


def _column(finding: Finding) -> str:
    """Which column or table a finding is about, in words; empty where it is about none."""
    return " of ".join(label(str(finding.location[part])) for part in ("column", "table") if part in finding.location)


def _said(finding: Finding) -> str:
    """What a finding says, without the place."""
    where = _column(finding)
    (said,) = brief(f"expected {finding.expected}, found {finding.found}")
    return f"{where}: {said}" if where else said
