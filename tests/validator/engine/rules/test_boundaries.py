"""Shapes at the limit of what rules accept: nothing fails, and no group is lost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.mutation import BOUNDARIES, Boundary, new_draft
from tests.sampling import THOROUGH
from tests.validator.engine.rules.case import INHERITED, RECOMMENDED, judged


def _parameters() -> Iterator[Any]:
    """Every boundary; `make test` judges the first of every rule, on a release and on a dataset that is none."""
    judged_on: dict[bool, set[str]] = {True: set(), False: set()}
    for boundary in BOUNDARIES:
        seen = judged_on[boundary.is_release]
        is_kept = not seen.issuperset(boundary.rules)
        seen.update(boundary.rules)
        yield pytest.param(boundary, id=boundary.name, marks=() if is_kept else THOROUGH)


@pytest.mark.parametrize("boundary", [*_parameters()])
def test_boundary_is_accepted(boundary: Boundary, tmp_path: Path) -> None:
    draft = new_draft(boundary.base)
    boundary.edit(draft)
    report = judged(draft, tmp_path)

    assert report.errors == ()
    accepted = (INHERITED if boundary.is_release else frozenset[str]()) | (RECOMMENDED - {*boundary.rules})
    assert [finding.message for finding in report.findings if finding.rule not in accepted] == []
    assert report.verdict == boundary.verdict
    status = {tally.rule_id: tally.status for tally in report.tallies}
    assert {rule: status[rule] for rule in boundary.rules} == dict.fromkeys(boundary.rules, boundary.status)
    if not boundary.is_release:
        assert report.exit_code == (0 if boundary.verdict == "valid" else 3)
        assert report.funnel is not None
        assert (report.funnel.discovered == 0) == (boundary.base == "drives")
        assert report.funnel.lost.total() == 0
