"""Child processes: what they import, and that the process that starts them stays as it is."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
from tests.hostile_folder import infest, marks
from tests.repo.checkout import ROOT
from tests.validator.engine import datasets

from branchdrive.process import ONE_THREAD, spawn_context

SCRIPT = """
import os, sys
from branchdrive import isolated, validate

if __name__ == "__main__":
    os.chdir(sys.argv[1])
    before = dict(os.environ)
    report = validate(".", executor=isolated(2))
    assert dict(os.environ) == before
    print(report.exit_code, len(report.errors))
"""

STARTS = re.compile(r"get_context|sys\.executable|Process\(|set_start_method|os\.(fork|exec|spawn|system|popen)")
"""What starts a process, or says how."""


def test_workers_of_a_script_import_nothing_from_the_folder_it_changes_to(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "script.py").write_text(SCRIPT)
    infest(datasets.write(tmp_path / "hostile"), tmp_path / "marks")
    done = subprocess.run(
        [sys.executable, "script.py", tmp_path / "hostile"],
        cwd=tmp_path / "elsewhere", capture_output=True, text=True, check=False, timeout=120,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([".", "", "packages"])},
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("1 0\n", "")
    assert marks(tmp_path / "marks") == []


def test_one_module_knows_how_children_are_started() -> None:
    sources = [path for package in ("validator", "reference_impl") for path in (ROOT / package).rglob("*.py")]
    found = {path.name for path in sources if STARTS.search(path.read_text(encoding="utf-8"))}
    assert found == {"process.py"}


def test_an_interpreter_whose_children_cannot_be_made_safe_is_refused() -> None:
    code = "from branchdrive.process import spawn_context; spawn_context()"
    for flags, returncode in ((["-E"], 1), (["-E", "-P"], 0), (["-I"], 0)):
        done = subprocess.run([sys.executable, *flags, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == returncode
        assert ("start Python with -P or -I as well" in done.stderr) == bool(returncode)


def _variables(names: list[str]) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in names}


def test_workers_of_the_validator_compute_in_one_thread_and_others_in_as_many_as_they_were_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "3")
    for is_single_threaded, threads in ((True, "1"), (False, "3")):
        with ProcessPoolExecutor(1, spawn_context(is_single_threaded=is_single_threaded)) as pool:
            assert set(pool.submit(_variables, list(ONE_THREAD)).result().values()) == {threads}
        assert set(_variables(list(ONE_THREAD)).values()) == {"3"}
