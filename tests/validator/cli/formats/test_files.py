"""Several reports at once, each into a file of its own."""

from __future__ import annotations

import io
from pathlib import Path

from branchdrive.cli.formats.table import FORMATS
from branchdrive.cli.main import validate_run


def call(*argv: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `branchdrive-validate`."""
    stdout, stderr = io.StringIO(), io.StringIO()
    code = validate_run([str(argument) for argument in argv], stdout, stderr)
    return code, stdout.getvalue(), stderr.getvalue()


def test_several_forms_go_to_files_of_their_own(invalid_root: Path, tmp_path: Path, quick: None) -> None:
    printed = {form: call(invalid_root, "--format", form)[1] for form in FORMATS}
    wanted = [f"--output={form}={tmp_path / form}" for form in FORMATS if form != "json"]
    assert call(invalid_root, "--format", "github", *wanted) == (1, printed["github"], "")
    plain = (*wanted, "--format", "json", "--output", tmp_path / "json")
    assert call(invalid_root, *plain) == (1, printed["text"], "")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == printed


def test_a_file_may_have_an_equals_sign(invalid_root: Path, tmp_path: Path, quick: None) -> None:
    assert call(invalid_root, "--output", tmp_path / "html=report")[0] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["html=report"]


def test_two_reports_in_one_file_are_wrong_usage(invalid_root: Path, tmp_path: Path) -> None:
    code, out, err = call(invalid_root, "--output", tmp_path / "report", "--output", f"sarif={tmp_path / 'report'}")
    assert (code, out) == (2, "")
    assert "report' is named twice; give every report a file of its own" in err
    assert list(tmp_path.iterdir()) == []
