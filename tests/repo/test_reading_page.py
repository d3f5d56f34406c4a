"""The page on looking at datasets: its code runs, and its command exists."""

from __future__ import annotations

import re
from pathlib import Path

from tests.repo.checkout import ROOT
from tests.synthetic import base_tables, descriptor, write_dataset

PAGE = (ROOT / "docs" / "reading.md").read_text(encoding="utf-8")


def test_the_code_of_the_page_runs(tmp_path: Path) -> None:
    root = write_dataset_at(tmp_path / "dataset")
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        exec(block.replace("build/demo/dataset", str(root)), names)
    assert names["after_branch_s"].min() < 0 < names["after_branch_s"].max()  # type: ignore[attr-defined]
    assert len(names["frame"]) == len(names["dataset"].rollouts())  # type: ignore[arg-type, attr-defined]


def write_dataset_at(root: Path) -> Path:
    write_dataset(root, base_tables(), descriptor())
    return root
