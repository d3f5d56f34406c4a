"""The second checker of the raw rules, in SQL, says what the conformance cases expect: statuses, counts and places."""

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
from tests.mutation import new_draft
from tests.sampling import THOROUGH
from tests.validator.engine.rules.empty_subjects import EMPTIED

from branchdrive.contract.rule import CATALOGUE
from branchdrive_conformance.case import cases_dir, load_case
from branchdrive_conformance.materialize import DATASET_DIR, materialize
from branchdrive_conformance.score import Answer, score

pytestmark = pytest.mark.skipif(
    find_spec("duckdb") is None, reason="the extra `conformance` is not installed: pip install -e '.[conformance]'"
)

ROOT = Path(__file__).parents[2]
CHECKER = ROOT / "conformance_tests" / "duckdb_checker"

FEW = (
    "BD-LAY-002/byte_of_media_flipped",
    "BD-DOC-003/title_missing",
    "BD-TAB-003/another_unit",
    "BD-VAL-002/throttle_in_percent",
    "BD-CTL-002/window_shorter_by_a_tick",
    "BD-GRP-003/another_seed_beyond_double_precision",
    "BD-KEY-004/actor_of_a_rollout_in_another_shard",
    "BD-MAP-001/lane_under_the_ego_without_widths",
)
"""Defects of bytes, a document, a table, a row, a rollout, a group and the dataset, and a shape at a limit."""

FURTHER = (
    "BD-KEY-006/actor_twice",
    "BD-EVD-002/ttc_one_percent_long",
    "BD-WIN-006/no_view_at_the_last_frame",
    "BD-FRM-007/camera_that_changes_its_encoding",
    "BD-RTE-002/target_point_behind_the_ego",
    "BD-MAP-006/road_left_out",
    "BD-RPN-003/minus_zero_before_the_branch",
    "BD-RSP-001/mirrored_world",
    "BD-FRM-002/checksum_of_another_image",
    "BD-EVD-001/two_cones_at_the_corridor_reading_1",
    "BD-GRP-007/further_nominal_under_its_own_variant",
    "BD-MAP-004/maps_in_another_order",
    "BD-RPN-003/actors_in_another_order",
)


def _run(*arguments: str | Path) -> str:
    command = [sys.executable, CHECKER, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


@pytest.fixture(scope="module", params=[FEW, pytest.param(FURTHER, marks=THOROUGH)], ids=["few", "further"])
def reports(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What the checker says of the datasets of cases, by case, in one process."""
    folders = {name: tmp_path_factory.mktemp("cases") / "case" for name in request.param}
    for name, folder in folders.items():
        materialize(cases_dir(), load_case(cases_dir(), cases_dir() / f"{name}.json"), folder)
    lines = _run("--batch", *(folder / DATASET_DIR for folder in folders.values())).splitlines()
    return dict(zip(folders, map(json.loads, lines), strict=True))


@pytest.fixture(scope="module")
def claims() -> list[str]:
    return _run("--claims").split()


def test_it_says_what_cases_expect_of_every_rule_that_it_claims(
    claims: list[str], reports: dict[str, dict[str, Any]]
) -> None:
    cases = {name: load_case(cases_dir(), cases_dir() / f"{name}.json") for name in reports}
    found = {name: score(case, Answer.of(reports[name]), claims, is_whole=False) for name, case in cases.items()}
    assert found == {name: [] for name in cases}


@pytest.mark.parametrize("is_every", [False, pytest.param(True, marks=THOROUGH)])
def test_it_skips_rules_without_a_subject(is_every: bool, claims: list[str], tmp_path: Path) -> None:
    """In datasets that one process judges: one of twelve of those that leave rules without, or every one."""
    chosen, roots = [*EMPTIED][:: 1 if is_every else 12], []
    for name in chosen:
        draft = new_draft(EMPTIED[name].base)
        EMPTIED[name].edit(draft)
        roots.append(draft.write(tmp_path / f"{len(roots)}"))
    lines = _run("--batch", *roots).splitlines()
    for name, line in zip(chosen, lines, strict=True):
        status = {rule["id"]: rule["status"] for rule in json.loads(line)["rules"]}
        judged = [rule for rule in EMPTIED[name].rules if rule in claims]
        assert {rule: status[rule] for rule in judged} == dict.fromkeys(judged, "skipped"), name


def test_rules_and_places_have_the_form_of_the_report_schema(reports: dict[str, dict[str, Any]]) -> None:
    schema = json.loads((ROOT / "schemas" / "v0.1" / "report.schema.json").read_text(encoding="utf-8"))
    for report in reports.values():
        jsonschema.validate(report["rules"], schema["properties"]["rules"])
        for finding in report["findings"]:
            jsonschema.validate(finding["location"], schema["$defs"]["finding"]["properties"]["location"])


RECOMMENDED = {
    "BD-TAB-007",
    "BD-VAL-007",
    "BD-RSP-016",
    "BD-RPN-004",
    "BD-RPN-006",
    "BD-FRM-004",
    "BD-FRM-010",
    "BD-FRM-011",
}
"""Not written in SQL; they recommend, and decide nothing."""

OF_IMAGES = {
    "BD-FRM-005",
    "BD-FRM-006",
    "BD-FRM-008",
    "BD-FRM-009",
    "BD-FRM-012",
    "BD-FRM-016",
    "BD-FRM-017",
    "BD-RSP-014",
}
"""Not written in SQL: bytes and pixels of images, and what they show after a response."""

OF_WHOLE_DATASETS = {"BD-ACT-006", "BD-ACT-007", "BD-MAP-010", "BD-MOT-006", "BD-GRP-010", "BD-GRP-011"}
"""Not written in SQL: what nearly all tracks of a dataset do, which way lanes are driven, motion by attempts, and the
order in which candidates end."""


def test_it_claims_every_raw_rule_but_those_of_images_and_some_recommendations(claims: list[str]) -> None:
    raw = [rule_id for rule_id, rule in CATALOGUE.items() if rule.layer is None]
    assert claims == [rule_id for rule_id in raw if rule_id not in RECOMMENDED | OF_IMAGES | OF_WHOLE_DATASETS]
    assert {CATALOGUE[rule_id].level for rule_id in RECOMMENDED} == {"SHOULD"}


def test_it_shares_nothing_with_the_validator() -> None:
    for file in CHECKER.glob("*.py"):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not any(name.startswith("branchdrive") for name in names), file
