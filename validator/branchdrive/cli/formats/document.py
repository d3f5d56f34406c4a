"""The report as JSON, as `schemas/v0.1/report.schema.json` has it."""

from __future__ import annotations

import json

from branchdrive.engine.report import Report

__all__ = ["render"]


def render(report: Report) -> str:
    """The whole report as one document."""
    return json.dumps(report.to_json(), indent=2, sort_keys=True, allow_nan=False) + "\n"
