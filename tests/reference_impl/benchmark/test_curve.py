"""Learning curves: every group is judged once by what never saw its cluster, and `test` decides nothing."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.reference_impl.benchmark.small_release import contents, invoke, smallest_protocol, write_protocol

from branchdrive import UsageError
from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.driving.utility import PROFILES, utility
from branchdrive_reference.benchmark import curve as curves
from branchdrive_reference.benchmark.curve import Curve, learning_curve, open_curve
from branchdrive_reference.benchmark.document import read_protocol_file
from branchdrive_reference.benchmark.release import benchmark_data, open_release

SIZES = (3, 6)


@pytest.fixture
def protocol(tmp_path: Path) -> Path:
    return write_protocol(tmp_path / "smallest.json", smallest_protocol())


@pytest.fixture
def curve(bare: Path, protocol: Path) -> Curve:
    return open_curve(open_release(bare), read_protocol_file(protocol), models=["M0"], sizes=SIZES)


def document_of(curve: Curve, folder: Path) -> dict[str, Any]:
    return learning_curve(curve, folder, jobs=1, device="cpu", show=lambda *_: None)


def test_samples_are_nested_and_share_no_cluster_with_what_they_are_judged_by(curve: Curve) -> None:
    cluster = dict(zip(curve.part.groups, curve.part.clusters, strict=True))
    by_fold: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for sample in curve.samples:
        assert len(sample.fitted) == len(set(sample.fitted)) == sample.size
        assert not {cluster[group] for group in sample.fitted} & {cluster[group] for group in sample.judged}
        by_fold.setdefault(sample.judged, []).append(sample.fitted)
    assert Counter(group for judged in by_fold for group in judged) == Counter(curve.part.groups)
    assert all(large[: len(small)] == small for small, large in by_fold.values())
    assert [sample.number for sample in curve.samples] == list(range(10))


def test_the_best_constant_has_the_regret_of_its_definition(curve: Curve, tmp_path: Path) -> None:
    """Fitted and judged anew, group by group, with nothing but executed utilities."""
    found = document_of(curve, tmp_path)
    (profile,) = found["profiles"]
    scale = utility_scale(curve.protocol, curve.data)
    executed = utility(curve.part.targets, scale, PROFILES[profile["profile"]])
    of_group = dict(zip(curve.part.groups, executed, strict=True))
    for size in SIZES:
        regrets: list[float] = []
        for sample in (one for one in curve.samples if one.size == size):
            constant = int(np.mean([of_group[group] for group in sample.fitted], axis=0).argmax())
            judged = np.array([of_group[group] for group in sample.judged])
            best, worst = judged.max(axis=1), judged.min(axis=1)
            regrets += ((best - judged[:, constant]) / (best - worst)).tolist()
        points = {p["selector"]: p["regret"] for p in profile["points"] if p["size"] == size}
        assert points["action_prior"]["value"] == pytest.approx(np.mean(regrets), abs=1e-12)
        assert points["E-M0"]["value"] == points["nominal"]["value"]  # equal predictions: the first candidate


def test_other_partitions_decide_nothing(curve: Curve, tmp_path: Path) -> None:
    parts = {name: part for name, part in curve.data.parts.items() if name not in {"test", "calibration"}}
    without = curve._replace(data=replace(curve.data, parts=parts))
    assert document_of(without, tmp_path / "without") == document_of(curve, tmp_path / "with")


def test_a_learned_model_is_trained_once_and_told_again(bare: Path, protocol: Path, tmp_path: Path) -> None:
    before, out = contents(bare), tmp_path / "out"
    options = ("--output", out, "--protocol", protocol, "--sizes", "6")
    said = invoke("curve", bare, *options)
    assert "Regret by groups to fit on" in said and "What may and may not be concluded" in said
    written = contents(out)
    checkpoints = {path for path in written if path.endswith(".safetensors")}
    assert len(checkpoints) == 2 * 5
    assert {"CURVE.md", "curve.json", "curve.png", "curve.svg"} == set(written) - checkpoints
    stamps = {path: (out / path).stat().st_mtime_ns for path in checkpoints}
    assert json.loads(invoke("curve", bare, *options, "--format", "json")) == json.loads(written["curve.json"])
    assert {path: (out / path).stat().st_mtime_ns for path in checkpoints} == stamps and contents(out) == written
    assert contents(bare) == before


def test_what_cannot_be_fitted_is_refused_before_anything_is(
    bare: Path, protocol: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    release, found = open_release(bare), read_protocol_file(protocol)
    with pytest.raises(UsageError, match=r"5 folds leave \d+ groups of `train`; a sample cannot have 99"):
        open_curve(release, found, sizes=[3, 99])
    with pytest.raises(UsageError, match="no model 'M9'"):
        open_curve(release, found, models=["M9"])
    data = benchmark_data(release)
    train = data.part("train")
    few = replace(train, clusters=tuple(str(place % 4) for place in range(len(train.groups))))
    monkeypatch.setattr(curves, "benchmark_data", lambda _: replace(data, parts={**data.parts, "train": few}))
    with pytest.raises(UsageError, match="4 route clusters in `train` are too few for 5 folds"):
        open_curve(release, found)
