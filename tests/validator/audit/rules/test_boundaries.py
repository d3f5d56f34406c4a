"""Shapes at the limit of what rules accept: nothing fails, and no group is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.mutation import BOUNDARIES, Boundary, new_draft

from branchdrive.audit.engine import validate


@pytest.mark.parametrize("boundary", BOUNDARIES, ids=lambda b: b.name)
def test_boundary_is_accepted(boundary: Boundary, tmp_path: Path) -> None:
    draft = new_draft(boundary.base)
    boundary.edit(draft)
    report = validate(draft.write(tmp_path / "dataset"))

    assert report.errors == ()
    assert [finding.message for finding in report.findings] == []
    assert (report.verdict, report.exit_code) == ("valid", 0)
    status = {tally.rule_id: tally.status for tally in report.tallies}
    assert {rule: status[rule] for rule in boundary.rules} == dict.fromkeys(boundary.rules, boundary.status)
    assert report.funnel is not None
    assert report.funnel.discovered
    assert report.funnel.lost.total() == 0
