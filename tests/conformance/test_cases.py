"""The committed cases: their form, what they reach, and that they are those of the registry."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from tests import conformance_cases
from tests.conformance_bases import BASES
from tests.conformance_cases import case_names
from tests.conformance_maker import Maker, expectation
from tests.validator.engine.rules.case import judged_folder

from branchdrive.contract.rule import CATALOGUE
from branchdrive_conformance.case import Case, base_expectation, cases_dir, load_cases
from branchdrive_conformance.materialize import lay_out_base
from branchdrive_conformance.score import Answer, score

MAX_CASE_BYTES = 20_000
MAX_BYTES = 6_200_000
"""Of all cases with their base datasets."""

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return list(load_cases(cases_dir()))


def test_cases_conform_to_their_schema() -> None:
    schema = json.loads((ROOT / "conformance_tests" / "case.schema.json").read_bytes())
    validator = jsonschema.Draft202012Validator(schema)
    for path in sorted(cases_dir().glob("BD-*/*.json")):
        document = json.loads(path.read_bytes())
        assert [error.message for error in validator.iter_errors(document)] == [], path
        assert path == cases_dir() / f"{document['name']}.json"


def test_a_long_case_has_a_reason() -> None:
    """Most of what a case writes out is what it is about."""
    reasons = json.loads((Path(__file__).parent / "long_cases.json").read_bytes())
    paths = cases_dir().glob("BD-*/*.json")
    long = {f"{path.parent.name}/{path.stem}" for path in paths if path.stat().st_size > MAX_CASE_BYTES}
    assert long == set(reasons)
    assert all(len(reason.split()) >= 5 for reason in reasons.values())


def test_cases_and_bases_are_small() -> None:
    assert sum(path.stat().st_size for path in cases_dir().rglob("*") if path.is_file()) <= MAX_BYTES


@pytest.mark.parametrize("base", BASES)
def test_a_base_dataset_is_as_it_is_described(base: str, tmp_path: Path) -> None:
    lay_out_base(cases_dir(), base, tmp_path / "dataset")
    assert expectation(judged_folder(tmp_path / "dataset")) == base_expectation(cases_dir(), base)


def test_links_lead_to_the_same_place_wherever_a_case_is_written(cases: list[Case]) -> None:
    targets = [step["target"] for case in cases for step in case.recipe if step["op"] == "link"]
    away = {target for target in targets if target.startswith("/")}
    assert away == {"/etc", "/etc/hostname", "/etc/passwd", "/nowhere"}


def test_every_case_that_is_not_as_declared_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reason, names = "2 violations are declared, the validator finds 3", ["BD-TIC-001/a", "BD-TIC-001/b"]

    def broken(_: Maker) -> Case:
        raise AssertionError(reason)

    monkeypatch.setattr(conformance_cases, "_drafts", lambda: dict.fromkeys(names, broken))
    assert conformance_cases._made(tmp_path, names, is_afresh=False) == [(name, reason) for name in names]


def test_cases_are_those_of_the_registry(cases: list[Case]) -> None:
    assert sorted(case.name for case in cases) == sorted(case_names())


def test_every_rule_passes_fails_and_is_at_its_limit(cases: list[Case]) -> None:
    """A rule without a subject in any base dataset passes at a limit."""
    reached: dict[str, set[str]] = defaultdict(set)
    for case in cases:
        for rule in case.rules:
            reached[rule] |= {case.kind, case.expected.rules[rule].status}
    wanted = {"pass", "fail", "boundary"}
    assert {rule: wanted - reached[rule] for rule in CATALOGUE if wanted - reached[rule]} == {}


def test_every_verdict_and_status_of_a_dataset_is_reached(cases: list[Case]) -> None:
    """`error` and `inconclusive` say that a validator failed; no dataset may lead to them."""
    assert {case.expected.verdict for case in cases} == {"valid", "valid-with-waivers", "partial", "invalid"}
    statuses = {outcome.status for case in cases for outcome in case.expected.rules.values()}
    assert statuses == {"pass", "fail", "skipped", "not-claimed"}


def test_a_validator_that_counts_one_violation_of_a_rule_at_most_is_wrong(cases: list[Case]) -> None:
    for case in cases:
        judged = {rule: outcome for rule, outcome in case.expected.rules.items() if rule not in case.expected.free}
        most = max((outcome.violations for outcome in judged.values() if outcome.status == "fail"), default=0)
        capped = {rule: replace(outcome, violations=min(outcome.violations, 1)) for rule, outcome in judged.items()}
        departures = score(case, Answer(case.expected.verdict, capped), CATALOGUE, is_whole=True)
        assert {departure.what for departure in departures} == ({"count"} if most > 1 else set()), case.name


def test_a_case_that_fails_says_so(cases: list[Case]) -> None:
    for case in cases:
        status = case.expected.rules[case.rules[0]].status
        assert (status == "fail") == (case.kind == "fail"), case.name
