"""An identity that two shards hold costs the groups of both."""

from __future__ import annotations

from pathlib import Path

from tests.mutation import Draft, new_draft
from tests.validator.engine.rules.case import BRAKE, RECOMMENDED
from tests.validator.engine.rules.test_exclusion import failed, judge, misapply, report_of

from branchdrive.contract.columns import TICK_TABLES


def _renamed(draft: Draft, old: str, new: str) -> None:
    for table in ("rollouts", *TICK_TABLES):
        draft.set(table, "rollout_id", new, rollout_id=old)


def test_an_identity_in_two_shards_costs_both_groups(tmp_path: Path) -> None:
    """No row says which of the two attempts is meant, so that neither is examined further."""
    draft = new_draft()
    _renamed(draft, "g2.brake_0.50.a1", BRAKE)
    misapply(draft, BRAKE)
    report = report_of(draft, tmp_path)
    tallies = {tally.rule_id: tally for tally in report.tallies}
    assert failed(tallies).keys() - RECOMMENDED == {"BD-KEY-001"}
    assert failed(tallies)["BD-KEY-001"] == 1
    base = judge(new_draft(), tmp_path / "base")
    assert tallies["BD-CTL-008"].examined == base["BD-CTL-008"].examined - 2
    assert report.funnel is not None
    assert report.funnel.lost == {"bank": 2}
    assert report.funnel.reasons["bank"] == {"BD-KEY-001": 2}


def test_an_identity_in_two_shards_costs_nothing_where_another_attempt_stands_for_it(tmp_path: Path) -> None:
    draft = new_draft()
    draft.copy_attempt(BRAKE, "g0.brake_0.50.a2", attempt=2)
    _renamed(draft, "g2.brake_0.50.a1", BRAKE)
    funnel = report_of(draft, tmp_path).funnel
    assert funnel is not None
    assert funnel.reasons["bank"] == {"BD-KEY-001": 1}
    assert funnel.lost == {"bank": 1}


def test_a_group_in_two_shards_is_lost(tmp_path: Path) -> None:
    draft = new_draft()
    draft.copy_attempt(BRAKE, "g2.other", attempt=7)
    draft.set("rollouts", "group_id", "g2", rollout_id="g2.other")
    report = report_of(draft, tmp_path)
    assert {tally.rule_id for tally in report.tallies if tally.num_findings} >= {"BD-KEY-003"}
    assert report.funnel is not None
    assert report.funnel.reasons["bank"]["BD-KEY-003"] == 2
