"""What follows from another failure says so, beside what it expects."""

from __future__ import annotations

import io
from pathlib import Path

from tests.mutation import Draft, new_draft

from branchdrive.cli.formats.table import renderer
from branchdrive.cli.text import render_report
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate


def _attempts(draft: Draft, group_id: str) -> list[str]:
    return [str(name) for name in draft.take("rollouts", group_id=group_id)["rollout_id"].to_pylist()]


def _causes(report: Report) -> dict[str, list[str]]:
    following = {rule_id: [cause for cause, _ in one.causes] for rule_id, one in report.causes.following.items()}
    return {tally.rule_id: following.get(tally.rule_id, []) for tally in report.tallies if tally.num_findings}


def test_evidence_of_a_group_with_a_wrong_unit_may_follow_from_it(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("observations", "speed_mps", lambda speed: 3.6 * speed, rollout_id=_attempts(draft, "g0"))
    report = validate(draft.write(tmp_path / "dataset"))
    found = _causes(report)
    assert "BD-MOT-006" in found
    assert found["BD-MOT-006"] == []
    assert found["BD-MOT-001"] == found["BD-MOT-003"] == found["BD-EVD-002"] == ["BD-MOT-006"]
    for text in (render_report(report, io.StringIO()), renderer("markdown")(report)):
        assert text.count("may follow from BD-MOT-006: look there first") == 4


def test_another_groups_motion_is_no_cause(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("observations", "speed_mps", lambda speed: 3.6 * speed, rollout_id=_attempts(draft, "g0"))
    draft.set("evidence", "separation_m", lambda gap: gap and gap + 1.0, rollout_id=_attempts(draft, "g1"))
    found = _causes(validate(draft.write(tmp_path / "dataset")))
    assert "BD-MOT-006" in found and found.get("BD-EVD-001") == []


def test_tables_may_lack_because_a_collection_is_not_finished(tmp_path: Path) -> None:
    root = new_draft().write(tmp_path / "dataset")
    (root / "MANIFEST.sha256").unlink()
    next(root.glob("raw/*/actors.parquet")).unlink()
    report = validate(root)
    assert _causes(report)["BD-TAB-004"] == ["BD-LAY-001"]
    assert "may follow from BD-LAY-001" in render_report(report, io.StringIO())
