"""Three faults in three groups are three causes: evidence of rows at fault is a consequence, and so is the comparison.

The speeds of one group are 15 % too high, one attempt of another applies another brake than its expert commands, and
one of the third lacks the rows of its actors at five observations; the manifest is that of the dataset before.
"""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from tests.audits import validate_once
from tests.mutation import Draft, new_draft
from tests.validator.engine.rules.cases.replays import repeat_exactly

from branchdrive.cli.formats.causes import CauseText
from branchdrive.cli.formats.outcome import Outcome
from branchdrive.cli.formats.table import renderer
from branchdrive.cli.text import render_report
from branchdrive.engine import judge, tally
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate

BRAKES, LACKS = "g2.brake_0.50.a1", "g1.accelerate_0.80.a1"
EVIDENCE = ("BD-EVD-001", "BD-EVD-002", "BD-EVD-003")
THREE = {"BD-MOT-006", "BD-CTL-009", "BD-WIN-005"}


def _plant(draft: Draft) -> None:
    attempts = draft.take("rollouts", group_id="g0")["rollout_id"].to_pylist()
    draft.set("observations", "speed_mps", lambda speed: 1.15 * speed, rollout_id=attempts)
    draft.set("controls", "applied_brake", 0.9, rollout_id=BRAKES, tick=[*range(40, 65)])
    draft.drop("actors", rollout_id=LACKS, tick=[*range(50, 71, 5)])


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Report:
    """The dataset with the three faults, and the manifest that it had without them."""
    folder, draft = tmp_path_factory.mktemp("faults"), new_draft()
    repeat_exactly(draft)
    before = draft.write(folder / "before")
    _plant(draft)
    root = draft.write(folder / "dataset")
    (root / "MANIFEST.sha256").write_bytes((before / "MANIFEST.sha256").read_bytes())
    return validate_once(root)


@pytest.fixture(scope="module")
def cards(report: Report) -> dict[str, CauseText]:
    """What to look at first, by rule."""
    return {cause.info.id: cause for cause in Outcome.of(report, 5).causes}


def test_each_fault_is_one_cause(report: Report) -> None:
    causes = {cause.rule_id: cause for cause in report.causes.first}
    assert causes.keys() == THREE | {"BD-LAY-002"}
    assert [causes[rule].extents[0].groups for rule in sorted(THREE)] == [("g2",), ("g0",), ("g1",)]
    assert {*EVIDENCE, "BD-RPN-003"} <= {tally.rule_id for tally in report.tallies if tally.num_findings}


def test_evidence_follows_from_the_rows_that_it_is_held_against(report: Report) -> None:
    for rule in EVIDENCE:
        causes = {f.group_id: f.follows for f in report.findings if f.rule == rule}
        assert causes.get("g1") == ("BD-WIN-005",)
        assert causes.get("g0", ("BD-MOT-006",)) == ("BD-MOT-006",)
        following = report.causes.following[rule]
        assert following.num_explained == following.num_failed


def test_the_comparison_follows_from_the_fault_at_its_place(report: Report) -> None:
    follows = {str(f.location["rollout_id"]): f.follows for f in report.findings if f.rule == "BD-RPN-003"}
    assert follows == {BRAKES: ("BD-CTL-009",), LACKS: ("BD-WIN-005",)}


def test_evidence_is_to_be_left_as_it_is(report: Report) -> None:
    for text in (render_report(report, io.StringIO()), renderer("markdown")(report), renderer("github")(report)):
        said = " ".join(text.split())
        assert "Repair BD-WIN-005 first, and leave evidence as it is" in said
        assert "Compute separation from the recorded boxes" not in said
        assert "may follow from BD-EVD-001" not in said
    evidence = [f.to_json() for f in report.findings if f.rule in EVIDENCE]
    assert all(finding["follows"] and "leave evidence as it is" in finding["remedy"] for finding in evidence)


@pytest.mark.parametrize(
    ("rule", "where", "found"),
    [
        ("BD-CTL-009", f"{BRAKES}, controls, ticks 40 to 64 (25 places), 3.00 to 1.80 s before the branch: ", ""),
        ("BD-WIN-005", f"{LACKS}, actors, ticks 50 to 70, every 5 (5 places), 2.50 to 1.50 s before the branch: ", ""),
        ("BD-MOT-006", "observations.speed_mps", "speeds are 15 % higher than the positions say, over the whole drive"),
    ],
)
def test_a_card_names_attempt_table_and_ticks(cards: dict[str, CauseText], rule: str, where: str, found: str) -> None:
    ((text, _),) = cards[rule].found
    assert where in text and found in text
    assert cards[rule].title.startswith("Does not hold: ")


