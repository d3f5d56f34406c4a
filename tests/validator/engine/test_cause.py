"""Causes by group: what nothing else explains, where it is, and how far it explains other rules."""

from __future__ import annotations

import io
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from tests.audits import validate_once
from tests.mutation import Draft, new_draft

from branchdrive.cli.formats.outcome import Outcome, cautions, verdict_level
from branchdrive.cli.formats.table import renderer
from branchdrive.cli.funnel import lost_groups
from branchdrive.cli.text import render_report
from branchdrive.contract.resources import load_resource
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import printable
from branchdrive.engine import group_failures, judge, tally
from branchdrive.engine.cause import Cause
from branchdrive.engine.relation import _COMPARED, _COMPUTED, POSSIBLE
from branchdrive.engine.report import Report
from branchdrive.engine.response_table import response_doubt
from branchdrive.engine.validate import validate


def _attempts(draft: Draft, *group_ids: str) -> list[str]:
    rows = (draft.take("rollouts", group_id=group_id)["rollout_id"].to_pylist() for group_id in group_ids)
    return [str(name) for names in rows for name in names]


def _in_km_per_h(draft: Draft, *group_ids: str) -> None:
    rollouts = _attempts(draft, *group_ids)
    draft.set("observations", "speed_mps", lambda speed: 3.6 * speed, rollout_id=rollouts)


def _cause(report: Report, rule_id: str) -> Cause:
    (cause,) = (cause for cause in report.causes.first if cause.rule_id == rule_id)
    return cause


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Report:
    """Speeds of g0 are in another unit, and times to collision of g1 are wrong by themselves."""
    draft = new_draft()
    _in_km_per_h(draft, "g0")
    draft.set("evidence", "ttc_s", lambda ttc_s: ttc_s and 0.5 * ttc_s, rollout_id=_attempts(draft, "g1"))
    return validate_once(draft.write(tmp_path_factory.mktemp("causes") / "dataset"))


def test_a_cause_says_where_it_is_and_what_it_may_explain(report: Report) -> None:
    cause = _cause(report, "BD-MOT-006")
    (extent,) = cause.extents
    attempts = [f for f in report.findings if f.rule == "BD-MOT-006"]
    assert (extent.groups, extent.num_groups, extent.num_attempts) == (("g0",), 1, len(attempts))
    assert (cause.columns, cause.num_groups, cause.num_attempts) == (("speed_mps",), 1, len(attempts))
    assert cause.first is not None and "km/h" in cause.first.found
    explained = {one.rule_id: (one.num_groups, one.num_attempts) for one in cause.consequences}
    assert {"BD-MOT-001", "BD-EVD-002"} <= {*explained}
    assert "BD-MOT-001" not in {each.rule_id for each in report.causes.first}


def test_a_rule_with_two_causes_is_explained_group_by_group(report: Report) -> None:
    counts = {
        group: sum(f.rule == "BD-EVD-002" and f.group_id == group for f in report.findings) for group in ("g0", "g1")
    }
    assert min(counts.values()) > 0
    following = report.causes.following["BD-EVD-002"]
    assert following.causes == (("BD-MOT-006", counts["g0"]),)
    assert (following.num_explained, following.num_failed) == (counts["g0"], sum(counts.values()))
    assert _cause(report, "BD-EVD-002").extents[0].groups == ("g1",)
    said = (
        f"may follow from BD-MOT-006 ({counts['g0']} of {sum(counts.values())} attempts): look there first; "
        f"{counts['g1']} do not"
    )
    assert said in " ".join(render_report(report, io.StringIO()).split())
    assert said in renderer("markdown")(report)


def test_every_form_begins_with_the_causes(report: Report) -> None:
    text, page = render_report(report, io.StringIO()), renderer("markdown")(report)
    assert text.index("What to look at first") < text.index("Why attempts and groups do not qualify")
    assert page.index("## What to look at first") < page.index("## Why attempts and groups do not qualify")
    document = report.to_json()
    assert [each["rule"] for each in document["causes"]] == [each.rule_id for each in report.causes.first]
    Draft202012Validator(load_resource("report.schema.json")).validate(document)


def test_a_cause_of_a_whole_shard_names_it(tmp_path: Path) -> None:
    draft = new_draft()
    _in_km_per_h(draft, "g0", "g1", "g2")
    found = validate_once(draft.write(tmp_path / "dataset"))
    where = {cause.info.id: cause.where for cause in Outcome.of(found, 1).causes}
    assert "BD-MOT-006" not in where  # the rule on the whole dataset says it
    assert "BD-MOT-006" in [one.rule_id for one in _cause(found, "BD-RSP-007").consequences]


