"""Which groups qualify and what the others lack: the part of a report that a sender asks for first."""

from __future__ import annotations

from pathlib import Path

from tests.validator.engine import datasets

from branchdrive.cli.formats.outcome import also_in, folded
from branchdrive.contract.rule import CATALOGUE, cause_order
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_result import GroupResult
from branchdrive.engine.validate import validate
from branchdrive.raw.funnel import GroupOutcome


def test_every_group_is_listed_with_what_it_lacks(tmp_path: Path) -> None:
    tables = datasets.DEPARTURES["another command applied"].tables()
    report = validate(datasets.write(tmp_path / "dataset", tables))
    assert report.groups is not None and report.funnel is not None
    lost = [group for group in report.groups if not group.qualifies]
    assert sorted(group.group_id for group in report.groups) == ["g0", "g1", "g2"]
    assert len(report.groups) - len(lost) == report.funnel.qualified == 2
    (group,) = lost
    assert (group.stage, "BD-CTL-008" in group.rules or "BD-CTL-009" in group.rules) == ("Controls valid", True)
    assert group.reason == f"does not hold: {CATALOGUE[group.rules[0]].title}"
    assert report.to_json()["groups"] == [each.to_json() for each in report.groups]
    assert {each["id"]: each["qualifies"] for each in report.to_json()["groups"]}[group.group_id] is False


def test_a_group_without_a_branch_is_a_drive_on_which_nothing_happened(tmp_path: Path) -> None:
    outcome = GroupOutcome("g0", is_branched=False, lost_at="bank", rules=("BD-BNK-001",))
    assert "nothing happened" in GroupResult.of(outcome).reason


def test_causes_stand_before_what_follows_from_them() -> None:
    rules = ["BD-EVD-002", "BD-WIN-005", "BD-CTL-001", "BD-MOT-003", "BD-MOT-001", "BD-RSP-007", "BD-VAL-002"]
    ordered = sorted(rules, key=cause_order)
    assert ordered[:4] == ["BD-VAL-002", "BD-RSP-007", "BD-MOT-001", "BD-MOT-003"]
    assert ordered[-1] == "BD-EVD-002"
    assert GroupResult.of(GroupOutcome("g", True, "integrity", tuple(rules))).rules == tuple(ordered)


def test_findings_of_one_group_are_told_once() -> None:
    def finding(group: str, rollout: str, column: str = "x_m") -> Finding:
        return Finding("BD-MOT-001", {"group_id": group, "rollout_id": rollout, "column": column}, 1, "a", "b")

    found = [
        finding("g0", "r0"),
        finding("g0", "r1"),
        finding("g1", "r2"),
        finding("g0", "r3"),
        finding("g0", "r3", "y"),
    ]
    parts = folded(found)
    assert [len(part) for part in parts] == [3, 1, 1]
    assert [part[0] for part in parts] == [found[0], found[2], found[4]]
    assert [also_in(part) for part in parts] == [", and 2 more attempts of the group", "", ""]
    files = [Finding("BD-LAY-002", {"file": name}, 1, "a", "b") for name in "abc"]
    assert [len(part) for part in folded(files)] == [1, 1, 1]
