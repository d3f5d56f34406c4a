"""Every registered defect fails its rule and no other, with the right verdict, place and price."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.mutation import MUTANTS, Mutant, new_draft

from branchdrive.audit.engine import validate
from branchdrive.audit.funnel import STAGES
from branchdrive.audit.report import Report
from branchdrive.contract.catalogue import CATALOGUE


def failed_rules(report: Report) -> set[str]:
    return {tally.rule_id for tally in report.tallies if tally.status == "fail"}


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: f"{m.rule}-{m.name}")
def test_mutant_fails_exactly_its_rule(mutant: Mutant, tmp_path: Path) -> None:
    draft = new_draft(mutant.base)
    mutant.edit(draft)
    report = validate(draft.write(tmp_path / "dataset"))

    assert report.errors == ()
    failed = failed_rules(report)
    assert mutant.rule in failed
    assert failed <= mutant.may_fail, [f.message for f in report.findings if f.rule not in mutant.may_fail]
    assert (report.verdict, report.exit_code) == (("invalid", 1) if mutant.is_decisive else ("valid", 0))

    for finding in report.findings:
        assert finding.expected != finding.found
        assert all(text.isascii() and text.isprintable() and text for text in (finding.expected, finding.found))

    (tally,) = (tally for tally in report.tallies if tally.rule_id == mutant.rule)
    assert tally.num_findings == mutant.findings
    places = [finding.location for finding in tally.findings]
    assert any(mutant.at.items() <= place.items() for place in places), places

    if not mutant.is_decisive:
        assert report.funnel is not None
        stage = CATALOGUE[mutant.rule].stage
        assert report.funnel.lost == ({stage: mutant.lost} if mutant.lost else {})
        reasons = report.funnel.reasons[str(stage)]
        assert reasons[mutant.rule] == mutant.lost
        assert set(reasons) <= mutant.may_fail
        assert not any(report.funnel.reasons[other] for other in STAGES if other != stage)
