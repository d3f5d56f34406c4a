"""A release tells how drives end, and what sensors see, where its builder is asked to, and is as it was where not."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import LAYERS, breaches, call, contents

from branchdrive.contract.companion import CROISSANT_FILE
from branchdrive.contract.layout import CARD_FILE
from branchdrive.errors import DatasetError
from branchdrive.model.reader import open_model

TABLES = ("endings", "objects")


@pytest.fixture
def root(built: Path, tmp_path: Path) -> Path:
    """A release without the tables, to build again."""
    return Path(shutil.copytree(built, tmp_path / "dataset"))


def build_model(root: Path, *options: str) -> None:
    code, _, stderr = call("build", root, "--stage", "model", "--seed", SEED, *options)
    assert (code, stderr) == (0, "")


@pytest.mark.parametrize("table", TABLES)
def test_a_table_is_added_and_nothing_else_but_the_card_and_lists_of_files(table: str, built: Path, root: Path) -> None:
    build_model(root, f"--{table}")
    before, after = contents(built), contents(root)
    added = {f"model/{table}-{partition}-00000.parquet" for partition in ("train", "val", "test", "calibration")}
    assert after.keys() - before.keys() == added
    assert {path for path in before if before[path] != after[path]} == {CARD_FILE, CROISSANT_FILE, "MANIFEST.sha256"}
    assert breaches(root) == set()
    assert f"`model/{table}-*.parquet`" in after[CARD_FILE].decode()
    layer = open_model(root)
    if table == "endings":
        assert layer.arrow(table).num_rows == layer.arrow("scalars").num_rows
    else:
        seen, groups = layer.objects_inputs("train"), layer.groups("train")
        assert seen.objects.shape == (len(groups), 16, 32, 11)
        assert seen.objects_available.any()
        with_objects = np.isin(groups, layer.arrow(table)["group_id"].to_pylist())
        assert np.array_equal(seen.objects_available.sum(axis=(1, 2)) > 0, with_objects)

    build_model(root)
    assert contents(root) == contents(built)
    with pytest.raises(DatasetError, match=f"has no table `{table}`, which `branchdrive build --{table}` adds"):
        open_model(root).arrow(table)


def test_a_detached_release_tells_both_without_its_raw_layer(raw: Path, tmp_path: Path) -> None:
    stages = [word for stage in LAYERS for word in ("--stage", stage)]
    options = [f"--{table}" for table in TABLES]
    code, _, stderr = call("build", raw, "--output", tmp_path / "release", "--seed", SEED, *options, *stages)
    assert (code, stderr) == (0, "")
    assert breaches(tmp_path / "release") == set()
    assert all(open_model(tmp_path / "release").arrow(table).num_rows > 0 for table in TABLES)
