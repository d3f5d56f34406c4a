"""A rule that compared nothing is skipped, and never passes: whatever empties its subjects is no proof."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.mutation import new_draft
from tests.validator.engine.rules.case import judged
from tests.validator.engine.rules.empty_subjects import ALWAYS, EMPTIED, Emptied

from branchdrive.contract.rule import CATALOGUE


@pytest.mark.parametrize("emptied", EMPTIED.values(), ids=[*EMPTIED])
def test_rules_without_a_subject_are_skipped(emptied: Emptied, tmp_path: Path) -> None:
    draft = new_draft(emptied.base)
    emptied.edit(draft)
    report = judged(draft, tmp_path)

    assert report.errors == ()
    found = {tally.rule_id: (tally.status, tally.examined) for tally in report.tallies}
    assert {rule_id: found[rule_id] for rule_id in emptied.rules} == dict.fromkeys(emptied.rules, ("skipped", 0))


def test_every_rule_on_the_raw_layer_can_be_emptied_or_says_why_not() -> None:
    raw = {rule_id for rule_id, rule in CATALOGUE.items() if rule.layer is None}
    emptied = {rule_id for case in EMPTIED.values() for rule_id in case.rules}
    assert emptied | ALWAYS == raw
    assert not emptied & ALWAYS
