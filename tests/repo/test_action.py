"""The action for GitHub and the hook of pre-commit do what they say; scripts of the action are run as a runner does."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.repo.checkout import ROOT
from tests.sampling import THOROUGH, sampled
from tests.validator.cli.formats.reading import annotations
from tests.validator.engine import datasets
from tests.waiting import PATIENCE_S

ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text("utf-8"))
STEPS: dict[str, Any] = {step["id"]: step for step in ACTION["runs"]["steps"]}


@pytest.fixture
def runner(tmp_path: Path) -> Path:
    """Temporary folder of a runner in which the first step has installed the distribution."""
    bin_dir = tmp_path / "branchdrive" / "bin"
    bin_dir.mkdir(parents=True)
    installed = Path(sys.executable).parent
    for name in ("python", "branchdrive-validate"):
        (bin_dir / name).symlink_to(installed / name)
    return tmp_path


def run_step(step: str, runner: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """Run the script of a step with these inputs, others at their defaults."""
    values = {f"BRANCHDRIVE_{name.upper()}": str(it.get("default", "")) for name, it in ACTION["inputs"].items()}
    values |= {f"BRANCHDRIVE_{name.upper()}": value for name, value in inputs.items()}
    files = {f"GITHUB_{name}": str(runner / name.lower()) for name in ("OUTPUT", "STEP_SUMMARY")}
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", STEPS[step]["run"]],
        cwd=runner, env={**os.environ, **values, **files, "RUNNER_TEMP": str(runner)},
        capture_output=True, text=True, check=False, timeout=PATIENCE_S,
    )  # fmt: skip


def outputs(runner: Path) -> dict[str, str]:
    return dict(line.split("=", 1) for line in (runner / "output").read_text().splitlines())


@pytest.mark.parametrize(
    ("departure", "args", "verdict", "code"),
    [
        (None, "", "valid", 0),
        (None, "--no-hash --ignore BD-CTL", "partial", 3),
        pytest.param(None, "--require-groups 9", "valid", 1, marks=THOROUGH),
        ("speed out of range", "", "invalid", 1),
    ],
)
def test_a_run_is_annotated_summarised_and_judged(
    runner: Path, departure: str | None, args: str, verdict: str, code: int
) -> None:
    tables = datasets.DEPARTURES[departure].tables() if departure else None
    datasets.write(runner / "my data", tables)
    done = run_step("validate", runner, dataset="my data", args=args, format="sarif", output="report.sarif")
    assert (done.returncode, done.stderr) == (code, "")
    assert annotations(done.stdout)[0][1]["title"] == f"BranchDrive: {verdict}"
    assert outputs(runner) == {"report": "report.sarif", "exit-code": str(code), "verdict": verdict}
    assert (runner / "report.sarif").read_text().startswith("{")
    summary = (runner / "step_summary").read_text()
    assert summary.startswith(f"# {'✅' if code == 0 else '⚠️' if code == 3 else '❌'} BranchDrive: {verdict}")


def test_no_dataset_is_no_verdict(runner: Path) -> None:
    (runner / "branchdrive-report.json").write_text('{"verdict": "valid"}')  # of a run before
    done = run_step("validate", runner, dataset="nowhere")
    assert done.returncode == 2
    assert "is not a folder" in done.stderr
    assert outputs(runner) == {"exit-code": "2"}


@pytest.mark.parametrize(
    "text", sampled(["$(touch forged)", "; touch forged", "--output=text=forged", "`touch forged`"], every=2)
)
def test_inputs_are_no_commands(runner: Path, text: str) -> None:
    done = run_step("validate", runner, dataset=text)
    assert done.returncode == 2
    assert not (runner / "forged").exists()
    assert run_step("validate", runner, dataset="x", args=text.replace("=text=forged", "")).returncode == 2
    assert not (runner / "forged").exists()


def test_scripts_hold_no_expressions() -> None:
    for step in STEPS.values():
        assert "${{" not in step["run"]
        used = set(re.findall(r"BRANCHDRIVE_[A-Z]+", step["run"]))
        assert used == set(step["env"])
        named = [it for value in step["env"].values() for it in re.findall(r"inputs\.([a-z]+)", value)]
        assert set(named) <= set(ACTION["inputs"])


@pytest.mark.parametrize(("version", "installed"), [("", "/the action"), ("branchdrive==1.2", "branchdrive==1.2")])
def test_the_first_step_installs_into_a_place_of_its_own(tmp_path: Path, version: str, installed: str) -> None:
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\necho "$@" >> "{tmp_path}/calls"\nmkdir -p "$3/bin"\ncp "$0" "$3/bin/python"\n')
    python.chmod(0o755)
    done = run_step("install", tmp_path, python=str(python), version=version, source="/the action")
    assert done.returncode == 0, done.stderr
    calls = (tmp_path / "calls").read_text().splitlines()
    assert calls[0] == f"-m venv {tmp_path}/branchdrive"
    assert calls[1] == f"-m pip install --quiet --disable-pip-version-check {installed}"


def test_outputs_are_those_of_the_step() -> None:
    written = set(re.findall(r"\b([a-z-]+)=\$", STEPS["validate"]["run"])) | {"verdict"}
    assert set(ACTION["outputs"]) <= written
    for name, output in ACTION["outputs"].items():
        assert output["value"] == f"${{{{ steps.validate.outputs.{name} }}}}"


def test_the_hook_runs_a_command_of_the_distribution() -> None:
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text("utf-8"))
    assert hook["language"] == "python"
    assert shutil.which(hook["entry"], path=str(Path(sys.executable).parent))
    assert hook["pass_filenames"] is False
