"""A lock is of one release and of checkpoints as they were."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.reference_impl.benchmark.small_release import contents, invoke, make_release

from branchdrive import DatasetError, UsageError
from branchdrive.benchmark.tables import result_sections
from branchdrive.contract.identity import content_identity
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.layers.content import layers_content
from branchdrive.text.table import Table

LAYERS = ("canonical/", "quality/", "model/")
SUFFIXES = (".json", ".parquet")


def _finish(root: Path) -> None:
    write_manifest(Folder(root), build_manifest(Folder(root)))


def test_it_names_the_release_without_its_raw_layer(done: Path) -> None:
    lock = json.loads((done / "benchmark" / "lock.json").read_bytes())
    derived = {
        path for path in build_manifest(Folder(done)).files if path.startswith(LAYERS) and path.endswith(SUFFIXES)
    }
    content = layers_content(Folder(done), derived)
    assert set(content) == {layer.rstrip("/") for layer in LAYERS if any(path.startswith(layer) for path in derived)}
    assert lock["release_identity"] == content_identity(content, content)
    assert [(one["model"], one["seed"]) for one in lock["checkpoints"]] == [
        ("M0", 0), *((model, seed) for model in ("M1", "M2", "M3") for seed in (11, 23)),
    ]  # fmt: skip


def test_a_checkpoint_swapped_after_the_lock_is_refused(release: Path, small_protocol: Path) -> None:
    invoke("train", release, "--protocol", small_protocol, "--no-guard")
    invoke("lock", release)
    (one,) = release.glob(".staging/*/checkpoints/M1-seed11.safetensors")
    other = one.with_name("M1-seed23.safetensors")
    one.write_bytes(other.read_bytes())
    with pytest.raises(UsageError, match=r"'checkpoints/M1-seed11.safetensors' is not the checkpoint that was locked"):
        invoke("predict", release)
    with pytest.raises(UsageError, match=r"M1, seed 11 has a checkpoint with the `seed` 23, expected 11"):
        invoke("lock", release)


def test_a_published_checkpoint_that_was_swapped_is_in_every_table(benchmarked: Path) -> None:
    folder = benchmarked / "benchmark" / "checkpoints"
    (folder / "M1-seed11.safetensors").write_bytes((folder / "M1-seed23.safetensors").read_bytes())
    with pytest.raises(DatasetError, match=r"is not the file that MANIFEST.sha256 lists"):
        invoke("evaluate", benchmarked)
    _finish(benchmarked)
    said = invoke("evaluate", benchmarked, "--no-figures")
    sentence = "The checkpoint `checkpoints/M1-seed11.safetensors` is not the one that was locked."
    results = json.loads((benchmarked / "benchmark" / "results.json").read_text())
    assert said.count(f"Warning: {sentence}") == 1
    tables = sum(isinstance(section, Table) for section in result_sections(results))
    assert (benchmarked / "benchmark" / "TABLES.md").read_text().count(f"**Warning.** {sentence}") == tables >= 2


def test_a_lock_of_another_release_is_refused(benchmarked: Path, tmp_path: Path) -> None:
    other = make_release(tmp_path / "other", seed=5)
    for path, content in contents(other).items():
        if path.startswith("model/"):
            (benchmarked / path).write_bytes(content)
    _finish(benchmarked)
    with pytest.raises(UsageError, match=r"the lock at .* is of "):
        invoke("evaluate", benchmarked)
    with pytest.raises(UsageError, match="was trained on another configuration, release or version"):
        invoke("train", benchmarked)


def test_a_protocol_that_is_none_is_refused(release: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text('{"name": "x"}')
    with pytest.raises(UsageError, match=r"bad.json: not a valid benchmark protocol"):
        invoke("train", release, "--protocol", tmp_path / "bad.json")
