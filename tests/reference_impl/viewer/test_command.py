"""`branchdrive rerun`: a group as a file that the viewer's own program accepts, with every candidate in it."""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.synthetic import write_dataset
from tests.synthetic_map import map_descriptor, map_tables
from tests.waiting import PATIENCE_S

from branchdrive.cli.main import run
from branchdrive.raw.reader import open_dataset


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("mapped") / "dataset"
    write_dataset(root, map_tables(), map_descriptor())
    return root


def call(*arguments: object) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    return run(["rerun", *map(str, arguments)], out, err), out.getvalue(), err.getvalue()


def test_the_viewers_own_program_accepts_the_file(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun is heavy (170 MB): run `pip install '.[rerun]'` to try its files")
    group = open_dataset(root).group(open_dataset(root).groups[0])
    code, out, err = call(root, group.group_id, "--output", tmp_path / "group.rrd")
    assert (code, err) == (0, "")
    assert f"{len(group.candidates)} candidates" in out
    program = shutil.which("rerun", path=str(Path(sys.executable).parent))
    assert program is not None
    done = subprocess.run(
        [program, "rrd", "verify", str(tmp_path / "group.rrd")], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    shown = subprocess.run(
        [program, "rrd", "print", "-v", str(tmp_path / "group.rrd")], capture_output=True, text=True, timeout=PATIENCE_S
    )
    for key in group.candidates:
        assert f"/world/candidates/{key}/ego" in shown.stdout.replace("\\", "")
    assert "/world/map/lane" in shown.stdout


def test_wrong_calls_are_one_line(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun is heavy (170 MB): run `pip install '.[rerun]'` to try its files")
    for arguments in ((root, "nobody", "--output", tmp_path / "x.rrd"), (root, "g0", "--output", root / "x.rrd")):
        code, out, err = call(*arguments)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert not (tmp_path / "x.rrd").exists()


def test_without_the_package_the_command_that_installs_it_is_named(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "branchdrive_reference.viewer.recording", raising=False)
    code, _, err = call(root, open_dataset(root).groups[0], "--output", tmp_path / "x.rrd")
    assert code == 4
    assert "[rerun]" in err
