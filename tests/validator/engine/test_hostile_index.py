"""Indexes of images that name one thing in many rows: what is repeated is read, judged and decoded once, or refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests import synthetic
from tests.synthetic import write_dataset

from branchdrive.contract.limits import spec_limits
from branchdrive.engine.report import Report
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE
from branchdrive.engine.validate import validate
from branchdrive.raw.media import image_eye

FOLDER = "raw/shard-00001"
TABLES = synthetic.media_tables()[FOLDER]
FRAMES = TABLES["frames"]
MANY = 200_000


@pytest.fixture
def num_calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often images are looked at, by function."""
    calls: Counter[str] = Counter()

    def counting(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def count(*arguments: Any, **options: Any) -> Any:
            calls[name] += 1
            return function(*arguments, **options)

        return count

    for name in ("read_header", "find_flaw", "decode_image"):
        monkeypatch.setattr(image_eye, name, counting(name, getattr(image_eye, name)))
    return calls


def judged(root: Path, frames: pa.Table, **options: Any) -> Report:
    """Report on the shard of one group with another index."""
    write_dataset(root, {"raw/shard-00000": {**TABLES, "frames": frames}}, synthetic.media_descriptor())
    report = validate(root, **options)
    assert report.errors == ()
    return report


def said(report: Report, rule: str) -> tuple[str, int]:
    (tally,) = (tally for tally in report.tallies if tally.rule_id == rule)
    assert len(tally.findings) <= MAX_FINDINGS_PER_RULE
    return tally.status, tally.num_findings


def with_column(frames: pa.Table, name: str, values: list[Any]) -> pa.Table:
    column = frames.column_names.index(name)
    return frames.set_column(column, name, pa.array(values, frames.schema.field(name).type))


def copies(num_rows: int) -> pa.Table:
    """An index that says one thing many times."""
    return FRAMES.take(np.zeros(num_rows, np.int64))


def test_images_that_attempts_share_are_judged_once(tmp_path: Path, num_calls: Counter[str]) -> None:
    report = judged(tmp_path, FRAMES)
    num_places = len(set(zip(FRAMES["offset_bytes"].to_pylist(), FRAMES["size_bytes"].to_pylist(), strict=True)))
    assert num_places < FRAMES.num_rows / 2
    assert num_calls["find_flaw"] == num_calls["decode_image"] == num_places
    assert said(report, "BD-FRM-008") == ("pass", 0)
    assert report.verdict == "valid"


@pytest.mark.parametrize("mode", ["full", "index"])
def test_a_range_that_a_hundred_thousand_rows_name_is_refused_unseen(
    mode: Any, tmp_path: Path, num_calls: Counter[str]
) -> None:
    report = judged(tmp_path, copies(MANY), media=mode)
    assert said(report, "BD-LAY-007") == ("fail", 1)
    (finding,) = (finding for finding in report.findings if finding.rule == "BD-LAY-007")
    assert finding.location == {"file": "raw/shard-00000/frames.parquet"}
    assert f"in {MANY:,} rows; the limit is {spec_limits().max_range_rows}" in finding.found
    assert not num_calls
    assert {said(report, rule)[0] for rule in ("BD-FRM-002", "BD-FRM-005", "BD-FRM-008", "BD-FRM-011")} == {"skipped"}


def test_rows_that_name_missing_files_are_counted_and_few_are_kept(tmp_path: Path) -> None:
    frames = with_column(copies(MANY), "file", [f"{number % 4000}.bin" for number in range(MANY)])
    assert said(judged(tmp_path, frames), "BD-FRM-002") == ("fail", 4000)


def test_wrong_checksums_are_counted_and_few_are_kept(tmp_path: Path) -> None:
    frames = with_column(copies(50_000), "offset_bytes", list(range(50_000)))
    assert said(judged(tmp_path, with_column(frames, "size_bytes", [1] * 50_000)), "BD-FRM-002") == ("fail", 50_000)


def test_pixels_are_counted_before_any_is_decoded(tmp_path: Path, num_calls: Counter[str]) -> None:
    document = synthetic.media_descriptor()
    for camera in document["cameras"]:
        camera["width_px"] = camera["height_px"] = 16_384
    write_dataset(tmp_path, {"raw/shard-00000": TABLES}, document)
    report = validate(tmp_path)
    assert said(report, "BD-LAY-007") == ("fail", 1)
    assert not num_calls
