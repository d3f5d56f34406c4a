"""The report as SARIF 2.1.0, for code scanning and editors. Source: OASIS, Static Analysis Results Interchange Format.

A result is a finding, or a rule that decides and could not be judged, which is of the kind `open`. Each has a physical
location, because code scanning demands one: the file of the finding, else the descriptor, which stands for the whole
dataset; the logical location says where exactly.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any
from urllib.parse import quote as percent_encoded

from branchdrive.cli.formats.outcome import Level, headline, level_of, refusals, summary, verdict_level
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.contract.mismatch import Location
from branchdrive.contract.resources import project_url
from branchdrive.contract.rule import CATALOGUE, RuleInfo
from branchdrive.contract.text import printable
from branchdrive.engine.finding import Finding, location_text
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally

__all__ = ["render"]

_SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
_INDEX = {rule_id: i for i, rule_id in enumerate(CATALOGUE)}


def render(report: Report) -> str:
    """One run of one tool, with every rule of the catalogue."""
    run = {
        "tool": {
            "driver": {
                "name": "BranchDrive",
                "version": report.validator_version,
                **({"informationUri": url} if (url := project_url()) else {}),
                "rules": [_rule(info) for info in CATALOGUE.values()],
            }
        },
        "invocations": [_invocation(report)],
        "results": [result for tally in report.tallies for result in _results(tally, report)],
        "properties": {
            "verdict": report.verdict,
            "dataset": report.dataset.dataset_id,
            "identity": report.dataset.identity,
            "conditions": list(report.conditions),
        },
    }
    document = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _rule(info: RuleInfo) -> dict[str, Any]:
    default = "error" if info.decides else "note" if info.kind == "qualification" else "warning"
    return {
        "id": info.id,
        "shortDescription": {"text": info.title},
        "fullDescription": {"text": f"{info.title}. Clause: {info.clause}."},
        "help": {"text": info.remedy},
        **({"helpUri": info.url} if info.url else {}),
        "defaultConfiguration": {"level": default},
        "properties": {"kind": info.kind, "level": info.level, "grain": info.grain, "clause": info.clause},
    }


def _invocation(report: Report) -> dict[str, Any]:
    """How the run went; what is no finding is a notification: the verdict first, then rules without a judgement."""
    result = "; ".join([headline(report), *refusals(report)])
    notifications: list[dict[str, Any]] = [{"level": verdict_level(report), "message": {"text": result}}]
    notifications += [
        {
            "level": level_of(tally, report) or "none",
            "message": {"text": f"{tally.rule_id} {summary(tally)}"},
            "associatedRule": {"id": tally.rule_id, "index": _INDEX[tally.rule_id]},
        }
        for tally in report.tallies
        if tally.status not in ("pass", "fail")
    ]
    notifications += [{"level": "error", "message": {"text": message}} for message in report.errors]
    return {
        "executionSuccessful": report.verdict != "error",
        "exitCode": report.exit_code,
        "exitCodeDescription": headline(report),
        "toolExecutionNotifications": notifications,
    }


def _results(tally: Tally, report: Report) -> Iterator[dict[str, Any]]:
    level = level_of(tally, report)
    if level is None or (tally.status == "fail" and not tally.findings):
        return
    if tally.status != "fail":
        yield {
            **_identity(tally, {}),
            "kind": "open",
            "level": "none",
            "message": {"text": f"{tally.info.title}: not judged, {summary(tally)}"},
            "locations": [_location(report, {})],
        }
    for finding in tally.findings:
        yield _failure(tally, finding, level, report)


def _failure(tally: Tally, finding: Finding, level: Level, report: Report) -> dict[str, Any]:
    result = {
        **_identity(tally, finding.location),
        "kind": "fail",
        "level": level,
        "message": {"text": printable(f"{finding.message}. {finding.remedy}")},
        "locations": [_location(report, finding.location)],
        "properties": {"count": finding.count, "location": finding.location},
    }
    if finding.waived:
        result["suppressions"] = [{"kind": "external", "justification": _reasons(tally, report)}]
    return result


def _reasons(tally: Tally, report: Report) -> str:
    used = (o.waiver for o in report.waivers if o.state == "used" and o.waiver.rule == tally.rule_id)
    return "; ".join(f"{printable(w.reason)} (until {w.expires})" for w in used)


def _identity(tally: Tally, location: Location) -> dict[str, Any]:
    place = f"{tally.rule_id} {location_text(location)}"
    return {
        "ruleId": tally.rule_id,
        "ruleIndex": _INDEX[tally.rule_id],
        "partialFingerprints": {"place/v1": sha256(place.encode("utf-8", "surrogatepass")).hexdigest()},
    }


def _location(report: Report, location: Location) -> dict[str, Any]:
    """The file as a URI, relative where the dataset was named so, and the place in it."""
    file = Path(report.dataset.path, str(location.get("file", DESCRIPTOR_FILE)))
    encoded = percent_encoded(printable(file.as_posix()))
    return {
        "physicalLocation": {"artifactLocation": {"uri": f"file://{encoded}" if file.is_absolute() else encoded}},
        "logicalLocations": [{"fullyQualifiedName": printable(location_text(location))}],
    }
