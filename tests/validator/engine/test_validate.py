"""Whole validations: verdicts, exit codes, selection, gates, and failures of the tool itself."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import pytest
from tests import synthetic
from tests.audits import validate_once
from tests.each import each
from tests.validator.engine.datasets import (
    DEPARTURES,
    FOLDER,
    Departure,
    cells,
    edited,
    failing,
    outcome,
    row_of,
    status,
    write,
)
from tests.validator.engine.rules.case import NO_SUBJECT

from branchdrive.contract.rule import CATALOGUE, RULES
from branchdrive.engine.validate import select_rules, validate
from branchdrive.engine.waiver import Waiver
from branchdrive.errors import UsageError

UNCLAIMED = {
    rule_id
    for rule_id, info in CATALOGUE.items()
    if info.layer or (info.streams and not set(info.streams) & set(synthetic.descriptor()["streams"]))
}
"""Rules on derived layers and on streams that the synthetic dataset does not claim."""

WITHOUT_SUBJECT = NO_SUBJECT - UNCLAIMED


@pytest.mark.parametrize("departure", DEPARTURES.values(), ids=DEPARTURES)
def test_one_departure_breaks_its_rules_and_no_others(departure: Departure, tmp_path: Path) -> None:
    report = validate_once(write(tmp_path / "dataset", departure.tables()))
    assert report.verdict == departure.verdict
    assert report.exit_code == {"valid": 0, "invalid": 1}[departure.verdict]
    assert failing(report) == departure.rules
    assert report.funnel is not None
    assert report.funnel.qualified == departure.qualified


def test_valid_dataset_passes_every_rule_that_it_claims(valid_root: Path) -> None:
    report = validate_once(valid_root)
    others = {t.rule_id: t.status for t in report.tallies if t.status != "pass"}
    assert others == {**dict.fromkeys(UNCLAIMED, "not-claimed"), **dict.fromkeys(WITHOUT_SUBJECT, "skipped")}
    assert [tally.rule_id for tally in report.tallies] == list(CATALOGUE)


# --- what could not be judged


def wrong_encoding() -> dict[str, Any]:
    document = synthetic.descriptor()
    document["action_encoding"]["sha256"] = "0" * 64
    return document


@pytest.mark.parametrize(
    ("options", "verdict", "exit_code"),
    [
        pytest.param({}, "valid", 0, id="everything"),
        pytest.param({"ignore": ["BD-TAB-003"]}, "partial", 3, id="a structure rule is left out"),
        pytest.param({"ignore": ["BD-ENC"]}, "partial", 3, id="a claim rule is left out"),
        pytest.param({"ignore": ["BD-CTL", "BD-GRP"]}, "valid", 0, id="qualification rules are left out"),
        pytest.param({"select": ["BD-CTL-008"]}, "partial", 3, id="one rule is selected"),
        pytest.param({"select": []}, "partial", 3, id="no rule is selected"),
        pytest.param({"hash_files": False}, "partial", 3, id="digests were not computed"),
    ],
)
def test_what_is_not_judged_is_not_called_valid(
    options: dict[str, Any], verdict: str, exit_code: int, valid_root: Path
) -> None:
    report = validate_once(valid_root, **options)
    assert (report.verdict, report.exit_code) == (verdict, exit_code)


@pytest.mark.parametrize("options", [{"ignore": ["BD-TAB-003"]}, {"hash_files": False}, {"select": ["BD-VAL"]}])
def test_a_failure_outweighs_what_was_not_judged(options: dict[str, Any], tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    report = validate_once(root, **options)
    assert (report.verdict, report.exit_code) == ("invalid", 1)


def test_a_refuted_claim_is_invalid(tmp_path: Path) -> None:
    report = validate_once(write(tmp_path / "dataset", document=wrong_encoding()))
    assert (report.verdict, failing(report)) == ("invalid", {"BD-ENC-001"})


def test_deselected_rules_say_so(valid_root: Path) -> None:
    report = validate_once(valid_root, select=["BD-VAL", "BD-LAY-003"], ignore=["BD-VAL-005"])
    judged = {tally.rule_id for tally in report.tallies if tally.status == "pass"}
    assert judged == {*(f"BD-VAL-00{number}" for number in (1, 2, 3, 4, 6, 7)), "BD-LAY-003"}
    assert {tally.reason for tally in report.tallies if tally.status == "skipped"} == {"deselected"}
    assert report.options.selected == ("BD-VAL", "BD-LAY-003")
    assert report.options.ignored == ("BD-VAL-005",)


def test_without_digests_one_rule_is_not_judged(valid_root: Path) -> None:
    report = validate_once(valid_root, hash_files=False)
    assert {t.rule_id: t.reason for t in report.tallies if t.status == "skipped"} == {
        "BD-LAY-002": "digests were not computed",
        **dict.fromkeys(WITHOUT_SUBJECT, "no subject"),
    }


def test_nothing_to_examine_is_no_pass_and_changes_no_verdict(tmp_path: Path) -> None:
    document = synthetic.descriptor()
    del document["action_encoding"]
    report = validate_once(write(tmp_path / "dataset", document=document))
    assert {t.rule_id: t.reason for t in report.tallies if t.status == "skipped"} == dict.fromkeys(
        {"BD-ENC-001", *WITHOUT_SUBJECT}, "no subject"
    )
    assert (report.verdict, report.exit_code) == ("valid", 0)


def test_rules_of_streams_that_are_not_claimed_change_no_verdict(tmp_path: Path) -> None:
    root = tmp_path / "dataset"
    synthetic.write_dataset(root, synthetic.bare_tables(), synthetic.bare_descriptor())
    report = validate_once(root)
    unclaimed = {tally.rule_id for tally in report.tallies if tally.status == "not-claimed"}
    assert unclaimed == {rule_id for rule_id, info in CATALOGUE.items() if info.streams or info.layer}
    assert (report.verdict, report.exit_code) == ("valid", 0)
    assert report.funnel is not None
    assert report.funnel.qualified == 3


def test_unreadable_shard_leaves_its_rules_unjudged_and_the_other_shard_judged(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", cells("observations", "speed_mps", {3: 1000.0}), seal=False)
    (root / "raw/shard-00001/controls.parquet").write_bytes(b"no table")
    synthetic.seal_dataset(root)
    report = validate_once(root)
    assert failing(report) == {"BD-TAB-001", "BD-VAL-002"}
    reasons = {tally.reason for tally in report.tallies if tally.rule_id == "BD-VAL-001"}
    assert reasons == {"raw/shard-00001 has no readable controls"}
    assert report.dataset.num_groups == 2


@pytest.mark.parametrize(
    ("options", "rules"),
    [
        ({}, {"BD-LAY-002"}),
        ({"hash_files": False}, {"BD-TAB-001"}),
        ({"ignore": ["BD-LAY-002"]}, {"BD-TAB-001"}),
        ({"select": ["BD-TAB"]}, {"BD-TAB-001"}),
    ],
)
def test_a_damaged_table_is_found_whichever_rule_is_there(
    options: dict[str, Any], rules: set[str], tmp_path: Path
) -> None:
    root = write(tmp_path / "dataset")
    (root / FOLDER / "controls.parquet").write_bytes(b"PAR1")
    report = validate_once(root, **options)
    assert (report.verdict, failing(report)) == ("invalid", rules)


# --- selection


def test_prefixes_and_ids_name_rules() -> None:
    assert select_rules(["BD-BOX", "BD-ENC-001"]) == {"BD-BOX-001", "BD-BOX-002", "BD-BOX-003", "BD-ENC-001"}
    assert select_rules(["BD"]) == frozenset(CATALOGUE)
    assert select_rules([]) == frozenset()


@each("pattern", ["", "BD-", "BD-X", "BD-VAL-999", "bd-val-001", "VAL", "BD-VAL-00", "*"])
def test_a_pattern_that_names_no_rule_is_wrong_usage(pattern: str, valid_root: Path) -> None:
    with pytest.raises(UsageError, match="no rule is called"):
        validate_once(valid_root, select=[pattern])
    with pytest.raises(UsageError, match="no rule is called"):
        validate_once(valid_root, ignore=[pattern])


# --- the gate


@pytest.mark.parametrize(
    ("required", "exit_code"), [pytest.param(n, int(n > 3), id=f"{n} of 3 groups") for n in (0, 2, 3, 4)]
)
def test_required_groups_gate_the_exit_code_and_not_the_verdict(
    required: int, exit_code: int, valid_root: Path
) -> None:
    report = validate_once(valid_root, require_groups=required)
    assert (report.verdict, report.exit_code) == ("valid", exit_code)
    assert report.lacks_groups == (exit_code == 1)


def test_groups_that_do_not_qualify_do_not_count(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["another seed"].tables())
    assert validate_once(root, require_groups=2).exit_code == 0
    assert validate_once(root, require_groups=3).exit_code == 1


def test_gate_outweighs_a_partial_verdict_but_no_error(valid_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert validate(valid_root, require_groups=4, hash_files=False).exit_code == 1
    assert validate(valid_root, require_groups=3, hash_files=False).exit_code == 3
    monkeypatch.setitem(RULES, "BD-LAY-006", raises)
    assert validate(valid_root, require_groups=4).exit_code == 4


def test_gate_needs_the_rules_of_the_funnel(valid_root: Path) -> None:
    for options in ({"select": ["BD-VAL"]}, {"ignore": ["BD-CTL-008"]}):
        with pytest.raises(UsageError, match="the funnel needs every rule on rows"):
            validate_once(valid_root, require_groups=1, **options)  # type: ignore[arg-type]
        assert validate_once(valid_root, **options).funnel is None  # type: ignore[arg-type]
    assert validate_once(valid_root, require_groups=1, ignore=["BD-LAY-009"]).verdict == "partial"


# --- failures of the tool


def raises(*_: Any) -> Any:
    raise RuntimeError("a bug with \x1b[31m\u202ecolours\x07")


@pytest.mark.parametrize("rule_id", ["BD-LAY-006", "BD-VAL-002", "BD-CTL-009", "BD-GRP-002"])
def test_a_rule_that_fails_is_an_error_and_hides_no_other_rule(
    rule_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["another seed"].tables())
    before = validate(root)
    monkeypatch.setitem(RULES, rule_id, raises)
    report = validate(root)
    assert (report.verdict, report.exit_code) == ("error", 4)
    assert [tally.rule_id for tally in report.tallies if tally.status == "error"] == [rule_id]
    assert failing(report) == failing(before)
    others = [(t.rule_id, t.status, t.examined, t.num_findings) for t in report.tallies if t.rule_id != rule_id]
    assert others == [(t.rule_id, t.status, t.examined, t.num_findings) for t in before.tallies if t.rule_id != rule_id]
    assert report.errors
    assert all(rule_id in message and "a bug with" in message for message in report.errors)
    assert all(line.isascii() and line.isprintable() for e in report.errors for line in e.split("\n"))


def test_a_rule_that_fails_while_it_describes_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    monkeypatch.setattr("branchdrive.raw.rules.values.quote", raises)
    report = validate(root)
    assert report.verdict == "error"
    assert status(report, "BD-VAL-002") == "error"


def test_a_failure_outside_the_rules_is_an_error_with_a_report(
    valid_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive.engine.examine.select_candidates", raises)
    report = validate(valid_root)
    assert (report.verdict, report.exit_code) == ("error", 4)
    assert len(report.errors) == len(synthetic.SHARDS)
    assert {t.reason for t in report.tallies if t.rule_id == "BD-VAL-001"} == {f"{FOLDER} could not be judged"}


# --- waivers, through the whole engine


def waiver(location: str = "*", **changes: Any) -> Waiver:
    fields = {"rule": "BD-VAL-002", "reason": "known and accepted", "expires": date(2026, 1, 31), "max_count": 1}
    return Waiver(**{**fields, "location": location, **changes})


@pytest.mark.parametrize(
    ("waivers", "verdict", "states"),
    [
        pytest.param([waiver()], "valid-with-waivers", ["used"], id="used"),
        pytest.param([waiver("*rollout_id=g0.nominal.a1 *")], "valid-with-waivers", ["used"], id="used at its place"),
        pytest.param([waiver("*rollout_id=g1*")], "invalid", ["unused"], id="elsewhere"),
        pytest.param([waiver(rule="BD-VAL-001")], "invalid", ["unused"], id="of another rule"),
        pytest.param([waiver(expires=date(2026, 1, 14))], "invalid", ["expired"], id="expired yesterday"),
        pytest.param([waiver(expires=date(2026, 1, 15))], "valid-with-waivers", ["used"], id="expires today"),
        pytest.param([waiver(), waiver()], "valid-with-waivers", ["used", "unused"], id="twice"),
        pytest.param(
            [waiver(expires=date(2020, 1, 1)), waiver()], "valid-with-waivers", ["expired", "used"], id="renewed"
        ),
    ],
)
def test_waivers_cover_named_failures(waivers: list[Waiver], verdict: str, states: list[str], tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    report = validate_once(root, waivers=waivers, today=date(2026, 1, 15))
    assert report.verdict == verdict
    assert report.exit_code == int(verdict == "invalid")
    assert [outcome.state for outcome in report.waivers] == states
    assert status(report, "BD-VAL-002") == "fail"
    assert report.funnel is not None
    assert report.funnel.qualified == 2


def test_a_waiver_counts_what_reports_count(tmp_path: Path) -> None:
    # Three rows of one attempt are one place and three violations.
    root = write(tmp_path / "dataset", cells("observations", "speed_mps", dict.fromkeys((3, 4, 5), 1000.0)))
    for max_count, state in ((2, "exceeded"), (3, "used")):
        report = validate_once(root, waivers=[waiver(max_count=max_count)], today=date(2026, 1, 15))
        assert [(o.state, o.num_matched) for o in report.waivers] == [(state, 3)]
        assert report.verdict == ("invalid" if state == "exceeded" else "valid-with-waivers")


def test_two_waivers_may_share_the_findings_of_a_rule(tmp_path: Path) -> None:
    attempts = ("g0.nominal.a1", "g0.accelerate_0.30.a1")
    tables = cells("observations", "speed_mps", {row_of("observations", attempt, 3): 1000.0 for attempt in attempts})
    root = write(tmp_path / "dataset", tables)
    first, second = waiver("*rollout_id=g0.nominal.a1 *"), waiver("*rollout_id=g0.acc*")
    today = date(2026, 1, 15)
    assert validate_once(root, waivers=[first], today=today).verdict == "invalid"
    assert validate_once(root, waivers=[first, second], today=today).verdict == "valid-with-waivers"


def test_more_findings_than_are_kept_cannot_be_waived(tmp_path: Path) -> None:
    def orphans(table: Any) -> Any:
        ids = [f"nobody-{i}" for i in range(len(table))]
        return table.set_column(0, table.schema.field(0), [ids])

    root = write(tmp_path / "dataset", edited("controls", orphans))
    accepted = waiver(rule="BD-KEY-004", max_count=10**9)
    counts = waiver(rule="BD-KEY-007", max_count=10**9)
    report = validate_once(root, waivers=[accepted, counts], today=date(2026, 1, 15))
    assert report.verdict == "invalid"
    assert [o.state for o in report.waivers] == ["used", "used"]
    assert [o.num_matched for o in report.waivers] == [100, 31]


def test_a_waived_failure_does_not_outweigh_what_was_not_judged(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    report = validate_once(root, waivers=[waiver()], today=date(2026, 1, 15), hash_files=False)
    assert (report.verdict, report.exit_code) == ("partial", 3)


# --- repetition


def test_validating_twice_says_the_same(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", DEPARTURES["rows of nobody"].tables())
    assert validate(root).to_json() == validate(root).to_json()
    assert outcome(validate(root)) == outcome(validate(str(root)))


def test_progress_is_told_from_none_to_all(valid_root: Path) -> None:
    told: list[tuple[int, int]] = []
    validate_once(valid_root, progress=lambda done, total: told.append((done, total)))
    assert told == [(0, 2), (1, 2), (2, 2)]
