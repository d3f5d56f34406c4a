"""The benchmarks measure something, and say what they lack."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from branchdrive.errors import BranchDriveError
from branchdrive_reference.bench import highway_env, paper
from branchdrive_reference.bench.memory import run_measured
from branchdrive_reference.bench.simulator import measure_ticks_per_s

MIB = 2**20
HOLD = "import time; held = bytearray({} << 20); time.sleep(0.6)"
PARENT = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD.format(60)!r}]); print('over')"


def test_speed_is_measured() -> None:
    assert measure_ticks_per_s(num_rollouts=2, repeats=1) > 0


def test_the_memory_of_a_command_is_that_of_its_tree() -> None:
    measured = run_measured([sys.executable, "-c", PARENT], sample_s=0.05)
    assert (measured.exit_code, measured.output) == (0, "over\n")
    assert measured.wall_s > 0.6
    assert 60 * MIB < measured.largest_bytes < 90 * MIB
    assert measured.largest_bytes + 4 * MIB < measured.together_bytes < measured.largest_bytes + 40 * MIB


def test_highway_env_runs_with_as_many_vehicles() -> None:
    pytest.importorskip("highway_env")
    found = highway_env.compare(num_rollouts=2, num_ticks=20, repeats=1)
    assert found.their_vehicles == round(found.our_vehicles)
    assert found.ratio == found.ours_ticks_per_s / found.theirs_ticks_per_s > 0


def test_without_highway_env_its_row_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def lack(**_: object) -> None:
        raise ModuleNotFoundError(name="highway_env")

    monkeypatch.setattr(highway_env, "compare", lack)
    (row,) = highway_env.rows()
    assert row.measured == "not measured, highway_env is not installed: pip install 'branchdrive[bench]'"
    assert row.bar == ">= 25x"


def test_a_collection_is_measured_with_its_validation(tmp_path: Path) -> None:
    rows = {row.what.splitlines()[0]: row for row in paper.rows(tmp_path, num_groups=2, jobs=1)}
    collected = rows["collect 2 groups of preset `paper`, 1 worker(s)"]
    assert re.fullmatch(r"[0-9.]+ s", collected.measured) and collected.bar == "<= 60 min"
    assert rows["peak memory of the collector and its workers"].bar == "<= 2 GiB"
    assert rows["funnel"].measured.splitlines()[0] == "2 groups discovered"


def test_a_collection_that_fails_is_no_measurement(tmp_path: Path) -> None:
    (tmp_path / "dataset").write_text("in the way")
    with pytest.raises(BranchDriveError, match="`branchdrive collect` ended with 2"):
        list(paper.rows(tmp_path, num_groups=1, jobs=1))
