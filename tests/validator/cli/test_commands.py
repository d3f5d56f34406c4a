"""Commands of other distributions: found by their entry point, listed, explained and run like those of this one."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.validator.cli.test_main import call, help_of

from branchdrive.cli import main as command_line
from branchdrive.cli.main import run

MODULE = """
SUMMARY = "count the wheels of a dataset"

def add_arguments(parser):
    parser.add_argument("--wheels", type=int, default=4, help="wheels of a vehicle")

def run(args, stdout, stderr):
    stdout.write(f"{args.wheels} wheels\\n")
    return 3
"""
ENTRIES = """[branchdrive.commands]
wheels = third_party_wheels
broken = third_party_broken
needy = third_party_needy
validate = third_party_broken
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A distribution with a command, with one that fails when it is loaded, and with one that lacks a package."""
    (tmp_path / "third_party_wheels.py").write_text(MODULE)
    (tmp_path / "third_party_broken.py").write_text("raise RuntimeError('no\\nway')\n")
    (tmp_path / "third_party_needy.py").write_text("import a_package_of_nobody\n")
    about = tmp_path / "third_party-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: third-party\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(tmp_path)
    command_line._command_modules.cache_clear()
    yield
    command_line._command_modules.cache_clear()
    for name in [name for name in sys.modules if name.startswith("third_party_")]:
        del sys.modules[name]


def test_a_command_of_another_distribution_is_run(installed: None) -> None:
    assert call(run, "wheels", "--wheels", 6) == (3, "6 wheels\n", "")


def test_it_explains_itself(installed: None, capsys: pytest.CaptureFixture[str]) -> None:
    text = help_of(run, "wheels", "--help", capsys=capsys)
    assert text.startswith("usage: branchdrive wheels [-h] [--wheels WHEELS]\n")
    assert "count the wheels of a dataset" in text


def test_the_help_lists_it_after_the_workflow(
    installed: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    listed = dict(line.split(maxsplit=1) for line in commands(help_of(run, "--help", capsys=capsys)))
    ours = [*command_line._WORKFLOW]
    assert [*listed] == [*ours, "broken", "needy", "wheels"]
    assert listed["wheels"] == "count the wheels of a dataset"


def test_what_cannot_be_loaded_takes_nobodys_help_away(
    installed: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    listed = dict(line.split(maxsplit=1) for line in commands(help_of(run, "--help", capsys=capsys)))
    assert listed["broken"] == "this command cannot be loaded: RuntimeError('no\\nway')"
    assert listed["needy"].startswith("this command cannot be loaded: No module named 'a_package_of_nobody'")


def test_a_command_of_ours_cannot_be_replaced(installed: None) -> None:
    code, _, err = call(run, "validate")
    assert code == 2
    assert "required: DATASET" in err


def test_one_command_loads_no_other(installed: None) -> None:
    call(run, "rules", "BD-VAL")
    assert not [name for name in sys.modules if name.startswith("third_party_")]


@pytest.mark.parametrize("columns", [40, 80])
def test_the_help_fits_narrow_terminals(
    columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit):
        run(["--help"], io.StringIO(), io.StringIO())
    text = capsys.readouterr().out
    assert text.startswith("usage: branchdrive [-h] [--version] COMMAND ...\n")
    assert max(map(len, text.split("commands:")[1].split("\n\n")[0].splitlines())) <= columns


def commands(text: str) -> list[str]:
    """Lines of the help that list commands."""
    return text.split("commands:\n")[1].split("\n\n")[0].splitlines()
