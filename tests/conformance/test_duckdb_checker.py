"""The second checker of the raw rules, in SQL, says what the registry of defects and shapes expects."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from tests.mutation import BOUNDARIES, MUTANTS, Boundary, Mutant, new_draft

from branchdrive.contract.rule import CATALOGUE

pytestmark = pytest.mark.skipif(
    find_spec("duckdb") is None, reason="the extra `conformance` is not installed: pip install -e '.[conformance]'"
)

ROOT = Path(__file__).parents[2]
CHECKER = ROOT / "conformance_tests" / "duckdb_checker"

DEFECTS = (
    "BD-LAY-002 byte_of_media_flipped",
    "BD-DOC-003 title_missing",
    "BD-TAB-003 another_unit",
    "BD-VAL-002 throttle_in_percent",
    "BD-KEY-006 actor_twice",
    "BD-CTL-002 window_shorter_by_a_tick",
    "BD-EVD-002 ttc_one_percent_long",
    "BD-WIN-006 no_view_at_the_last_frame",
    "BD-FRM-007 camera_that_changes_its_encoding",
    "BD-RTE-002 target_point_behind_the_ego",
    "BD-GRP-003 another_seed_beyond_double_precision",
    "BD-MAP-001 lane_under_the_ego_without_widths",
    "BD-MAP-006 road_left_out",
    "BD-RPN-003 minus_zero_before_the_branch",
    "BD-RSP-001 mirrored_world",
)
"""A defect of each kind of rule: bytes, documents, tables, rows, rollouts, groups and the dataset."""

SHAPES = (
    "two_cones_at_the_corridor_reading_1",
    "further_nominal_under_its_own_variant",
    "maps_in_another_order",
    "actors_in_another_order",
)
"""Shapes at the limit of what rules accept."""


def _chosen() -> list[Mutant | Boundary]:
    defects = [case for case in MUTANTS if f"{case.rule} {case.name}" in DEFECTS]
    shapes = [case for case in BOUNDARIES if case.name in SHAPES]
    assert len(defects) + len(shapes) == len(DEFECTS) + len(SHAPES)
    return [*defects, *shapes]


CASES = _chosen()


def _run(*arguments: str | Path) -> str:
    command = [sys.executable, CHECKER, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    folders = {case.name: tmp_path_factory.mktemp("case") / "dataset" for case in CASES}
    for case in CASES:
        draft = new_draft(case.base)
        case.edit(draft)
        draft.write(folders[case.name])
    lines = _run("--batch", *folders.values()).splitlines()
    return dict(zip(folders, map(json.loads, lines), strict=True))


@pytest.mark.parametrize("case", [case for case in CASES if isinstance(case, Mutant)], ids=lambda case: case.name)
def test_a_defect_fails_its_rule_alone_at_its_place(case: Mutant, reports: dict[str, dict[str, Any]]) -> None:
    report = reports[case.name]
    failed = {rule["id"]: rule["num_findings"] for rule in report["rules"] if rule["status"] == "fail"}
    assert failed[case.rule] == case.findings
    assert set(failed) <= case.may_fail
    places = [finding["location"] for finding in report["findings"] if finding["rule"] == case.rule]
    assert any(case.at.items() <= place.items() for place in places)
    sound = "partial" if case.base == "media" else "valid"  # rules on pixels are not judged
    assert report["verdict"] == ("invalid" if case.is_decisive else sound)


@pytest.mark.parametrize("case", [case for case in CASES if isinstance(case, Boundary)], ids=lambda case: case.name)
def test_a_shape_at_the_limit_is_valid(case: Boundary, reports: dict[str, dict[str, Any]]) -> None:
    statuses = {rule["id"]: rule["status"] for rule in reports[case.name]["rules"]}
    assert "fail" not in statuses.values()
    assert {statuses[rule] for rule in case.rules} == {case.status}
    assert reports[case.name]["verdict"] == "valid"


def test_rules_and_places_have_the_form_of_the_report_schema(reports: dict[str, dict[str, Any]]) -> None:
    schema = json.loads((ROOT / "schemas" / "v0.1" / "report.schema.json").read_text(encoding="utf-8"))
    for report in reports.values():
        jsonschema.validate(report["rules"], schema["properties"]["rules"])
        for finding in report["findings"]:
            jsonschema.validate(finding["location"], schema["$defs"]["finding"]["properties"]["location"])


RECOMMENDED = {"BD-RPN-004", "BD-FRM-004", "BD-FRM-010", "BD-FRM-011"}
"""Not written in SQL; they recommend, and decide nothing."""

OF_IMAGES = {"BD-FRM-005", "BD-FRM-006", "BD-FRM-008", "BD-FRM-009"}
"""Not written in SQL: bytes and pixels of images."""


def test_it_claims_every_raw_rule_but_those_of_images_and_some_recommendations() -> None:
    raw = [rule_id for rule_id, rule in CATALOGUE.items() if rule.layer is None]
    assert _run("--claims").split() == [rule_id for rule_id in raw if rule_id not in RECOMMENDED | OF_IMAGES]
    assert {CATALOGUE[rule_id].level for rule_id in RECOMMENDED} == {"SHOULD"}


def test_it_shares_nothing_with_the_validator() -> None:
    for file in CHECKER.glob("*.py"):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not any(name.startswith("branchdrive") for name in names), file
