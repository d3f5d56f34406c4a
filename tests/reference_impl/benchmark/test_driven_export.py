"""A locked model drives by its ONNX export, the one that `branchdrive export` writes."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from tests.reference_impl.closed_loop.roads import Roads

from branchdrive.errors import UsageError
from branchdrive_reference.closed_loop.course import Schedule
from branchdrive_reference.closed_loop.lock import LOCK_NAME
from branchdrive_reference.closed_loop.run import Request, drive_release


def request_(release: Path, output: Path, selector: str) -> Request:
    return Request(release, output, (selector,), "near_range", 1, 5, (Schedule(50, 2),))


def test_a_locked_model_drives_by_its_export(benchmarked: Path, exported: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    results = drive_release(request_(benchmarked, tmp_path / "drives", "E-M3"), field=Roads.make()).results
    content = (tmp_path / "drives.selectors/M3.onnx").read_bytes()
    assert content == (exported / "selector.onnx").read_bytes()
    about = json.loads((tmp_path / "drives" / LOCK_NAME).read_bytes())["selectors"][1]
    assert about["name"] == "E-M3" and about["onnx_sha256"] == hashlib.sha256(content).hexdigest()
    (arm,) = (arm for arm in results["arms"] if arm["selector"] == "E-M3")
    assert sum(arm["first_choices"].values()) == sum(arm["later_choices"].values()) == 1


def test_a_model_that_reads_no_history_does_not_drive(benchmarked: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    with pytest.raises(UsageError, match="M0"):
        drive_release(request_(benchmarked, tmp_path / "drives", "E-M0"), field=Roads.make())
    assert not (tmp_path / "drives" / LOCK_NAME).exists()
