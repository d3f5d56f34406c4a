"""Child processes: what they import, and that the process that starts them stays as it is."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from tests.hostile_folder import infest, marks
from tests.repo.checkout import ROOT
from tests.validator.engine import datasets
from tests.waiting import PATIENCE_S

from branchdrive.runtime.process import ARRAY_WORK, spawn_context

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
        cwd=tmp_path / "elsewhere", capture_output=True, text=True, check=False, timeout=PATIENCE_S,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([".", "", "packages"])},
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("1 0\n", "")
    assert marks(tmp_path / "marks") == []


def test_one_module_knows_how_children_are_started() -> None:
    sources = [path for package in ("validator", "reference_impl") for path in (ROOT / package).rglob("*.py")]
    found = {path.name for path in sources if STARTS.search(path.read_text(encoding="utf-8"))}
    assert found == {"process.py"}


def test_an_interpreter_whose_children_cannot_be_made_safe_is_refused() -> None:
    code = "from branchdrive.runtime.process import spawn_context; spawn_context()"
    for flags, returncode in ((["-E"], 1), (["-E", "-P"], 0), (["-I"], 0)):
        done = subprocess.run([sys.executable, *flags, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == returncode
        assert ("start Python with -P or -I as well" in done.stderr) == bool(returncode)


def _variables(names: list[str]) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in names}


def test_workers_of_the_validator_have_an_environment_for_arrays_and_others_the_one_they_were_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = dict.fromkeys(ARRAY_WORK, "3") | {"ARROW_DEFAULT_MEMORY_POOL": "mimalloc"}
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    for for_arrays, expected in ((True, dict(ARRAY_WORK)), (False, given)):
        with ProcessPoolExecutor(1, spawn_context(for_arrays=for_arrays)) as pool:
            assert pool.submit(_variables, list(ARRAY_WORK)).result() == expected
        assert _variables(list(ARRAY_WORK)) == given


def _faults_of_a_second_array(num_bytes: int) -> int:
    """Pages that the system hands out for an array of the size of one that was just given back."""
    import resource

    for _ in range(2):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        np.ones(num_bytes, np.uint8)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other allocators decide for themselves")
def test_workers_of_the_validator_keep_the_memory_of_arrays() -> None:
    with ProcessPoolExecutor(1, spawn_context(for_arrays=True)) as pool:
        assert pool.submit(_faults_of_a_second_array, 2_000_000).result() < 50
