"""The report as workflow commands of GitHub Actions, which become annotations of a run.

One command a line: the verdict, one for every rule that failed, and one for every reason why rules could not be judged,
since a step shows ten errors and ten warnings at most. Escaping: `actions/toolkit`, packages/core/src/command.ts.
"""

from __future__ import annotations

from pathlib import PurePosixPath

from branchdrive.cli.formats.causes import remedy_text
from branchdrive.cli.formats.outcome import Level, failures, headline, refusals, summary, unjudged, verdict_level
from branchdrive.contract.text import printable
from branchdrive.engine.finding import location_text
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally

__all__ = ["render"]

_COMMANDS: dict[Level, str] = {"error": "error", "warning": "warning", "note": "notice"}


def render(report: Report) -> str:
    """Workflow commands, the verdict first."""
    verdict = "; ".join([headline(report), *refusals(report), *report.conditions])
    lines = [_command(_COMMANDS[verdict_level(report)], verdict, title=f"BranchDrive: {report.verdict}")]
    lines += [_of_rule(level, tally, report) for level, tally in failures(report)]
    lines += [_command("warning", reason, title="Not judged") for reason in unjudged(report)]
    lines += [_command("error", message, title="BranchDrive failed") for message in report.errors]
    return "".join(f"{line}\n" for line in lines)


def _of_rule(level: Level, tally: Tally, report: Report) -> str:
    """The annotation of a rule: how often it fails, its first finding, what to do, and its page."""
    info = tally.info
    parts = [f"{summary(tally)}."]
    title = info.broken if tally.status == "fail" else info.title
    properties = {"title": f"{info.id} {title}"}
    if tally.findings:
        first = tally.findings[0]
        parts.append(f"First at {location_text(first.location)}: expected {first.expected}, found {first.found}.")
        if "file" in first.location:
            properties["file"] = str(PurePosixPath(report.dataset.path, str(first.location["file"])))
    parts += [remedy_text(tally, report), info.explained]
    return _command(_COMMANDS[level], " ".join(parts), **properties)


def _command(name: str, message: str, **properties: str) -> str:
    """One command on one line, whatever its texts hold."""
    listed = ",".join(f"{key}={_property(value)}" for key, value in properties.items())
    return f"::{name} {listed}::{_data(message)}"


def _data(text: str) -> str:
    lines = [printable(line).replace("%", "%25") for line in text.split("\n")]
    return "%0A".join(lines)


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
