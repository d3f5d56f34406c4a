"""How much of the images is decoded: what is said of the rest, and what never depends on it."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from tests import synthetic
from tests.synthetic import write_dataset

from branchdrive.cli.main import run
from branchdrive.contract.media import SAMPLE_STEP, MediaMode
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.formats.image_codec import NO_DECODER
from branchdrive.raw.media.images import chosen_rows

FOLDER = "raw/shard-00001"
FRAMES = synthetic.media_tables()[FOLDER]["frames"]
PIXELS = ("BD-FRM-008", "BD-FRM-011")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shard of one group, with six views."""
    folder = tmp_path_factory.mktemp("modes") / "dataset"
    write_dataset(folder, {"raw/shard-00000": synthetic.media_tables()[FOLDER]}, synthetic.media_descriptor())
    return folder


def said(report: Report, rule: str) -> tuple[str, int, str | None]:
    (tally,) = (tally for tally in report.tallies if tally.rule_id == rule)
    return tally.status, tally.examined, tally.reason


@pytest.fixture(scope="module")
def whole(root: Path) -> Report:
    return validate(root)


def test_all_images_are_decoded_by_default(whole: Report) -> None:
    assert whole.verdict == "valid"
    assert said(whole, "BD-FRM-008") == ("pass", FRAMES.num_rows, None)
    assert not [line for line in whole.conditions if "image" in line]


@pytest.mark.parametrize(
    ("mode", "reason", "condition"),
    [
        ("index", "images were not decoded", "no image is decoded"),
        ("sample", f"one image in {SAMPLE_STEP:,} was decoded", f"a drawn image in {SAMPLE_STEP:,} is decoded"),
    ],
)
def test_rules_on_pixels_have_not_passed_where_not_all_were_looked_at(
    root: Path, whole: Report, mode: MediaMode, reason: str, condition: str
) -> None:
    report = validate(root, media=mode)
    assert (report.verdict, report.exit_code) == ("partial", 3)
    assert condition in report.conditions
    num_chosen = int(chosen_rows(FRAMES, mode).sum())
    status, examined, why = said(report, "BD-FRM-008")
    assert (status, examined) == ("skipped", num_chosen)
    assert why is not None
    assert why.startswith(reason)
    assert report.funnel == whole.funnel is not None
    same = {t.rule_id: t.status for t in report.tallies if t.rule_id not in PIXELS}
    assert same == {t.rule_id: t.status for t in whole.tallies if t.rule_id not in PIXELS}


def test_without_a_decoder_the_population_is_the_same_and_the_verdict_partial(
    root: Path, whole: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive.raw.media.image_eye.can_decode", lambda: False)
    report = validate(root)
    assert report.verdict == "partial"
    assert said(report, "BD-FRM-008") == ("skipped", 0, NO_DECODER)
    assert report.funnel == whole.funnel


def test_a_sample_follows_from_keys_and_not_from_the_order_of_rows() -> None:
    order = np.random.default_rng(3).permutation(FRAMES.num_rows)
    assert 0 < chosen_rows(FRAMES, "sample").sum() < FRAMES.num_rows / 50
    assert (chosen_rows(FRAMES.take(order), "sample") == chosen_rows(FRAMES, "sample")[order]).all()


def test_samples_of_two_shards_differ() -> None:
    names = pa.array([f"other.{name}" for name in FRAMES["rollout_id"].to_pylist()])
    other = FRAMES.set_column(FRAMES.column_names.index("rollout_id"), "rollout_id", names)
    assert (chosen_rows(other, "sample") != chosen_rows(FRAMES, "sample")).any()
    assert not len(chosen_rows(FRAMES[:0], "sample"))


def test_the_command_takes_a_mode(root: Path) -> None:
    stdout = StringIO()
    code = run(["validate", str(root), "--media", "index"], stdout, StringIO())
    assert code == 3
    assert "no image is decoded" in stdout.getvalue()
