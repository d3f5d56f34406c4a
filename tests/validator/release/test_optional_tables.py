"""A release tells how drives end, and what sensors see, where its builder is asked to, and is as it was where not."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import LAYERS, breaches, call, contents

from branchdrive.contract.companion import CROISSANT_FILE
from branchdrive.contract.layout import CARD_FILE
from branchdrive.engine.shard import ShardTask, audit_shard
from branchdrive.engine.spool import Spool
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError
from branchdrive.model.reader import open_model
from branchdrive.runtime.executor import in_process

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


def test_rows_that_a_release_has_no_table_for_are_not_computed(root: Path) -> None:
    asked: list[ShardTask] = []

    def noting(function: Any, tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        asked.extend(task for task in tasks if isinstance(task, ShardTask))
        return in_process(function, tasks)

    validate(root, executor=noting)
    assert asked and {task.optional for task in asked} == {frozenset()}
    build_model(root, "--objects")
    asked.clear()
    validate(root, executor=noting)
    assert asked and {task.optional for task in asked} == {frozenset({"objects"})}
    with Spool.temporary() as spool:
        found = [
            {*audit_shard(replace(asked[0], spool=spool, optional=frozenset(names))).frames} for names in ((), TABLES)
        ]
    assert found[1] - found[0] == {*TABLES} and found[0] < found[1]


def test_a_detached_release_tells_both_without_its_raw_layer(raw: Path, tmp_path: Path) -> None:
    stages = [word for stage in LAYERS for word in ("--stage", stage)]
    options = [f"--{table}" for table in TABLES]
    code, _, stderr = call("build", raw, "--output", tmp_path / "release", "--seed", SEED, *options, *stages)
    assert (code, stderr) == (0, "")
    assert breaches(tmp_path / "release") == set()
    assert all(open_model(tmp_path / "release").arrow(table).num_rows > 0 for table in TABLES)
