"""Whether kernels were compiled before is known by what numba kept."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

from branchdrive.process import child_environment

if TYPE_CHECKING:
    from pathlib import Path

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
