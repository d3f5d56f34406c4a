"""What the README shows works: its examples run, its commands exist, its table is the one of the code."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from tests.model_release import make_frames, write_release
from tests.repo.checkout import ROOT
from tests.synthetic import base_tables, descriptor, write_dataset

from branchdrive import open_dataset
from branchdrive.cli.main import run, run_script
from branchdrive.engine.validate import validate
from branchdrive.exit_code import EXIT_OF_VERDICT
from branchdrive.raw.funnel import STAGES

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

COLLECTOR = "docs/examples/minimal_collector.py"
README = (ROOT / "README.md").read_text(encoding="utf-8")
SHELL = [
    shlex.split(line, comments=True)
    for block in re.findall(r"```sh\n(.*?)```", README, re.S)
    for line in block.splitlines()
    if line.strip()
]
"""Words of every command of the shell examples."""


def test_the_reading_example_runs(tmp_path: Path) -> None:
    write_dataset(tmp_path / "dataset", base_tables(), descriptor())
    block = next(block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "open_dataset" in block)
    names: dict[str, object] = {}
    exec(block.replace("build/demo/dataset", str(tmp_path / "dataset")), names)
    assert [getattr(names[name], "shape", None) for name in ("speed", "past", "future")] == [(16, 1), (80, 3), (10, 4)]


def test_the_loading_example_runs(tmp_path: Path) -> None:
    root = write_release(tmp_path / "release", make_frames())
    block = next(block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "open_model" in block)
    names: dict[str, Any] = {}
    exec(block.replace("build/release", str(root)), names)
    shapes = [names["train"].state.shape, names["train"].controls.shape, names["targets"].scalars.shape]
    assert shapes == [(3, 16, 21), (3, 80, 3), (3, 13, 6)]


def minimal_collector(root: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(ROOT / COLLECTOR), str(root)], capture_output=True, text=True)


def test_the_minimal_collector_writes_a_group_that_qualifies(tmp_path: Path) -> None:
    runs = [minimal_collector(tmp_path / "dataset") for _ in range(2)]
    report = validate(tmp_path / "dataset")
    assert report.verdict == "valid"
    assert report.findings == ()
    assert report.funnel is not None
    assert report.funnel.groups == dict.fromkeys(STAGES, 1)
    assert [run.returncode for run in runs] == [0, 0]
    root = tmp_path / "dataset"
    ends = [f"dataset   {root}", f"identity  {report.dataset.identity}", f"next      branchdrive-validate {root}"]
    collected = [f"{n} collected: {n} with a branch, 0 without, 0 refused; {1 - n} found" for n in (1, 0)]
    for done, groups in zip(runs, collected, strict=True):  # a finished dataset is left as it is
        lines = done.stdout.splitlines()
        assert [*lines[:2], lines[-1]] == ends
        assert lines[-2].startswith("routes    1 route cluster in 1 branched group; a release parts whole clusters")
        assert lines[2] == f"groups    {groups} finished"
    assert (report.dataset.num_groups, report.dataset.num_rollouts) == (1, 15)
    rollouts = open_dataset(root).rollouts().to_pylist()
    assert {row["result_completion"] for row in rollouts} == {"completed"}
    assert {row["result_route_fraction"] for row in rollouts} == {1.0}


def test_the_minimal_collector_refuses_another_folder_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "other.txt").write_text("mine")
    run = minimal_collector(tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"minimal_collector.py: {tmp_path}: is not empty and holds no dataset; choose another folder\n"


def test_the_writing_excerpt_is_of_the_minimal_collector() -> None:
    blocks = [block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "collector_main" in block]
    assert len(blocks) == 1
    assert blocks[0] in (ROOT / COLLECTOR).read_text(encoding="utf-8")


def test_the_commands_and_their_options_exist(capsys: pytest.CaptureFixture[str]) -> None:
    import io

    calls = [words for words in SHELL if words[0].startswith("branchdrive")]
    assert {words[1] for words in calls if words[0] == "branchdrive"} >= {"collect", "build", "study", "draw", "rules"}
    for words in calls:
        prog, command = words[0], words[1]
        if prog == "branchdrive-validate":
            prog, command = "branchdrive", "validate"
        try:
            if prog == "branchdrive-conformance":
                run_script(prog, "branchdrive_conformance.command", [command, "--help"], io.StringIO(), io.StringIO())
            run([command, "--help"], io.StringIO(), io.StringIO())
        except SystemExit as stop:
            assert stop.code == 0, command
        printed = capsys.readouterr().out
        assert f"{prog} {command}" in printed
        for option in [word for word in words if word.startswith("--")]:
            assert option in printed, words


def test_commands_are_called_by_plain_names_in_an_activated_environment() -> None:
    assert [words for words in SHELL if words[-1] == ".venv/bin/activate"] == [[".", ".venv/bin/activate"]]
    assert README.count(".venv/bin/") == 1


def test_every_path_is_written_once_and_git_ignores_it() -> None:
    written = ["build/demo"]  # by `make demo`
    for words in SHELL:
        written += [words[2]] if words[:2] in (["branchdrive", "collect"], ["python", COLLECTOR]) else []
        written += [value.rpartition("=")[2] for option, value in pairwise(words) if option == "--output"]
    assert "DEMO := build/demo\n" in (ROOT / "Makefile").read_text(encoding="utf-8")
    assert len(written) == len(set(written)) >= 7
    assert not any(path.startswith("build/demo/") for path in written)
    assert all(path.startswith("build/") for path in written)
    assert "/build/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()


def test_the_verdict_table_is_the_codes() -> None:
    table = dict(re.findall(r"^\| `([a-z-]+)` \| ([0-9]) \|", README, re.M))
    assert {verdict: int(code) for verdict, code in table.items()} == EXIT_OF_VERDICT


def test_make_verbs_of_the_readme_exist() -> None:
    verbs = set(re.findall(r"^make ([a-z]+)", README, re.M))
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    assert verbs and verbs <= targets


def test_the_help_tells_what_every_command_does(capsys: pytest.CaptureFixture[str]) -> None:
    import io
    from importlib import import_module
    from importlib.metadata import entry_points

    try:
        run(["--help"], io.StringIO(), io.StringIO())
    except SystemExit:
        printed = " ".join(capsys.readouterr().out.split())
    for command in entry_points(group="branchdrive.commands"):
        assert f"{command.name} {import_module(command.value).SUMMARY}" in printed
