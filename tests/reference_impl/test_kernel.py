"""Kernels that numba kept are known to the next process, and dropped exactly when a source has changed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from branchdrive.runtime.process import child_environment
from branchdrive_reference.kernel import drop_stale_kernels

PROGRAM = """
from branchdrive_reference.kernel import are_kernels_cached
from branchdrive_reference.world.traffic import desired_gap_m
print(are_kernels_cached())
desired_gap_m(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
"""


def test_compiled_kernels_are_known_to_the_next_process(tmp_path: Path) -> None:
    environment = {**child_environment(), "NUMBA_CACHE_DIR": str(tmp_path)}
    program = [sys.executable, "-P", "-c", PROGRAM]
    printed = [
        subprocess.run(program, env=environment, capture_output=True, text=True, check=True).stdout for _ in range(2)
    ]
    assert printed == ["False\n", "True\n"]


def test_cache_is_emptied_when_a_source_changes(tmp_path: Path) -> None:
    source, cached = tmp_path / "a.py", tmp_path / "sub" / "__pycache__" / "f.nbi"
    source.write_text("x = 1\n")
    cached.parent.mkdir(parents=True)
    cached.touch()
    assert drop_stale_kernels(tmp_path)
    assert not cached.exists()

    cached.touch()
    assert not drop_stale_kernels(tmp_path)
    assert cached.exists()

    source.write_text("x = 2\n")
    assert drop_stale_kernels(tmp_path)
    assert not cached.exists()
