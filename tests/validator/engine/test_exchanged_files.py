"""Files that change places: the validator says so and never fails itself."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests import synthetic

from branchdrive.engine.validate import validate


@pytest.mark.parametrize("seed", range(3))
def test_files_may_be_exchanged(seed: int, valid_root: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    root = tmp_path / "dataset"
    shutil.copytree(valid_root, root)
    tables = sorted((root / "raw").rglob("*.parquet"))
    content = [path.read_bytes() for path in tables]
    for path, source in zip(tables, rng.permutation(len(tables)), strict=True):
        path.write_bytes(content[source])
    synthetic.seal_dataset(root)
    report = validate(root)
    assert (report.verdict, report.errors) == ("invalid", ())
