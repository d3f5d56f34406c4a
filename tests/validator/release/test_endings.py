"""A release tells how drives end where its builder is asked to, and is as it was where not."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import LAYERS, breaches, call, contents

from branchdrive.contract.companion import CROISSANT_FILE
from branchdrive.contract.layout import CARD_FILE
from branchdrive.errors import DatasetError
from branchdrive.model.reader import open_model

TABLE = "model/endings-"


@pytest.fixture
def root(built: Path, tmp_path: Path) -> Path:
    """A release without the table, to build again."""
    return Path(shutil.copytree(built, tmp_path / "dataset"))


def build_model(root: Path, *options: str) -> None:
    code, _, stderr = call("build", root, "--stage", "model", "--seed", SEED, *options)
    assert (code, stderr) == (0, "")


def test_endings_are_added_and_nothing_else_but_the_card_and_lists_of_files(built: Path, root: Path) -> None:
    build_model(root, "--endings")
    before, after = contents(built), contents(root)
    added = {f"{TABLE}{partition}-00000.parquet" for partition in ("train", "val", "test", "calibration")}
    assert after.keys() - before.keys() == added
    assert {path for path in before if before[path] != after[path]} == {CARD_FILE, CROISSANT_FILE, "MANIFEST.sha256"}
    assert breaches(root) == set()
    assert "`model/endings-*.parquet`" in after[CARD_FILE].decode()
    layer = open_model(root)
    assert layer.arrow("endings").num_rows == layer.arrow("scalars").num_rows


def test_a_build_that_is_not_asked_for_them_leaves_none(built: Path, root: Path) -> None:
    build_model(root, "--endings")
    build_model(root)
    assert contents(root) == contents(built)
    with pytest.raises(DatasetError, match="has no table `endings`, which `branchdrive build --endings` adds"):
        open_model(root).arrow("endings")


def test_a_detached_release_tells_them_without_its_raw_layer(raw: Path, tmp_path: Path) -> None:
    stages = [word for stage in LAYERS for word in ("--stage", stage)]
    code, _, stderr = call("build", raw, "--output", tmp_path / "release", "--seed", SEED, "--endings", *stages)
    assert (code, stderr) == (0, "")
    assert breaches(tmp_path / "release") == set()
    assert open_model(tmp_path / "release").arrow("endings").num_rows > 0