def test_the_cap_of_findings_weakens_no_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft = new_draft()
    _in_km_per_h(draft, "g0", "g1")
    root = draft.write(tmp_path / "dataset")
    whole = [group.reason for group in validate_once(root).groups or ()]
    for module in (judge, tally):
        monkeypatch.setattr(module, "MAX_FINDINGS_PER_RULE", 1)
    capped = validate(root)
    assert sum(f.rule == "BD-MOT-006" for f in capped.findings) == 1
    assert [group.reason for group in capped.groups or ()] == whole
    assert all(", in speed_mps: expected" in reason and "km/h" in reason for reason in whole[:2])


def test_a_group_that_is_lost_early_says_what_else_it_breaks(tmp_path: Path) -> None:
    draft = new_draft()
    (rollout_id,) = (name for name in _attempts(draft, "g0") if "brake_0.50" in name)
    draft.set("controls", "applied_brake", 0.25, rollout_id=rollout_id, tick=120)
    draft.set("evidence", "separation_m", lambda gap: gap and gap + 1.0, rollout_id=_attempts(draft, "g0"))
    found = validate_once(draft.write(tmp_path / "dataset"))
    group = next(group for group in found.groups or () if group.group_id == "g0")
    assert group.stage == "Controls valid" and "BD-EVD-001" in group.further
    assert not {*group.further} & {*group.rules}
    (same,) = lost_groups(found)
    assert (same.names, same.further) == (("g0",), group.further)


def test_groups_that_lack_the_same_are_one_row(tmp_path: Path) -> None:
    draft = new_draft()
    _in_km_per_h(draft, "g0", "g1")
    (same,) = lost_groups(validate_once(draft.write(tmp_path / "dataset")))
    assert (same.names, same.text) == (("g0", "g1"), "g0, g1")


def test_responses_of_wrong_speeds_are_in_doubt(report: Report) -> None:
    doubt = response_doubt(report)
    assert doubt.startswith("In doubt: BD-MOT-006, BD-MOT-001 fail in 1 of 3 groups, ")
    assert doubt in " ".join(render_report(report, io.StringIO()).split())


def test_responses_are_not_in_doubt_where_evidence_alone_is_wrong(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("evidence", "separation_m", lambda gap: gap and gap + 1.0)
    assert response_doubt(validate_once(draft.write(tmp_path / "dataset"))) == ""


def test_a_valid_dataset_of_which_nothing_can_be_used_says_so(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("evidence", "separation_m", lambda gap: gap and gap + 1.0)
    root = draft.write(tmp_path / "dataset")
    found = validate_once(root)
    assert (found.verdict, found.exit_code, found.num_qualified) == ("valid", 0, 0)
    (caution,) = cautions(found)
    assert verdict_level(found) == "warning"
    for text in (render_report(found, io.StringIO()), renderer("markdown")(found)):
        assert "--require-groups N" in " ".join(text.split())
    assert caution.startswith("No branch group qualifies")
    assert cautions(validate_once(root, require_groups=1)) == []


def test_groups_of_which_no_finding_is_kept_are_in_the_cause_of_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draft = new_draft()
    _in_km_per_h(draft, "g0", "g1")
    root = draft.write(tmp_path / "dataset")
    monkeypatch.setattr(group_failures, "MAX_KEPT", 1)
    cause = _cause(validate(root), "BD-MOT-006")
    assert (cause.num_groups, cause.extents[0].groups) == (2, ("g0", "g1"))


def test_findings_of_groups_with_names_that_are_long_when_printed_are_found(tmp_path: Path) -> None:
    draft = new_draft()
    _in_km_per_h(draft, "g0")
    name = "\N{GREEK SMALL LETTER ALPHA}" * 60
    draft.set("rollouts", "group_id", name, group_id="g0")
    cause = _cause(validate_once(draft.write(tmp_path / "dataset"), ignore=["BD-VAL-004"]), "BD-MOT-006")
    assert cause.first is not None and cause.first.group_id == cause.extents[0].groups[0] == printable(name)


def test_no_rule_may_be_why_it_fails_itself() -> None:
    own = {rule: {*POSSIBLE.get(rule, ()), *_COMPUTED.get(rule, ())} for rule in CATALOGUE}
    TopologicalSorter({rule: causes | {*(_COMPARED.get(rule) or ())} for rule, causes in own.items()}).prepare()
    # What follows from any rule explains none that a comparison follows from.
    assert not {rule for rule, causes in _COMPARED.items() if causes is None} & set[str]().union(*own.values())
