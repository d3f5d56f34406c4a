"""A rollout fails alone: it leaves later rules by name and never switches one off for the others."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from tests.audits import validate_once
from tests.mutation import Draft, new_draft
from tests.synthetic import BRANCH_TICK, NUM_TICKS, make_group
from tests.validator.engine.rules.case import ACCELERATE, BRAKE, NOMINAL, REPLAY, SHARD_0, SHARD_1, STEER_LEFT

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.rule import CATALOGUE, RULES, rules_of
from branchdrive.engine.examine import examine
from branchdrive.engine.finding import Finding
from branchdrive.engine.report import Report
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE, Tally
from branchdrive.engine.validate import validate
from branchdrive.raw.shard_view import ShardView

MIDDLE = BRANCH_TICK + 10


def judge(draft: Draft, tmp_path: Path) -> dict[str, Tally]:
    return {tally.rule_id: tally for tally in report_of(draft, tmp_path).tallies}


def report_of(draft: Draft, tmp_path: Path) -> Report:
    report = validate_once(draft.write(tmp_path / "dataset"))
    assert report.errors == ()
    return report


UNCLAIMED = {"decisions", "map", "rgb_surround", "rgb_top_down", "semantic_bev"}
CLAIMED = tuple(rule_id for rule_id in rules_of("rollout") if not UNCLAIMED & set(CATALOGUE[rule_id].streams))
"""Rules on attempts of a dataset without decisions, maps and images."""

OF_GROUPS = tuple(rule_id for rule_id in rules_of("group") if rule_id != "BD-GRP-010")
"""Rules on groups, but for that on groups in which somebody who steers touches nobody."""


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Tally]:
    return judge(new_draft(), tmp_path_factory.mktemp("base"))


def misapply(draft: Draft, rollout_id: str) -> None:
    draft.set("controls", "applied_steer", 0.875, rollout_id=rollout_id, tick=MIDDLE)


def failed(tallies: dict[str, Tally]) -> dict[str, int]:
    return {rule_id: tally.num_findings for rule_id, tally in tallies.items() if tally.num_findings}


def rollouts_in(findings: list[Finding]) -> list[Any]:
    return [finding.location["rollout_id"] for finding in findings]


def test_a_broken_rollout_hides_its_own_later_faults_only(tmp_path: Path, base: dict[str, Tally]) -> None:
    draft = new_draft()
    draft.set("observations", "accel_lateral_mps2", math.nan, rollout_id=BRAKE, tick=0)
    for rollout_id in (BRAKE, STEER_LEFT, "g2.brake_0.50.a1"):
        misapply(draft, rollout_id)
    draft.set("evidence", "separation_m", lambda gap: gap + 1, rollout_id=ACCELERATE, tick=BRANCH_TICK)
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-VAL-001": 1, "BD-CTL-008": 2, "BD-EVD-001": 1}
    assert rollouts_in(tallies["BD-CTL-008"].findings) == [STEER_LEFT, "g2.brake_0.50.a1"]
    for rule_id in CLAIMED:
        brakes = rule_id not in (
            "BD-CTL-004",
            "BD-CTL-006",
            "BD-CTL-013",
            "BD-CTL-015",
            "BD-ACT-005",
            "BD-RTE-003",
            "BD-RTE-005",
            "BD-RES-005",
            "BD-GRP-006",
            "BD-RPN-001",
            "BD-RPN-002",
            "BD-RPN-003",
        )  # a brake policy, or one that touches nobody, is no subject of these
        assert tallies[rule_id].examined == max(0, base[rule_id].examined - brakes), rule_id
        assert tallies[rule_id].total == base[rule_id].total


def test_structure_rules_do_not_exclude_from_each_other(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("observations", "x_m", math.inf, rollout_id=BRAKE, tick=0)
    draft.set("observations", "command", "back", rollout_id=BRAKE, tick=0)
    draft.set("rollouts", "num_ticks", 7, rollout_id=BRAKE)
    assert failed(judge(draft, tmp_path)) == {"BD-VAL-001": 1, "BD-VAL-003": 1, "BD-KEY-007": 1}


def test_a_gap_excludes_the_rollout_from_the_rules_that_require_gapless_ticks(
    tmp_path: Path, base: dict[str, Tally]
) -> None:
    draft = new_draft()
    draft.drop("controls", rollout_id=BRAKE, tick=MIDDLE)
    draft.recount(BRAKE)
    misapply(draft, STEER_LEFT)
    draft.set("controls", "applied_steer", 0.875, rollout_id=BRAKE, tick=MIDDLE + 1)
    tallies = judge(draft, tmp_path)
    # The gap lies in the future window, too; that is another rule's business and costs another stage.
    assert failed(tallies) == {"BD-TIC-001": 1, "BD-CTL-008": 2, "BD-WIN-003": 1}
    requiring = {rule_id for rule_id, rule in CATALOGUE.items() if "BD-TIC-001" in rule.requires}
    assert requiring == {"BD-CTL-001", "BD-CTL-002", "BD-CTL-012", "BD-CTL-016"}
    requiring |= {rule_id for rule_id, rule in CATALOGUE.items() if "BD-WIN-003" in rule.requires}
    requiring -= {"BD-RES-005"}  # who touches nobody is no subject of it anyway
    for rule_id in rules_of("rollout"):
        assert tallies[rule_id].examined == max(0, base[rule_id].examined - (rule_id in requiring)), rule_id


def test_a_gap_in_the_history_is_counted_in_the_window(tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop("controls", rollout_id=BRAKE, tick=[30, 31, 40])
    draft.recount(BRAKE)
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-TIC-001": 1, "BD-WIN-001": 1}
    (gap,), (window,) = tallies["BD-TIC-001"].findings, tallies["BD-WIN-001"].findings
    assert (gap.count, gap.location["tick"], gap.expected) == (2, 32, "tick 30 after tick 29")
    assert (window.count, window.expected, window.found) == (3, "80 controls before tick 100", "77")


def test_an_observation_lost_from_the_history_is_counted_in_the_window(tmp_path: Path) -> None:
    draft = new_draft()
    draft.drop_observation(BRAKE, 50)
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-TIC-002": 1, "BD-WIN-002": 1, "BD-WIN-004": 1}
    assert tallies["BD-WIN-002"].findings[0].location["tick"] == 50


def test_a_partial_attempt_is_examined_by_structure_rules_alone(tmp_path: Path, base: dict[str, Tally]) -> None:
    draft = new_draft()
    draft.copy_attempt(BRAKE, "g0.brake_0.50.a2", attempt=2, status="partial", status_reason="the ego was stuck")
    misapply(draft, "g0.brake_0.50.a2")
    draft.drop("observations", rollout_id="g0.brake_0.50.a2", tick=range(BRANCH_TICK, 201))
    for table in ("actors", "evidence"):
        draft.drop(table, rollout_id="g0.brake_0.50.a2", tick=range(BRANCH_TICK, 201))
    draft.recount("g0.brake_0.50.a2")
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-STA-001": 1}
    for rule_id in set(CLAIMED) - {"BD-STA-001"}:
        assert tallies[rule_id].examined == base[rule_id].examined
        assert tallies[rule_id].total == base[rule_id].total + 1

    draft.set("controls", "expert_steer", math.nan, rollout_id="g0.brake_0.50.a2", tick=0)
    tallies = judge(draft, tmp_path / "broken")
    assert failed(tallies) == {"BD-VAL-001": 1}


def test_a_broken_candidate_takes_its_group_out_of_the_group_rules(tmp_path: Path, base: dict[str, Tally]) -> None:
    draft = new_draft()
    draft.set("rollouts", "environment", "a\nb", rollout_id=BRAKE)
    draft.set("rollouts", "town", "Town99", rollout_id="g2.brake_0.50.a1")
    report = report_of(draft, tmp_path)
    tallies = {tally.rule_id: tally for tally in report.tallies}
    assert failed(tallies) == {"BD-VAL-004": 1, "BD-GRP-002": 1}
    for rule_id in OF_GROUPS:
        assert (tallies[rule_id].examined, tallies[rule_id].total) == (2, 3)
        assert (base[rule_id].examined, base[rule_id].total) == (3, 3)
    assert report.funnel is not None
    assert report.funnel.lost == {"bank": 1, "eligibility": 1}
    assert report.funnel.reasons["bank"] == {"BD-VAL-004": 1}
    assert report.funnel.reasons["eligibility"] == {"BD-GRP-002": 1}


@pytest.mark.parametrize("spoiled", [REPLAY, "g1.brake_0.50.a1"])
def test_a_broken_attempt_that_is_not_chosen_costs_no_group(spoiled: str, tmp_path: Path) -> None:
    """A replay is no candidate, and group 1 has a second attempt of its action."""
    draft = new_draft()
    draft.set("observations", "x_m", math.nan, rollout_id=spoiled, tick=0)
    report = report_of(draft, tmp_path)
    assert {tally.rule_id for tally in report.tallies if tally.num_findings} == {"BD-VAL-001"}
    assert all(tally.examined == 3 for tally in report.tallies if tally.rule_id in OF_GROUPS)
    assert report.verdict == "invalid"
    assert report.funnel is not None
    assert report.funnel.qualified == 3


def test_an_unknown_action_leaves_a_hole_in_the_bank(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("rollouts", "action_key", "brake_0.40", rollout_id=BRAKE)
    report = report_of(draft, tmp_path)
    assert {tally.rule_id for tally in report.tallies if tally.num_findings} == {"BD-KEY-008", "BD-BNK-001"}
    assert report.funnel is not None
    assert report.funnel.lost == {"bank": 1}


def test_a_broken_nominal_is_still_what_others_are_compared_with(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("observations", "speed_mps", math.nan, rollout_id=NOMINAL, tick=0)
    draft.set("controls", "nominal_steer", 0.5, rollout_id=BRAKE, tick=MIDDLE)
    report = report_of(draft, tmp_path)
    tallies = {tally.rule_id: tally for tally in report.tallies}
    assert failed(tallies) == {"BD-VAL-001": 1, "BD-CTL-010": 1}
    assert {tallies[rule_id].examined for rule_id in OF_GROUPS} == {2}
    assert report.funnel is not None
    assert report.funnel.lost == {"bank": 1}
    assert report.funnel.reasons["bank"] == {"BD-VAL-001": 1}


def test_an_unreadable_table_silences_its_own_shard_alone(tmp_path: Path) -> None:
    draft = new_draft()
    misapply(draft, BRAKE)
    misapply(draft, "g2.brake_0.50.a1")
    draft.before_seal(lambda root: (root / SHARD_1 / "evidence.parquet").write_bytes(b"PAR1"))
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-TAB-001": 1, "BD-CTL-008": 1}
    assert rollouts_in(tallies["BD-CTL-008"].findings) == [BRAKE]
    assert tallies["BD-CTL-009"].status == "skipped"
    assert tallies["BD-CTL-009"].reason == f"{SHARD_1} has no readable evidence"
    assert tallies["BD-CTL-009"].examined == 31


def test_a_file_below_too_many_folders_is_seen(tmp_path: Path) -> None:
    path = f"{SHARD_0}/1/2/3/4/5/6/7"

    def bury(root: Path) -> None:
        (root / path).mkdir(parents=True)
        (root / path / "file").write_bytes(b"")

    draft = new_draft("media")
    draft.after_seal(bury)
    tallies = judge(draft, tmp_path)
    # Folders have no place in a shard, and neither has anything on the way down.
    assert failed(tallies) == {"BD-LAY-007": 1, "BD-LAY-009": 7}
    assert tallies["BD-LAY-007"].findings[0].location == {"file": f"{path}/file"}


# Counts


def test_rows_are_counted_one_by_one_and_told_once_per_rollout(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("controls", "expert_steer", math.nan, rollout_id=BRAKE, tick=range(20, 27))
    draft.set("controls", "expert_brake", math.nan, rollout_id=BRAKE, tick=3)
    draft.set("controls", "expert_steer", math.nan, rollout_id=STEER_LEFT, tick=5)
    tally = judge(draft, tmp_path)["BD-VAL-001"]
    assert tally.num_findings == 9
    told = [(f.location["column"], f.location["rollout_id"], f.location["tick"], f.count) for f in tally.findings]
    assert sorted(told) == [
        ("expert_brake", BRAKE, 3, 1),
        ("expert_steer", BRAKE, 20, 7),
        ("expert_steer", STEER_LEFT, 5, 1),
    ]


def test_rows_of_nobody_stand_for_themselves(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("controls", "expert_steer", math.nan, rollout_id=NOMINAL, tick=[0, 1, 2])
    draft.duplicate("controls", {"rollout_id": "g0.ghost.a1"}, rollout_id=NOMINAL, tick=[0, 1, 2])
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-VAL-001": 6, "BD-KEY-004": 3}
    told = [(f.location["rollout_id"], f.location["tick"], f.count) for f in tallies["BD-VAL-001"].findings]
    assert sorted(told) == [("g0.ghost.a1", tick, 1) for tick in (0, 1, 2)] + [(NOMINAL, 0, 3)]


def test_places_of_a_rollout_are_counted_in_its_one_finding(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("controls", "applied_steer", 0.875, rollout_id=BRAKE, tick=range(BRANCH_TICK + 3, BRANCH_TICK + 9))
    tally = judge(draft, tmp_path)["BD-CTL-008"]
    (finding,) = tally.findings
    assert (tally.num_findings, finding.count, finding.location["tick"]) == (1, 6, BRANCH_TICK + 3)


def test_findings_are_capped_and_counts_are_not(tmp_path: Path) -> None:
    number = MAX_FINDINGS_PER_RULE + 50

    def clutter(root: Path) -> None:
        for k in range(number):
            (root / f"extra-{k}").write_bytes(b"")

    draft = new_draft()
    # Rows of nobody stand for themselves.
    ghosts = draft.take("controls", rollout_id=[BRAKE], tick=range(number))
    for folder in (SHARD_0, SHARD_1):
        draft.append(
            "controls", ghosts.set_column(0, ghosts.schema.field(0), [["g9.ghost.a1"] * number]), folder=folder
        )
    draft.before_seal(clutter)
    tallies = judge(draft, tmp_path)
    assert failed(tallies) == {"BD-KEY-004": 2 * number, "BD-LAY-009": number}
    for rule_id in ("BD-KEY-004", "BD-LAY-009"):
        assert len(tallies[rule_id].findings) == MAX_FINDINGS_PER_RULE


def test_examined_counts_every_subject(tmp_path: Path, base: dict[str, Tally]) -> None:
    attempts, interventions = 46, 37
    assert base["BD-STA-001"].examined == base["BD-TIC-001"].examined == base["BD-CTL-009"].examined == attempts
    assert base["BD-CTL-008"].examined == base["BD-CTL-010"].examined == interventions
    assert base["BD-CTL-013"].examined == attempts - interventions
    assert base["BD-CTL-004"].examined == base["BD-CTL-006"].examined == 3 * 6
    assert base["BD-CTL-005"].examined == base["BD-CTL-007"].examined == interventions - 3 * 6
    assert base["BD-CTL-003"].examined == 3 * 3 + 1
    assert base["BD-BNK-001"].examined == base["BD-GRP-001"].examined == base["BD-KEY-003"].examined == 3
    assert base["BD-KEY-001"].examined == base["BD-KEY-002"].examined == base["BD-VAL-005"].examined == attempts
    assert base["BD-NUL-003"].examined == 6 * attempts * NUM_TICKS
    assert base["BD-TAB-001"].examined == base["BD-TAB-004"].examined == 10
    assert base["BD-LAY-002"].examined == base["BD-LAY-003"].examined == base["BD-LAY-004"].examined == 11


# A rule that fails itself


@pytest.mark.parametrize("rule_id", ["BD-VAL-001", "BD-CTL-008", "BD-GRP-002", "BD-LAY-009"])
def test_a_rule_that_raises_does_not_hide_the_others(
    rule_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setitem(RULES, rule_id, broken)
    draft = new_draft()
    draft.set("evidence", "nearest_vehicle_gap_m", 1.0, rollout_id=STEER_LEFT, tick=BRANCH_TICK)
    report = validate(draft.write(tmp_path / "dataset"))
    status = {tally.rule_id: tally.status for tally in report.tallies}
    assert status[rule_id] == "error"
    assert status["BD-EVD-003"] == "fail"
    assert (report.verdict, report.exit_code) == ("error", 4)
    assert all("ZeroDivisionError: a bug" in message for message in report.errors)


def test_the_same_rows_in_memory_give_the_same_counts(base: dict[str, Tally]) -> None:
    draft = new_draft()
    view = ShardView(make_group(2), Descriptor.model_validate(draft.descriptor))
    alone, _ = examine(view)
    assert set(alone) == set(rules_of("rows", "rollout", "group"))
    assert alone["BD-STA-001"].examined == 15
    assert all(tally.num_findings == 0 for tally in alone.values())
    assert all(tally.examined <= base[rule_id].examined for rule_id, tally in alone.items())


# What a rule stands on


def _statuses(report: Report) -> dict[str, tuple[str, str | None]]:
    return {tally.rule_id: (tally.status, tally.reason) for tally in report.tallies}


def test_without_a_manifest_nothing_is_compared_with_it(tmp_path: Path) -> None:
    draft = new_draft()
    draft.is_sealed = False
    status = _statuses(report_of(draft, tmp_path))
    standing_on_it = {rule_id for rule_id, rule in CATALOGUE.items() if "BD-LAY-001" in rule.requires}
    assert standing_on_it == {"BD-LAY-002", "BD-LAY-003", "BD-LAY-004", "BD-LAY-008", "BD-TAB-006"}
    for rule_id in standing_on_it:
        assert status[rule_id] == ("skipped", "precondition BD-LAY-001 failed")
    assert status["BD-CTL-008"] == ("pass", None)


def test_without_a_descriptor_no_row_is_judged(tmp_path: Path) -> None:
    draft = new_draft()
    draft.before_seal(lambda root: (root / "branchdrive.json").write_text("{"))
    report = report_of(draft, tmp_path)
    status = _statuses(report)
    assert status["BD-DOC-002"] == status["BD-DOC-003"] == ("skipped", "precondition BD-DOC-001 failed")
    for rule_id in ("BD-DOC-004", "BD-ENC-001", "BD-TAB-004"):
        assert status[rule_id] == ("skipped", "no subject")
    for rule_id in set(rules_of("rows", "rollout", "group")):
        assert status[rule_id] == ("skipped", "the descriptor is unusable")
    for rule_id in ("BD-LAY-002", "BD-LAY-009", "BD-TAB-001", "BD-TAB-002", "BD-TAB-003"):
        assert status[rule_id] == ("pass", None)
    assert report.funnel is None


@pytest.mark.parametrize("text", ["{", '{"spec_version": "0.1"}'])
def test_what_no_claim_could_cover_is_found_without_a_descriptor_too(tmp_path: Path, text: str) -> None:
    def spoil(root: Path) -> None:
        (root / "branchdrive.json").write_text(text)
        (root / "canonical").mkdir()
        for name in ("controls.parquet.tmp", "views.pkl", "views.bin", "map.parquet.old"):
            (root / SHARD_0 / name).write_bytes(b"")

    draft = new_draft()
    draft.before_seal(spoil)
    places = [finding.location["file"] for finding in judge(draft, tmp_path)["BD-LAY-009"].findings]
    assert sorted(places) == [f"{SHARD_0}/{name}" for name in ("controls.parquet.tmp", "map.parquet.old", "views.pkl")]


def test_without_the_declared_columns_neither_metadata_nor_rows_are_judged(tmp_path: Path) -> None:
    draft = new_draft()
    draft.map_table("controls", lambda rows: rows.drop_columns("active"), folder=SHARD_1)
    status = _statuses(report_of(draft, tmp_path))
    assert status["BD-TAB-003"] == ("skipped", "precondition BD-TAB-002 failed")
    assert status["BD-CTL-008"] == ("skipped", f"{SHARD_1} has tables with undeclared columns or types")


def test_documents_and_files_are_counted(base: dict[str, Tally]) -> None:
    for rule_id in ("BD-LAY-001", "BD-DOC-001", "BD-DOC-002", "BD-DOC-003", "BD-DOC-004", "BD-ENC-001"):
        assert base[rule_id].examined == base[rule_id].total == 1, rule_id
    assert base["BD-TAB-002"].examined == base["BD-TAB-003"].examined == 10
    assert base["BD-LAY-006"].examined == base["BD-LAY-009"].examined == 12 + 3  # files and folders
    assert base["BD-LAY-008"].examined == 2
