"""Commands of the core in a folder full of hostile module names: nothing there runs, and nothing changes."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

from tests.hostile_folder import infest, marks, run_command, run_module

from branchdrive import validate

OPTIONS = ("--jobs", 1, "--format", "json")


def report_of(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert done.stderr == ""
    return without_path(json.loads(done.stdout))


def without_path(document: dict[str, Any]) -> dict[str, Any]:
    del document["dataset"]["path"]
    return document


def test_validate_runs_nothing_of_a_folder(valid_root: Path, tmp_path: Path) -> None:
    marks_dir, dataset = tmp_path / "marks", shutil.copytree(valid_root, tmp_path / "dataset")
    packages = infest(dataset, marks_dir)
    outside = without_path(json.loads(json.dumps(validate(dataset).to_json())))
    assert outside["verdict"] == "invalid"
    assert {finding["rule"] for finding in outside["findings"]} == {"BD-LAY-004", "BD-LAY-009"}
    script = run_command("branchdrive-validate", ".", *OPTIONS, cwd=dataset, path="")
    module = run_module("validate", "..", *OPTIONS, cwd=packages)
    assert [report_of(script), report_of(module)] == [outside] * 2
    assert report_of(run_module("validate", valid_root, *OPTIONS, cwd=dataset))["verdict"] == "valid"
    assert marks(marks_dir) == []
