"""The verdict table of spec/07-rules.md, row by row and in its order, on the tallies of rules."""

from __future__ import annotations

from datetime import date

import pytest
from tests.each import each

from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.finding import Finding
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE, Tally
from branchdrive.engine.verdict import decide, is_waived
from branchdrive.engine.waiver import Waiver, apply_waivers
from branchdrive.exit_code import EXIT_OF_VERDICT

STRUCTURE, CLAIM, QUALIFICATION = "BD-VAL-001", "BD-ENC-001", "BD-CTL-008"


def passed(rule_id: str) -> Tally:
    return Tally(rule_id, examined=5, total=5)


def failed(rule_id: str, num_findings: int = 1) -> Tally:
    tally = Tally(rule_id, examined=num_findings, total=num_findings, num_findings=num_findings)
    tally.keep(Finding.of(rule_id, Mismatch({"tick": i}, "x", "y")) for i in range(num_findings))
    return tally


def waived(rule_id: str, num_findings: int = 1) -> Tally:
    tally = failed(rule_id, num_findings)
    apply_waivers({rule_id: tally}, [Waiver(rule_id, "*", "accepted", date(2030, 1, 1), 1000)], date(2026, 1, 1))
    return tally


def unjudged(rule_id: str) -> Tally:
    return Tally(rule_id, unjudged="deselected")


def not_claimed(rule_id: str) -> Tally:
    return Tally(rule_id, is_claimed=False)


def broken(rule_id: str) -> Tally:
    return Tally(rule_id, examined=5, total=5, errors=["a bug"])


@each(
    ("tallies", "verdict"),
    [
        pytest.param([passed(STRUCTURE), passed(CLAIM), passed(QUALIFICATION)], "valid", id="everything passes"),
        pytest.param([], "valid", id="no rules"),
        pytest.param([Tally(STRUCTURE)], "valid", id="nothing to examine changes no verdict"),
        pytest.param([failed(QUALIFICATION)], "valid", id="a qualification failure changes no verdict"),
        pytest.param([unjudged(QUALIFICATION)], "valid", id="a qualification rule that was not judged neither"),
        pytest.param([not_claimed(STRUCTURE)], "valid", id="what is not claimed changes no verdict"),
        pytest.param([waived(STRUCTURE)], "valid-with-waivers", id="waived structure"),
        pytest.param([waived(CLAIM), passed(STRUCTURE)], "valid-with-waivers", id="waived claim"),
        pytest.param([unjudged(STRUCTURE)], "partial", id="structure not judged"),
        pytest.param([unjudged(CLAIM)], "partial", id="claim not judged"),
        pytest.param([unjudged(STRUCTURE), waived(CLAIM)], "partial", id="partial over waivers"),
        pytest.param([failed(STRUCTURE)], "invalid", id="structure fails"),
        pytest.param([failed(CLAIM)], "invalid", id="claim fails"),
        pytest.param([failed(STRUCTURE), waived(CLAIM)], "invalid", id="invalid over waivers"),
        pytest.param([failed(STRUCTURE), unjudged(CLAIM)], "invalid", id="invalid over partial"),
        pytest.param([broken(STRUCTURE), failed(CLAIM), unjudged("BD-VAL-002")], "error", id="error over all"),
        pytest.param([broken(QUALIFICATION), passed(STRUCTURE)], "error", id="also of a rule that does not decide"),
    ],
)
def test_first_row_that_applies_decides(tallies: list[Tally], verdict: str) -> None:
    assert decide(tallies) == verdict
    assert decide(tallies[::-1]) == verdict


def test_failure_outside_any_rule_is_an_error() -> None:
    assert decide([passed(STRUCTURE)], ["a worker died"]) == "error"
    assert decide([failed(STRUCTURE)], ["a worker died"]) == "error"


def test_exit_codes_are_the_documented_ones() -> None:
    assert EXIT_OF_VERDICT == {"valid": 0, "valid-with-waivers": 0, "invalid": 1, "partial": 3, "error": 4}


@each(
    ("tally", "status", "reason"),
    [
        pytest.param(passed(STRUCTURE), "pass", None, id="pass"),
        pytest.param(failed(STRUCTURE), "fail", None, id="fail"),
        pytest.param(waived(STRUCTURE), "fail", None, id="waived is still a failure"),
        pytest.param(Tally(STRUCTURE, total=3), "skipped", "no subject", id="no subject"),
        pytest.param(unjudged(STRUCTURE), "skipped", "deselected", id="not judged"),
        pytest.param(
            Tally(STRUCTURE, 5, 5, unjudged="raw/shard-00001 has no readable controls"), "skipped",
            "raw/shard-00001 has no readable controls", id="judged in part",
        ),
        pytest.param(
            Tally(STRUCTURE, 5, 5, 1, [], unjudged="raw/shard-00001 has no readable controls"), "fail",
            "raw/shard-00001 has no readable controls", id="a failure in the part that was judged",
        ),
        pytest.param(
            not_claimed("BD-EVD-001"), "not-claimed", "the descriptor claims no stream that this rule is about",
            id="not claimed",
        ),
        pytest.param(broken(STRUCTURE), "error", "a bug", id="error"),
    ],
)  # fmt: skip
def test_status_and_reason_of_a_rule(tally: Tally, status: str, reason: str | None) -> None:
    assert (tally.status, tally.reason) == (status, reason)


def test_totals_of_shards_add_up() -> None:
    total = Tally(STRUCTURE)
    for part in (failed(STRUCTURE, 60), passed(STRUCTURE), failed(STRUCTURE, 70)):
        total.add(part)
    assert (total.examined, total.total, total.num_findings) == (135, 135, 130)
    assert len(total.findings) == MAX_FINDINGS_PER_RULE


def test_more_findings_than_are_kept_cannot_be_waived() -> None:
    assert is_waived(waived(STRUCTURE, MAX_FINDINGS_PER_RULE))
    assert not is_waived(waived(STRUCTURE, MAX_FINDINGS_PER_RULE + 1))
    assert decide([waived(STRUCTURE, MAX_FINDINGS_PER_RULE + 1)]) == "invalid"


def test_these_rules_are_of_the_kinds_they_stand_for() -> None:
    assert [CATALOGUE[rule_id].kind for rule_id in (STRUCTURE, CLAIM, QUALIFICATION)] == [
        "structure", "claim", "qualification",
    ]  # fmt: skip
