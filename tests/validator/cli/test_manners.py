"""What people expect of any command: completion, versions, suggestions, a module that runs, a list of columns."""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.metadata import entry_points, version
from pathlib import Path

import pytest
from tests.validator.cli.test_main import call, help_of
from tests.waiting import PATIENCE_S

from branchdrive.cli.completion import SHELLS
from branchdrive.cli.main import run, validate_run
from branchdrive.contract.columns import LAYER_TABLES, TABLES

COMMANDS = sorted(point.name for point in entry_points(group="branchdrive.commands"))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_version(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert help_of(run, command, "--version", capsys=capsys) == f"branchdrive {version('branchdrive')}\n"


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["validate", ".", "--frmat", "json"], "unrecognized arguments: --frmat json; did you mean --format?"),
        (["validate", ".", "--job=2"], None),  # an abbreviation, which is understood
        (["inspect", ".", "--folow-links"], "did you mean --follow-links?"),
        (["columns", "scalars", "--zzzz"], "unrecognized arguments: --zzzz; `branchdrive --help` explains"),
        (["inspekt", "."], "did you mean 'inspect'"),
    ],
)
def test_a_name_that_there_is_not_is_answered_with_one_that_is(
    arguments: list[str], hint: str | None, tmp_path: Path
) -> None:
    code, _, err = call(run, *(tmp_path if word == "." else word for word in arguments))
    assert code == 2 or hint is None
    assert hint is None or hint in err
    assert hint is not None or "unrecognized" not in err


def test_scripts_of_one_command_suggest_options_too(tmp_path: Path) -> None:
    code, _, err = call(validate_run, tmp_path, "--waiver-file", "x")
    assert (code, err.count("\n")) == (2, 1)
    assert "did you mean --waivers" in err


def test_the_package_runs_as_a_module(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "branchdrive", "--version"], capture_output=True, text=True, timeout=PATIENCE_S,
        cwd=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, f"branchdrive {version('branchdrive')}\n")


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_knows_commands_and_options(shell: str, tmp_path: Path) -> None:
    code, script, err = call(run, "completion", shell)
    assert (code, err) == (0, "")
    for word in ("inspect", "validate", "follow-links", "require-groups"):
        assert word in script
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed here, so that its script was not tried")
    path = tmp_path / "script"
    path.write_text(script)
    done = subprocess.run([program, "-n", str(path)], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (0, "")


def test_bash_completes_a_command(tmp_path: Path) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed here")
    (tmp_path / "script").write_text(call(run, "completion", "bash")[1])
    lines = (
        'source "$1"; COMP_WORDS=(branchdrive insp); COMP_CWORD=1; COMP_LINE="branchdrive insp"; COMP_POINT=16; '
        '$(complete -p branchdrive | sed "s/.*-F \\([^ ]*\\).*/\\1/") branchdrive insp branchdrive; '
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        [bash, "-c", lines, "bash", str(tmp_path / "script")], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.stdout.split() == ["inspect"], done.stderr


def test_tables_and_columns_of_the_format_are_listed() -> None:
    code, out, _ = call(run, "columns")
    assert code == 0
    assert all(any(name in line.split()[:2] for line in out.splitlines()) for name in (*TABLES, *LAYER_TABLES))
    asked_for = {name: f"where `branchdrive build --{name}` was asked for it" for name in ("endings", "objects")}
    assert all(words in " ".join(out.split()) for words in asked_for.values())
    for name, table in {**TABLES, **LAYER_TABLES}.items():
        code, out, _ = call(run, "columns", name)
        assert code == 0
        assert [one for one, words in asked_for.items() if words in " ".join(out.split())] == [
            one for one in asked_for if one == name
        ]
        for column in table.columns:
            line = next(line for line in out.splitlines() if line.startswith(f"{column.name} "))
            assert column.track in line
            assert column.unit is None or column.unit in line
    code, out, err = call(run, "columns", "observation")
    assert (code, out) == (2, "")
    assert "did you mean 'observations'?" in err
