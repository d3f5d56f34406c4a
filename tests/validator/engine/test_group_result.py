"""Which groups qualify and what the others lack: the part of a report that a sender asks for first."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.audits import validate_once
from tests.mutation import new_draft
from tests.validator.engine import datasets

from branchdrive.cli.formats.outcome import also_in, folded
from branchdrive.cli.funnel import funnel_table
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.rule import CATALOGUE, cause_order
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_result import GroupResult
from branchdrive.raw.funnel import Funnel, GroupOutcome


def test_every_group_is_listed_with_what_it_lacks(tmp_path: Path) -> None:
    tables = datasets.DEPARTURES["another command applied"].tables()
    report = validate_once(datasets.write(tmp_path / "dataset", tables))
    assert report.groups is not None and report.funnel is not None
    lost = [group for group in report.groups if not group.qualifies]
    assert sorted(group.group_id for group in report.groups) == ["g0", "g1", "g2"]
    assert len(report.groups) - len(lost) == report.funnel.qualified == 2
    (group,) = lost
    assert (group.stage, "BD-CTL-008" in group.rules or "BD-CTL-009" in group.rules) == ("Controls valid", True)
    first = next(finding for finding in report.findings if finding.rule == group.rules[0])
    assert group.reason == (
        f"does not hold: {CATALOGUE[group.rules[0]].title}: expected {first.expected}, found {first.found}"
    )
    assert report.to_json()["groups"] == [each.to_json() for each in report.groups]
    assert {each["id"]: each["qualifies"] for each in report.to_json()["groups"]}[group.group_id] is False


def test_a_group_without_a_branch_is_a_drive_on_which_nothing_happened(tmp_path: Path) -> None:
    outcome = GroupOutcome("g0", is_branched=False, lost_at="bank", rules=("BD-BNK-001",))
    assert "nothing happened" in GroupResult.of(outcome).reason


def test_a_group_without_an_action_says_which(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("rollouts", "status", "partial", rollout_id="g0.brake_1.00.a1")
    draft.set("rollouts", "status_reason", "out of fuel", rollout_id="g0.brake_1.00.a1")
    report = validate_once(draft.write(tmp_path / "dataset"))
    (reason,) = (group.reason for group in report.groups or () if not group.qualifies)
    assert reason.endswith(", found no complete attempt of brake_1.00")


def test_findings_on_rows_tell_the_reason_of_their_group(tmp_path: Path) -> None:
    report = validate_once(datasets.write(tmp_path / "dataset", datasets.DEPARTURES["speed out of range"].tables()))
    (reason,) = (group.reason for group in report.groups or () if not group.qualifies)
    assert reason.startswith("does not hold: Values lie in their declared range, in speed_mps: expected ")
    assert reason.endswith(", found 1000.0")
    assert all("group_id" not in finding["location"] for finding in report.to_json()["findings"])


def test_a_group_that_repeats_another_is_said_to_whatever_it_lacks() -> None:
    outcome = GroupOutcome("g1", True, "eligibility", ("BD-TRG-001",))
    copy = Finding("BD-RSP-015", {}, 1, "ways that no other group has", "those of group 'g0'", group_id="g1")
    lacked = Finding("BD-TRG-001", {"rollout_id": "r"}, 1, "'r1'", "'r0'", group_id="g1")
    result = GroupResult.of(outcome, {("g1", "BD-RSP-015"): copy, ("g1", "BD-TRG-001"): lacked})
    assert result.reason == (
        "repeats another group, those of group 'g0'; does not hold: Trigger evidence comes from the rollout's nominal "
        "alone: expected 'r1', found 'r0'"
    )


@pytest.mark.parametrize(
    ("jump", "first_other", "said"),
    [
        ((5, 1), 5, "its observations may be late against its actors"),
        ((260, 1), 260, "the ego from tick 260 on may be of another drive"),
        ((260, 1), 200, None),  # evidence was wrong before the jump
        ((260, 7), 260, None),  # speed or heading is wrong, not one step
    ],
)
def test_a_jump_from_which_on_the_ego_does_not_fit_its_actors_is_explained(
    jump: tuple[int, int], first_other: int, said: str | None
) -> None:
    found = {
        ("g1", "BD-MOT-001"): Finding("BD-MOT-001", {"tick": jump[0]}, jump[1], "a", "b", group_id="g1"),
        ("g1", "BD-EVD-001"): Finding("BD-EVD-001", {"tick": first_other}, 60, "a", "b", group_id="g1"),
    }
    reason = GroupResult.of(GroupOutcome("g1", True, "integrity", ("BD-MOT-001", "BD-EVD-001")), found).reason
    assert reason.startswith(said or "does not hold: Displacements agree with speeds and headings")


def test_reasons_of_the_funnel_stand_causes_first() -> None:
    funnel = Funnel(3)
    funnel.lost["integrity"] = 3
    counts = {"BD-EVD-001": 3, "BD-EVD-002": 3, "BD-EVD-003": 3, "BD-WIN-005": 3, "BD-MOT-001": 1, "BD-MOT-006": 1}
    funnel.reasons["integrity"].update({**counts, "BD-BOX-001": 1, "BD-MOT-003": 2})
    (row,) = (row for row in funnel_table(funnel).rows if row[3])
    assert row[3] == (
        "BD-MOT-006 (1), BD-MOT-001 (1), BD-MOT-003 (2), BD-BOX-001 (1), BD-WIN-005 (3), BD-EVD-001 (3) and 2 more"
    )


def test_causes_stand_before_what_follows_from_them() -> None:
    rules = [
        "BD-EVD-002", "BD-WIN-005", "BD-CTL-001", "BD-MOT-003", "BD-MOT-006", "BD-MOT-001", "BD-RSP-007", "BD-VAL-002",
        "BD-GRP-009",
    ]  # fmt: skip
    ordered = sorted(rules, key=cause_order)
    assert ordered[:6] == ["BD-VAL-002", "BD-RSP-007", "BD-GRP-009", "BD-MOT-006", "BD-MOT-001", "BD-MOT-003"]
    assert ordered[-1] == "BD-EVD-002"
    assert GroupResult.of(GroupOutcome("g", True, "integrity", tuple(rules))).rules == tuple(ordered)


def test_findings_that_say_the_same_are_told_once() -> None:
    def finding(group: str, rollout: str, column: str = "x_m", found: str = "1.5 m") -> Finding:
        where: Location = {"group_id": group, "rollout_id": rollout, "column": column}
        return Finding.of("BD-MOT-001", Mismatch(where, "0 m", found))

    found = [
        finding("g0", "r0"),
        finding("g0", "r1", found="no number"),  # of one group one is told
        finding("g1", "r2", found="-3.25e-05 m"),
        finding("g2", "r4", found="no number"),
        finding("g0", "r3", "y_m"),
    ]
    parts = folded(found)
    assert parts == [(found[0], found[1], found[2]), (found[4],), (found[3],)]  # another column before another text
    assert [also_in(part) for part in parts] == [", and 2 more attempts in 2 groups", "", ""]
    assert also_in(found[:2]) == ", and 1 more attempt of the group"
    files = [Finding("BD-LAY-002", {"file": name}, 1, "a", "b") for name in "abc"]
    assert [len(part) for part in folded(files)] == [1, 1, 1]


def test_groups_that_lack_the_same_are_told_once() -> None:
    found = [
        Finding.of("BD-BNK-001", Mismatch({"group_id": group}, "all 13 policies", f"no complete attempt of {action}"))
        for group, action in (("g0", "brake_1.00"), ("g1", "brake_0.30"), ("g2", "brake_1.00"), ("g3", "brake_1.00"))
    ]
    assert [(part[0], also_in(part)) for part in folded(found)] == [
        (found[0], ", and 2 more groups"), (found[1], ""),
    ]  # fmt: skip


def test_degrees_are_named_and_told_once_for_each_table(tmp_path: Path) -> None:
    draft = new_draft()
    for table in ("observations", "actors"):
        draft.set(table, "yaw_rad", -175.5)
    report = validate_once(draft.write(tmp_path / "dataset"))
    tally = next(tally for tally in report.tallies if tally.rule_id == "BD-VAL-002")
    parts = folded(tally.findings)
    assert {part[0].found for part in parts} == {"-175.5, as what is in degrees"}
    assert [part[0].location["table"] for part in parts[:2]] == ["observations", "actors"]
    assert len(parts) < len(tally.findings) / 5


def test_what_is_no_angle_has_no_degrees(tmp_path: Path) -> None:
    report = validate_once(datasets.write(tmp_path / "dataset", datasets.DEPARTURES["speed out of range"].tables()))
    assert not any("degrees" in finding.found for finding in report.findings)
