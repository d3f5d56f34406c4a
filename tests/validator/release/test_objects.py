"""A release tells what sensors see of others where its builder is asked to, and is as it was where not."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import LAYERS, breaches, call, contents

from branchdrive.contract.companion import CROISSANT_FILE
from branchdrive.contract.layout import CARD_FILE
from branchdrive.model.reader import ModelLayer, open_model

TABLE = "model/objects-"


@pytest.fixture
def root(built: Path, tmp_path: Path) -> Path:
    """A release without the table, to build again."""
    return Path(shutil.copytree(built, tmp_path / "dataset"))


def build_model(root: Path, *options: str) -> None:
    code, _, stderr = call("build", root, "--stage", "model", "--seed", SEED, *options)
    assert (code, stderr) == (0, "")


def test_objects_are_added_and_nothing_else_but_the_card_and_lists_of_files(built: Path, root: Path) -> None:
    build_model(root, "--objects")
    before, after = contents(built), contents(root)
    added = {f"{TABLE}{partition}-00000.parquet" for partition in ("train", "val", "test", "calibration")}
    assert after.keys() - before.keys() == added
    assert {path for path in before if before[path] != after[path]} == {CARD_FILE, CROISSANT_FILE, "MANIFEST.sha256"}
    assert breaches(root) == set()
    assert "`model/objects-*.parquet`" in after[CARD_FILE].decode()
    layer = open_model(root)
    seen = layer.objects_inputs("train")
    assert seen.objects.shape == (len(layer.groups("train")), 16, 32, 11)
    assert seen.objects_available.any()
    assert np.array_equal(seen.objects_available.sum(axis=(1, 2)) > 0, np.isin(layer.groups("train"), _groups(layer)))
    build_model(root)
    assert contents(root) == contents(built)


def _groups(layer: ModelLayer) -> list[str]:
    found: list[str] = layer.arrow("objects")["group_id"].to_pylist()
    return found


def test_a_detached_release_tells_them_without_its_raw_layer(raw: Path, tmp_path: Path) -> None:
    stages = [word for stage in LAYERS for word in ("--stage", stage)]
    code, _, stderr = call("build", raw, "--output", tmp_path / "release", "--seed", SEED, "--objects", *stages)
    assert (code, stderr) == (0, "")
    assert breaches(tmp_path / "release") == set()
    assert open_model(tmp_path / "release").arrow("objects").num_rows > 0
