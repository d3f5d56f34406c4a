"""Commands of other distributions: found by their entry point, listed, explained and run like those of this one."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from importlib.metadata import distributions
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
WORKFLOW = (
    "init", "collect", "staging", "merge", "render", "inspect", "study", "report", "draw", "show", "rerun", "validate",
    "pilot", "diff", "columns", "rules", "build", "pack", "upload", "metadata", "benchmark", "train", "lock", "predict",
    "evaluate", "export", "drive", "latency", "curve", "completion",
)  # fmt: skip
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
    assert text.startswith("usage: branchdrive wheels [-h] [--wheels WHEELS] [--version]\n")
    assert "count the wheels of a dataset" in text


def test_the_help_lists_it_after_the_workflow(
    installed: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    listed = dict(line.split(maxsplit=1) for line in commands(help_of(run, "--help", capsys=capsys)))
    assert [*listed] == [*WORKFLOW, "broken", "needy", "wheels"]
    assert listed["wheels"] == "count the wheels of a dataset"


@pytest.mark.parametrize(("order", "before"), [(85, "pilot"), (-1, "init"), (90, "diff"), (1000, "broken")])
def test_it_can_have_an_order_of_its_own(
    order: int, before: str, installed: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "third_party_wheels.py").write_text(f"{MODULE}\nORDER = {order}\n")
    listed = [line.split()[0] for line in commands(help_of(run, "--help", capsys=capsys)) if line[2] != " "]
    assert listed[listed.index("wheels") + 1] == before


@pytest.mark.parametrize("order", ["'first'", "None", "float('nan')", "[]"])
def test_an_order_that_is_none_takes_nobodys_help_away(
    order: str, installed: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "third_party_wheels.py").write_text(f"{MODULE}\nORDER = {order}\n")
    listed = [line.split()[0] for line in commands(help_of(run, "--help", capsys=capsys)) if line[2] != " "]
    assert [name for name in listed if name != "wheels"] == [*WORKFLOW, "broken", "needy"]


def test_every_command_of_ours_has_a_place_of_its_own() -> None:
    (ours,) = (found.entry_points.select(group="branchdrive.commands") for found in distributions(name="branchdrive"))
    orders = {point.name: point.load().ORDER for point in ours}
    assert sorted(orders, key=orders.__getitem__) == [*WORKFLOW]
    assert len(set(orders.values())) == len(orders)


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