def test_changed_files_are_connected_with_the_faults_in_them(cards: dict[str, CauseText]) -> None:
    changed = cards["BD-LAY-002"]
    assert "files that the manifest lists" in changed.where
    assert len(changed.found) >= 3 and all(len(text) < 120 for text, _ in changed.found)
    assert changed.follows.startswith("the faults of ") and all(rule in changed.follows for rule in THREE)
    assert "actors and observations of shard-00000" in changed.follows
    for rule in THREE:
        assert "not the file that the manifest lists (BD-LAY-002)" in cards[rule].follows


def test_what_lies_outside_of_the_ticks_of_a_fault_is_a_cause(tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop("actors", rollout_id=LACKS, tick=[*range(50, 71, 5)])
    draft.set("evidence", "separation_m", lambda gap: gap and gap + 1.0, rollout_id=LACKS, tick=120)
    found = validate_once(draft.write(tmp_path / "dataset"))
    assert {"BD-WIN-005", "BD-EVD-001"} <= {cause.rule_id for cause in found.causes.first}
    assert "BD-EVD-002" not in {cause.rule_id for cause in found.causes.first}


def test_another_attempt_is_explained_by_no_single_one(tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop("actors", rollout_id=LACKS, tick=[*range(50, 71, 5)])
    other = LACKS.replace("accelerate_0.80", "accelerate_0.50")
    draft.set("evidence", "separation_m", lambda gap: gap and gap + 1.0, rollout_id=other, tick=60)
    found = validate_once(draft.write(tmp_path / "dataset"))
    (cause,) = (cause for cause in found.causes.first if cause.rule_id == "BD-EVD-001")
    assert (cause.num_attempts, cause.first and cause.first.location["rollout_id"]) == (1, other)
    assert found.causes.following["BD-EVD-001"].causes == (("BD-WIN-005", 1),)


def test_a_fault_of_the_nominal_explains_those_that_are_held_against_it(tmp_path: Path) -> None:
    draft = new_draft()
    repeat_exactly(draft)
    draft.set("controls", "applied_brake", 0.9, rollout_id="g2.nominal.a1", tick=[*range(40, 65)])
    found = validate_once(draft.write(tmp_path / "dataset"))
    assert sum(f.rule == "BD-RPN-003" for f in found.findings) == 12
    assert [cause.rule_id for cause in found.causes.first] == ["BD-CTL-009"]


def _plant_in_two_tables(draft: Draft) -> None:
    """Speeds of one group are in another unit, and velocities of the actors of another."""
    attempts = {group: draft.take("rollouts", group_id=group)["rollout_id"].to_pylist() for group in ("g0", "g1")}
    draft.set("observations", "speed_mps", lambda speed: 3.6 * speed, rollout_id=attempts["g0"])
    for column in ("vel_x_mps", "vel_y_mps"):
        draft.set("actors", column, lambda speed: 1.5 * speed, rollout_id=attempts["g1"])


def test_faults_of_two_tables_are_two_causes_of_one_rule(tmp_path: Path) -> None:
    draft = new_draft()
    _plant_in_two_tables(draft)
    found = validate_once(draft.write(tmp_path / "dataset"))
    causes = [cause for cause in found.causes.first if cause.rule_id == "BD-MOT-006"]
    assert [cause.extents[0].groups for cause in causes] == [("g0",), ("g1",)]
    assert [cause.columns for cause in causes] == [("speed_mps",), ("vel_x_mps",)]
    assert sum(cause.num_attempts for cause in causes) == sum(f.rule == "BD-MOT-006" for f in found.findings)


def test_a_cause_of_which_no_finding_is_kept_says_what_its_group_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draft = new_draft()
    _plant_in_two_tables(draft)
    root = draft.write(tmp_path / "dataset")
    for module in (judge, tally):
        monkeypatch.setattr(module, "MAX_FINDINGS_PER_RULE", 1)
    texts = [cause.found for cause in Outcome.of(validate(root), 5).causes if cause.info.id == "BD-MOT-006"]
    assert any(text.startswith("g1, in vel_x_mps: expected ") and finding is None for ((text, finding),) in texts)
