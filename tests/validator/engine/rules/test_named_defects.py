"""Seven ways to spoil a dataset that anybody thinks of first; each is named, placed and priced."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from tests.audits import validate_once
from tests.mutation import Draft, new_draft
from tests.synthetic import BRANCH_TICK, WINDOW_TICKS
from tests.validator.engine.rules.case import BRAKE, SHARD_0, SHARD_1, STEER_LEFT
from tests.validator.engine.rules.cases.controls import window_longer_by_a_tick

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.report import Report

CONTROLS = f"{SHARD_1}/controls.parquet"


def judge(draft: Draft, tmp_path: Path) -> Report:
    report = validate_once(draft.write(tmp_path / "dataset"))
    assert report.errors == ()
    assert not any("Traceback" in finding.message for finding in report.findings)
    return report


def finding_places(report: Report, rule: str) -> list[dict[str, Any]]:
    return [finding.location for finding in report.findings if finding.rule == rule]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_one_flipped_byte(share: float, tmp_path: Path) -> None:
    def flip(root: Path) -> None:
        content = bytearray((root / CONTROLS).read_bytes())
        content[round(share * (len(content) - 1))] ^= 0x40
        (root / CONTROLS).write_bytes(content)

    draft = new_draft()
    draft.after_seal(flip)
    report = judge(draft, tmp_path)
    assert finding_places(report, "BD-LAY-002") == [{"file": CONTROLS}]
    assert (report.verdict, report.exit_code) == ("invalid", 1)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_truncated_file(share: float, tmp_path: Path) -> None:
    draft = new_draft()
    draft.after_seal(lambda root: os.truncate(root / CONTROLS, int(share * (root / CONTROLS).stat().st_size)))
    report = judge(draft, tmp_path)
    assert {finding.rule for finding in report.findings} == {"BD-LAY-002"}
    assert finding_places(report, "BD-LAY-002") == [{"file": CONTROLS}]
    assert (report.verdict, report.exit_code) == ("invalid", 1)


@pytest.mark.parametrize("name", ["rollouts", "controls", "observations", "actors", "evidence"])
def test_removed_file(name: str, tmp_path: Path) -> None:
    draft = new_draft()
    draft.after_seal(lambda root: (root / SHARD_0 / f"{name}.parquet").unlink())
    report = judge(draft, tmp_path)
    assert {finding.rule for finding in report.findings} == {"BD-LAY-003"}
    assert finding_places(report, "BD-LAY-003") == [{"file": f"{SHARD_0}/{name}.parquet"}]
    assert (report.verdict, report.exit_code) == ("invalid", 1)


@pytest.mark.parametrize("path", ["../secret", "raw/../../secret", "/etc/passwd", "raw//x", "./x", "raw/./x", "c:/x"])
def test_path_that_leaves_the_root(path: str, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("outside")
    draft = new_draft()
    draft.edit_manifest(lambda text: f"{text}{'0' * 64}  {path}\n")
    report = judge(draft, tmp_path)
    assert {finding.rule for finding in report.findings} == {"BD-LAY-005"}
    assert finding_places(report, "BD-LAY-005") == [{"file": MANIFEST_FILE}]
    assert (report.verdict, report.exit_code) == ("invalid", 1)


@pytest.mark.parametrize(
    ("columns", "tick", "rule"),
    [
        (("applied_steer",), BRANCH_TICK, "BD-CTL-008"),
        (("intended_steer", "applied_steer"), BRANCH_TICK, "BD-CTL-006"),
        (("applied_steer",), BRANCH_TICK + WINDOW_TICKS + 5, "BD-CTL-009"),
        (("expert_steer",), BRANCH_TICK - 5, "BD-CTL-009"),
        (("nominal_steer",), BRANCH_TICK + 10, "BD-CTL-010"),
    ],
)
def test_one_negated_steering_value(columns: tuple[str, ...], tick: int, rule: str, tmp_path: Path) -> None:
    rollout_id = STEER_LEFT.replace("g0", "g1")  # group 1 drives a curve, so that every command has a sign
    draft = new_draft()
    assert draft.value("controls", columns[0], rollout_id=rollout_id, tick=tick)
    draft.set("controls", columns, lambda steer: -steer, rollout_id=rollout_id, tick=tick)
    report = judge(draft, tmp_path)
    (finding,) = report.findings
    assert finding.rule == rule
    assert finding.location == {"group_id": "g1", "rollout_id": rollout_id, "table": "controls", "tick": tick}
    assert (report.verdict, report.exit_code) == ("valid", 0)
    assert report.funnel is not None
    assert (report.funnel.lost, report.funnel.reasons["controls"]) == ({"controls": 1}, {rule: 1})


def test_intervention_longer_by_a_tick(tmp_path: Path) -> None:
    draft = new_draft()
    window_longer_by_a_tick(draft)
    report = judge(draft, tmp_path)
    assert {finding.rule for finding in report.findings} == {"BD-CTL-002", "BD-CTL-012"}
    (finding,) = (finding for finding in report.findings if finding.rule == "BD-CTL-002")
    assert (finding.expected, finding.found) == ("50 active ticks, 100 .. 149", "51 active ticks, 100 .. 150")
    assert finding.location["rollout_id"] == BRAKE
    assert (report.verdict, report.exit_code) == ("valid", 0)
    assert report.funnel is not None
    assert report.funnel.groups == {"discovered": 3, "bank": 3, "controls": 2, "integrity": 2, "eligibility": 2}


def test_ttc_of_999(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("evidence", "ttc_s", 999.0, rollout_id=BRAKE, tick=BRANCH_TICK)
    report = judge(draft, tmp_path)
    (finding,) = report.findings
    assert (finding.rule, finding.found) == ("BD-NUL-005", "999.0")
    assert finding.location["rollout_id"] == BRAKE
    assert finding.location["tick"] == BRANCH_TICK
    assert (report.verdict, report.exit_code) == ("invalid", 1)


def test_required_groups_turn_a_lost_group_into_exit_code_1(tmp_path: Path) -> None:
    draft = new_draft()
    window_longer_by_a_tick(draft)
    report = validate_once(draft.write(tmp_path / "dataset"), require_groups=3)
    assert (report.verdict, report.exit_code) == ("valid", 1)
