"""Rows of derived layers are judged alike as a whole and part by part."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.mutation import MUTANTS, new_draft
from tests.sampling import sampled
from tests.validator.engine.rules.case import Mutant, judged_folder
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.contract.rule import CATALOGUE, rules_of

ROWS = frozenset(rules_of("layer_rows"))

FIRST = {mutant.rule: mutant for mutant in reversed(MUTANTS) if mutant.rule in ROWS}
"""A defect of every rule on rows of derived layers."""


def outcome(report: Any) -> tuple[Any, ...]:
    """What a report says, in an order of its own."""
    rules = {t.rule_id: (t.status, t.reason, t.examined, t.total, t.num_findings) for t in report.tallies}
    findings = sorted(repr((f.rule, f.location, f.count, f.expected, f.found)) for f in report.findings)
    return report.verdict, rules, findings, report.population


@pytest.mark.parametrize("mutant", sampled(FIRST.values(), every=12), ids=FIRST)
def test_parts_add_up_to_the_whole(mutant: Mutant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft = new_draft(mutant.base)
    mutant.edit(draft)
    root = draft.write(tmp_path / "dataset")
    raw = draft.raw_root(root) if isinstance(draft, ReleaseDraft) else None
    reports = []
    for max_groups in (10**9, -1):
        monkeypatch.setattr("branchdrive.engine.derived.MAX_GROUPS_AT_ONCE", max_groups)
        reports.append(judged_folder(root, raw=raw))
    whole, parts = map(outcome, reports)
    assert parts == whole
    assert whole[1][mutant.rule][0] == "fail"


def test_every_rule_on_rows_has_a_defect() -> None:
    assert FIRST.keys() == ROWS
    assert all(CATALOGUE[rule_id].layer for rule_id in ROWS)
