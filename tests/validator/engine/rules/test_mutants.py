"""Every registered defect fails its rule and no other, with the right verdict, place and price."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from tests.mutation import MUTANTS, Mutant
from tests.rule_examples import EXAMPLE_MUTANTS, EXAMPLES_PATH, example, without_numbers
from tests.sampling import THOROUGH
from tests.validator.engine.rules.case import INHERITED, RECOMMENDED, report_on

from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.report import Report
from branchdrive.raw.funnel import STAGES


def failed_rules(mutant: Mutant, report: Report) -> set[str]:
    """Rules that fail on a mutant and not on its base, recommendations that the defect is not about left out."""
    inherited = INHERITED if mutant.is_release else frozenset[str]()
    failed = {tally.rule_id for tally in report.tallies if tally.status == "fail"}
    return failed - inherited - (RECOMMENDED - {mutant.rule})


def _parameters() -> Iterator[Any]:
    """Every mutant; `make test` judges the first of every rule, which is the example of the rule's page."""
    for mutant in MUTANTS:
        is_kept = EXAMPLE_MUTANTS[mutant.rule] is mutant
        yield pytest.param(mutant, id=f"{mutant.rule}-{mutant.name}", marks=() if is_kept else THOROUGH)


@pytest.mark.parametrize("mutant", [*_parameters()])
def test_mutant_fails_exactly_its_rule(mutant: Mutant) -> None:
    report = report_on(mutant)

    assert report.errors == ()
    failed = failed_rules(mutant, report)
    assert mutant.rule in failed, {tally.rule_id: tally.reason for tally in report.tallies if tally.reason}
    assert failed <= mutant.may_fail, [f.message for f in report.findings if f.rule in failed - mutant.may_fail]
    sound = "partial" if mutant.base == "alone" else "valid"
    assert report.verdict == ("invalid" if mutant.is_decisive else sound)
    assert mutant.base == "alone" or report.exit_code == (1 if mutant.is_decisive else 0)

    for finding in report.findings:
        assert finding.expected != finding.found
        assert all(text.isascii() and text.isprintable() and text for text in (finding.expected, finding.found))

    (tally,) = (tally for tally in report.tallies if tally.rule_id == mutant.rule)
    assert tally.num_findings == mutant.findings
    places = [finding.location for finding in tally.findings]
    assert any(mutant.at.items() <= place.items() for place in places), places

    if CATALOGUE[mutant.rule].kind == "qualification":
        assert report.funnel is not None
        stage = CATALOGUE[mutant.rule].stage
        assert report.funnel.lost == ({stage: mutant.lost} if mutant.lost else {})
        reasons = report.funnel.reasons[str(stage)]
        assert reasons[mutant.rule] == mutant.lost
        assert set(reasons) <= mutant.may_fail
        assert not any(report.funnel.reasons[other] for other in STAGES if other != stage)

    if EXAMPLE_MUTANTS[mutant.rule] is mutant:  # the page of the rule shows what is said of it
        shown = json.loads(EXAMPLES_PATH.read_text("utf-8"))[mutant.rule]
        assert without_numbers(example(mutant, report)) == without_numbers(shown)
