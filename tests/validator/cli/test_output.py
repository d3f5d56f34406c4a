"""Where a command may write."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from branchdrive import UsageError
from branchdrive.cli.main import validate_run
from branchdrive.cli.output import check_output


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    (tmp_path / "d" / "raw").mkdir(parents=True)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "d")
    (tmp_path / "lost").symlink_to(tmp_path / "nothing")
    return tmp_path / "d"


@pytest.mark.parametrize("place", ["report", "file", "d.json", "d/../report", "link/../report"])
def test_a_file_in_a_folder_that_exists_is_fine(dataset: Path, place: str) -> None:
    check_output(dataset.parent / place, outside=dataset)
    check_output(None, outside=dataset)


@pytest.mark.parametrize("place", ["", "new", "new/deep", "d/../new"])
def test_a_folder_may_be_made(dataset: Path, place: str) -> None:
    check_output(dataset.parent / place, outside=dataset, is_folder=True)
    assert not (dataset.parent / "new").exists()


@pytest.mark.parametrize("is_folder", [False, True])
@pytest.mark.parametrize("place", ["d/new", "d/raw/new", "link/new", "link/raw/../new", "d/../d/new"])
def test_a_place_inside_the_dataset_is_refused(dataset: Path, place: str, is_folder: bool) -> None:
    for root in (dataset, dataset.parent / "link", Path(os.path.relpath(dataset))):
        with pytest.raises(UsageError, match="lies inside the dataset"):
            check_output(dataset.parent / place, outside=root, is_folder=is_folder)
    check_output(dataset.parent / place, is_folder=is_folder)


def test_the_dataset_itself_is_no_folder_for_output(dataset: Path) -> None:
    with pytest.raises(UsageError, match="lies inside the dataset"):
        check_output(dataset, outside=dataset, is_folder=True)


def test_a_folder_that_holds_no_dataset_may_be_written_to(tmp_path: Path) -> None:
    check_output(tmp_path / "report", outside=tmp_path)


@pytest.mark.parametrize(
    ("place", "is_folder", "told"),
    [
        ("nowhere/report", False, "nowhere' does not exist"),
        ("d", False, "is a folder; name a file"),
        ("file/report", False, "file' does not exist"),
        ("file", True, "is not a folder"),
        ("file/new", True, "is not a folder"),
        ("lost", True, "is not a folder"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused(dataset: Path, place: str, is_folder: bool, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        check_output(dataset.parent / place, is_folder=is_folder)


@pytest.mark.parametrize("is_folder", [False, True])
def test_a_folder_that_is_not_writable_is_refused(
    tmp_path: Path, is_folder: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(UsageError, match="is not writable"):
        check_output(tmp_path / "new", is_folder=is_folder)


def test_validate_refuses_a_report_inside_the_dataset(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import sys

    assert validate_run([str(dataset), "--output", str(dataset / "report.json")], sys.stdout, sys.stderr) == 2
    told = capsys.readouterr().err
    assert "lies inside the dataset" in told and told.count("\n") == 1
    assert [path.name for path in dataset.iterdir()] == ["raw"]
