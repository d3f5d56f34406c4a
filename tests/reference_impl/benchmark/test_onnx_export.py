"""The exported selector predicts what torch predicts, and carries what a choice needs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.reference_impl.benchmark.small_release import invoke

from branchdrive import BranchDriveError, UsageError, open_model
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest, build_manifest
from branchdrive_reference.benchmark.onnx_export import OPSET, TOLERANCE, check_equal
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint


@pytest.fixture(scope="module")
def checkpoints(done: Path) -> list[Checkpoint]:
    return [read_checkpoint(done / f"benchmark/checkpoints/M3-seed{seed}.safetensors") for seed in (11, 23)]


def test_it_agrees_with_torch(done: Path, checkpoints: list[Checkpoint], request: pytest.FixtureRequest) -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    exported: Path = request.getfixturevalue("exported")
    assert "M3, 2 seeds" in (exported / "said.txt").read_text()
    content = (exported / "selector.onnx").read_bytes()
    layer = open_model(done)
    assert check_equal(content, checkpoints, layer, "test") <= TOLERANCE
    with pytest.raises(BranchDriveError, match="differs from torch"):
        check_equal(content, checkpoints[:1], layer, "test")
    model = onnx.load_from_string(content)
    about = {entry.key: json.loads(entry.value) for entry in model.metadata_props}
    assert about["branchdrive.candidates"] == list(layer.candidate_order)
    assert about["branchdrive.release"] == Manifest.of(build_manifest(Folder(done)).files).identity
    assert about["branchdrive.utility"]["reversed"] == ["mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"]
    assert [one["seed"] for one in about["branchdrive.checkpoints"]] == [11, 23]
    assert [one.version for one in model.opset_import if one.domain == ""] == [OPSET]
    operators = [node.op_type for node in model.graph.node]
    assert operators.count("GRU") == 2 * 2  # of state and controls, for each seed
    assert len(operators) < 100 and not {"Less", "Sigmoid", "Tanh"} & {*operators}
    assert str(Path(__file__).parents[3]).encode() not in content


@pytest.mark.thorough
def test_it_is_the_same_again(done: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    said = invoke("export", done, "--output", tmp_path / "selector.onnx")
    assert invoke("export", done, "--output", tmp_path / "again.onnx").replace("again.onnx", "selector.onnx") == said
    assert (tmp_path / "again.onnx").read_bytes() == (tmp_path / "selector.onnx").read_bytes()


def test_only_locked_models_that_rank_are_exported(bare: Path, done: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"has no locked checkpoint of 'M3'; run `branchdrive predict` first"):
        invoke("export", bare, "--output", tmp_path / "selector.onnx")
    pytest.importorskip("onnx")
    with pytest.raises(UsageError, match="M1 is no model of histories, objects and actions alone"):
        invoke("export", done, "--model", "M1", "--output", tmp_path / "selector.onnx")
    assert not (tmp_path / "selector.onnx").exists()
