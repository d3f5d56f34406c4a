"""What a validator said of a case, held against what it must say."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from branchdrive_conformance.case import Case, Outcome

__all__ = ["Answer", "Departure", "score"]


@dataclass(frozen=True)
class Answer:
    """A validator's report, as far as it is compared.

    Attributes:
        verdict: The verdict.
        rules: Status, violations and listed locations by rule.
    """

    verdict: str
    rules: Mapping[str, Outcome]

    @classmethod
    def of(cls, report: Mapping[str, Any]) -> Answer:
        """From a report of the form of `report.schema.json`; members that are not compared may be absent.

        Raises:
            ValueError: The report lacks what is compared.
        """
        try:
            places: dict[str, list[Any]] = {}
            for finding in report["findings"]:
                places.setdefault(finding["rule"], []).append(finding["location"])
            rules = {
                rule["id"]: Outcome(rule["status"], rule["num_findings"], tuple(places.get(rule["id"], ())))
                for rule in report["rules"]
            }
            return cls(report["verdict"], rules)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"the report lacks {error}") from error


@dataclass(frozen=True)
class Departure:
    """Where an answer is not what is expected.

    Attributes:
        case: Name of the case.
        what: ``verdict``, ``status``, ``count``, ``location`` or ``no report``.
        rule: The rule, but for a verdict.
        expected: What the case expects.
        found: What was said.
    """

    case: str
    what: str
    rule: str | None
    expected: str
    found: str


def score(case: Case, answer: Answer, claimed: Collection[str], *, is_whole: bool) -> list[Departure]:
    """Departures of an answer, none where it is right.

    Args:
        case: The case.
        answer: What the validator said.
        claimed: Rules that the validator claims.
        is_whole: Whether it claims all rules. If not, its verdict is compared only where the case is invalid by
            a rule that it claims.
    """
    found = []
    failing = [rule for rule, outcome in case.expected.rules.items() if outcome.status == "fail"]
    is_decided = is_whole or (case.expected.verdict == "invalid" and set(case.rules) & set(claimed) & set(failing))
    if is_decided and answer.verdict != case.expected.verdict:
        found.append(Departure(case.name, "verdict", None, case.expected.verdict, answer.verdict))
    for rule, expected in case.expected.rules.items():
        if rule in claimed and rule not in case.expected.free:
            found += _of_rule(case.name, rule, expected, answer.rules.get(rule))
    return found


def _of_rule(case: str, rule: str, expected: Outcome, found: Outcome | None) -> list[Departure]:
    if found is None:
        return [Departure(case, "status", rule, expected.status, "no such rule in the report")]
    if found.status != expected.status:
        return [Departure(case, "status", rule, expected.status, found.status)]
    if expected.status != "fail":
        return []
    if found.violations != expected.violations:
        return [Departure(case, "count", rule, str(expected.violations), str(found.violations))]
    return _of_places(case, rule, expected, found.locations)


def _of_places(case: str, rule: str, expected: Outcome, found: Sequence[Mapping[str, Any]]) -> list[Departure]:
    """Every location must be listed; where the case lists only some, at least one."""
    missing = [place for place in expected.locations if not any(place.items() <= other.items() for other in found)]
    if not missing or (not expected.is_complete and len(missing) < len(expected.locations)):
        return []
    shown = "; ".join(map(_text, found[:3])) or "no location"
    return [Departure(case, "location", rule, _text(missing[0]), shown)]


def _text(location: Mapping[str, Any]) -> str:
    return " ".join(f"{key}={value}" for key, value in location.items()) or "the dataset"
