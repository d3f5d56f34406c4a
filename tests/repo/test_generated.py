"""Generated regions and record schemas are fresh, and the generator does what it says."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from tests.each import each
from tests.mismatch import pointers
from tests.repo.checkout import CHAPTERS, ROOT

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import TABLES
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.generate import REGIONS, generated_files, main, render_regions, stale_files
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import UsageError


def test_nothing_is_stale() -> None:
    assert [path.as_posix() for path in stale_files(ROOT)] == []


def test_check_reports_success(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check"]) == 0
    assert capsys.readouterr().out == ""


def test_every_region_stands_in_one_chapter() -> None:
    used = Counter(
        name for path in CHAPTERS for name in re.findall(r"<!-- generated: (\S+) -->", path.read_text("utf-8"))
    )
    assert used == Counter(REGIONS.keys())


def test_unknown_region_is_an_error() -> None:
    with pytest.raises(UsageError, match="'nonsense' is unknown"):
        render_regions("<!-- generated: nonsense -->\n<!-- end generated -->")


def test_rendering_twice_changes_nothing() -> None:
    once = render_regions("<!-- generated: limits -->\n<!-- end generated -->")
    assert render_regions(once) == once


def test_a_folder_that_is_no_checkout_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="has no spec/ folder"):
        generated_files(tmp_path)


@pytest.fixture
def edited_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of spec and schemas in which one generated region was edited and one record schema removed."""
    shutil.copytree(ROOT / "spec", tmp_path / "spec")
    shutil.copytree(ROOT / "schemas", tmp_path / "schemas")
    shutil.copytree(ROOT / "docs" / "rules", tmp_path / "docs" / "rules")
    chapter = tmp_path / "spec" / "09-security.md"
    chapter.write_text(chapter.read_text("utf-8").replace("400,000", "300,000"), "utf-8")
    schemas = tmp_path / "schemas" / f"v{SPEC_VERSION}"
    (schemas / "rollout.schema.json").unlink()
    monkeypatch.setattr("branchdrive.contract.generate.schema_dir", lambda: schemas)
    return tmp_path


def test_check_names_stale_files_and_changes_nothing(edited_checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check"]) == 1
    stale = ["spec/09-security.md", f"schemas/v{SPEC_VERSION}/rollout.schema.json"]
    assert capsys.readouterr().out == "".join(f"stale: {path}\n" for path in stale)
    assert [path.as_posix() for path in stale_files(edited_checkout)] == stale


def test_writing_restores_stale_files(edited_checkout: Path) -> None:
    assert main([]) == 0
    assert stale_files(edited_checkout) == []
    restored = edited_checkout / "spec" / "09-security.md"
    assert restored.read_bytes() == (ROOT / "spec" / "09-security.md").read_bytes()


def test_ranges_are_printed_in_full() -> None:
    chapter = (ROOT / "spec" / "05-raw-streams.md").read_text("utf-8")
    assert "-3.1415928 to 3.1415928" in chapter


def rollout_record(**changes: Any) -> dict[str, Any]:
    """A conforming rollouts row as a record."""
    filler: dict[str, Any] = {"string": "x", "int32": 1, "int64": 1, "float32": 1.0, "list<float64>": [0.0, 1.0]}
    record = {
        column.name: column.values[0] if column.values else filler[column.type] for column in TABLES["rollouts"].columns
    }
    record |= load_action_bank()["brake_0.50"].effective_action()
    record |= {"role": "intervention", "status": "complete", "status_reason": None}
    return record | changes


def test_rollout_record_conforms() -> None:
    assert schema_mismatches(rollout_record(), "rollout.schema.json") == []


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"role": "nominal", "nominal_rollout_id": None}, id="a nominal names no nominal"),
        pytest.param({"status": "partial", "status_reason": "crash"}, id="an incomplete attempt has a reason"),
        pytest.param({"result_num_static_collisions": None}, id="what was not monitored is null"),
    ],
)
def test_rollout_record_with_other_conditions_conforms(changes: dict[str, Any]) -> None:
    assert schema_mismatches(rollout_record(**changes), "rollout.schema.json") == []


@each(
    ("pointer", "changes"),
    [
        pytest.param("/attempt", {"attempt": 0}, id="below its range"),
        pytest.param("/trigger_confidence", {"trigger_confidence": 1.5}, id="above its range"),
        pytest.param("/rollout_id", {"rollout_id": "A/b"}, id="off its pattern"),
        pytest.param("/rollout_id", {"rollout_id": "a\n"}, id="a line feed after its pattern"),
        pytest.param("/role", {"role": "spectator"}, id="outside its vocabulary"),
        pytest.param("/seed", {"seed": None}, id="null without availability"),
        pytest.param("/seed", {"seed": "1"}, id="of another type"),
        pytest.param("/route_x_m/0", {"route_x_m": [None, 1.0]}, id="null inside a list"),
        pytest.param("/status_reason", {"status_reason": "crash"}, id="a reason of a complete attempt"),
        pytest.param("/status_reason", {"status": "partial"}, id="an incomplete attempt without a reason"),
        pytest.param("/nominal_rollout_id", {"role": "nominal"}, id="a nominal that names a nominal"),
        pytest.param("/nominal_rollout_id", {"nominal_rollout_id": None}, id="an intervention without nominal"),
        pytest.param("/trigger_tick", {"trigger_tick": None}, id="a branch without its trigger"),
        pytest.param("/effective_brake_value", {"effective_brake_value": None}, id="a floor without value"),
        pytest.param("/effective_steer_value", {"effective_steer_value": 0.0}, id="a value without floor"),
        pytest.param("/", {"note": "x"}, id="an undeclared property"),
    ],
)
def test_broken_rollout_record_is_refused(pointer: str, changes: dict[str, Any]) -> None:
    found = schema_mismatches(rollout_record(**changes), "rollout.schema.json")
    assert pointer in pointers(found)


def test_group_record_holds_shared_values_and_attempts() -> None:
    row = rollout_record()
    shared = ("group_id", "scenario_type", "town", "route_id", "environment", "seed", "repetition", "branch_tick")
    attempt = ("rollout_id", "role", "status", "attempt", "protocol_variant", "action_key", "nominal_rollout_id")
    group = {key: row[key] for key in shared} | {"attempts": [{key: row[key] for key in attempt}]}
    assert schema_mismatches(group, "branch-group.schema.json") == []
    assert schema_mismatches(group | {"attempts": []}, "branch-group.schema.json") != []
    group["attempts"][0]["nominal_rollout_id"] = None
    found = schema_mismatches(group, "branch-group.schema.json")
    assert pointers(found) == ["/attempts/0/nominal_rollout_id"]
