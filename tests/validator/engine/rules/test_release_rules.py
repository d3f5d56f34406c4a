"""What rules on derived layers say about broken inputs: not judged, with a reason, and never a failure of the tool."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.mutation import MUTANTS, Mutant, new_draft
from tests.sampling import sampled
from tests.validator.engine.rules.case import NO_SUBJECT, UNWRITTEN, judged, judged_folder
from tests.validator.engine.rules.release import BUILT, SPLIT, THRESHOLDS, ReleaseDraft, release_draft

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import table_path
from branchdrive.contract.rule import rules_of
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.model import near_duplicate

BY_NAME = {(mutant.rule, mutant.name): mutant for mutant in MUTANTS}


def reasons(report: Report) -> dict[str, str]:
    return {tally.rule_id: str(tally.reason) for tally in report.tallies if tally.status == "skipped"}


def spoiled(mutant: Mutant) -> ReleaseDraft:
    draft = new_draft(mutant.base)
    assert isinstance(draft, ReleaseDraft)
    mutant.edit(draft)
    return draft


@pytest.mark.parametrize(
    ("rule", "name", "table"),
    [
        ("BD-LYR-002", "derived_table_truncated", "state"),
        ("BD-LYR-003", "derived_column_missing", "group_quality"),
        ("BD-LYR-006", "two_records_of_an_action", "records"),
        ("BD-LYR-007", "negative_discrepancy", "pairs"),
        ("BD-LYR-008", "mask_off_above_a_value", "attempt_quality"),
    ],
)
def test_rules_on_values_distrust_a_table_that_breaks_its_structure(
    rule: str, name: str, table: str, tmp_path: Path
) -> None:
    root = spoiled(BY_NAME[rule, name]).write(tmp_path / "dataset")
    file = f"a file of the table `{table}`" if LAYER_TABLES[table].is_of_groups else table_path(table)
    words = f"{file} is missing or breaks the format"
    whole = reasons(judged_folder(root))
    assert words in whole.values()
    # The same, where the rules on structure are not asked for.
    areas = ("BD-CAN", "BD-QUA", "BD-SPL", "BD-FID", "BD-MOD")
    alone = judged_folder(root, select=areas)
    assert alone.errors == ()
    unjudged = {rule_id for rule_id, reason in reasons(alone).items() if reason == words}
    assert unjudged
    assert unjudged == {rule_id for rule_id, reason in whole.items() if reason == words and rule_id[:6] in areas}


def test_rules_that_read_a_broken_document_are_not_judged(tmp_path: Path) -> None:
    draft = release_draft()
    draft.documents[SPLIT]["seed"] = -1
    found = reasons(judged(draft, tmp_path))
    assert set(found) >= {"BD-SPL-004", "BD-SPL-005", "BD-SPL-006", "BD-FID-006", "BD-FID-010", "BD-REL-003"}
    judged_nowhere = set(found) - NO_SUBJECT - UNWRITTEN
    assert {found[rule_id] for rule_id in judged_nowhere} == {f"{SPLIT} is missing or breaks its schema"}


def test_near_duplicates_on_the_threshold_are_told_either_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = spoiled(BY_NAME["BD-SPL-007", "unwelcome_group_called_a_near_duplicate"]).write(tmp_path / "dataset")
    for tolerance, status in ((near_duplicate.TOLERANCE, "fail"), (1e6, "pass")):
        monkeypatch.setattr(near_duplicate, "TOLERANCE", tolerance)
        (found,) = (tally for tally in validate(root, select=["BD-SPL"]).tallies if tally.rule_id == "BD-SPL-007")
        assert found.status == status


@pytest.mark.parametrize("table", ["records", "attempts", "attempt_quality", "group_quality", "pairs"])
def test_no_rule_fails_for_want_of_a_row(table: str, tmp_path: Path) -> None:
    """Tables without rows are what rules find them to be, and no rule breaks down."""
    draft = release_draft()
    for layer in BUILT:
        if table in draft.tables[layer]:
            draft.map_table(table, lambda rows: rows.slice(0, 0), folder=layer)
    report = judged(draft, tmp_path)
    assert report.errors == ()
    assert report.verdict == "invalid"


def _swap_ids(d: ReleaseDraft) -> None:
    d.set("group_quality", "group_id", lambda name: f"h{name[1:]}")


def _all_eligible(d: ReleaseDraft) -> None:
    d.set("group_quality", ("exact_bank", "controls_valid", "integrity_complete", "eligible", "core_valid"), True)


def _half_the_pairs(d: ReleaseDraft) -> None:
    d.map_table("pairs", lambda rows: rows.slice(0, len(rows) // 2), folder="quality")


def _replays_called_interventions(d: ReleaseDraft) -> None:
    d.set("pairs", "kind", "intervention")


def _no_variables(d: ReleaseDraft) -> None:
    d.documents[THRESHOLDS]["variables"].reverse()


def _huge_numbers(d: ReleaseDraft) -> None:
    d.set("pairs", ("position_m", "speed_mps"), 1e308)
    d.set("state", ("rel_x_m", "speed_mps"), 1e308)
    d.set("records", "seed", 2**63 - 1)


def _no_links(d: ReleaseDraft) -> None:
    d.set("records", ("rollout_id", "nominal_rollout_id"), None, kind="nominal_link")
    d.set("records", "nominal_rollout_id", None, group_id="g13")


def _nobody_trained(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", lambda home: None if home is None else "test")


@pytest.mark.parametrize(
    "edit",
    [
        _swap_ids, _all_eligible, _half_the_pairs, _replays_called_interventions, _no_variables, _huge_numbers,
        _nobody_trained, _no_links,
    ],
)  # fmt: skip
@pytest.mark.parametrize("base", sampled(["release", "alone"], every=2))
def test_no_rule_breaks_down_on_well_formed_nonsense(
    edit: Callable[[ReleaseDraft], None], base: str, tmp_path: Path
) -> None:
    draft = new_draft("release" if base == "release" else "alone")
    assert isinstance(draft, ReleaseDraft)
    edit(draft)
    report = judged(draft, tmp_path)
    assert report.errors == ()
    assert report.verdict == "invalid"
    assert {tally.rule_id for tally in report.tallies if tally.num_findings} & set(rules_of("layers", "layer_rows"))
