"""Equal raw layers and options give equal bytes: in any place, with any workers, from any storage of the rows."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from tests.repo.checkout import ROOT
from tests.synthetic import write_dataset
from tests.validator.release.running import build, contents, derived

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json
from branchdrive.contract.layer import table_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.table_file import conform, read_table
from branchdrive.release.builder import STAGES
from branchdrive.runtime.executor import isolated


def test_the_same_build_twice_changes_no_byte(dataset: Path, release: Path, built: Path, audited: Path) -> None:
    build(release)
    assert contents(release) == contents(built)
    build(dataset, stages=STAGES)
    assert contents(dataset) == contents(audited)


@pytest.mark.parametrize("jobs", [2, pytest.param(1, marks=pytest.mark.thorough)])
def test_worker_processes_change_no_byte(dataset: Path, audited: Path, jobs: int) -> None:
    build(dataset, stages=STAGES, executor=isolated(jobs))
    assert contents(dataset) == contents(audited)


def test_a_detached_release_has_the_same_layers(raw: Path, built: Path, tmp_path: Path) -> None:
    before = contents(raw)
    report = build(raw, output=tmp_path / "release")
    assert derived(tmp_path / "release") == derived(built)
    assert report.layers == ("canonical", "quality", "model")
    assert contents(raw) == before
    held = parse_json((tmp_path / "release/branchdrive.json").read_bytes())
    assert held["layers"] == ["canonical", "quality", "model"]
    stated = parse_json((raw / "branchdrive.json").read_bytes())
    assert Descriptor.model_validate({**held, "layers": ["raw"]}) == Descriptor.model_validate(stated)


def test_the_name_of_the_folder_changes_no_byte(raw: Path, built: Path, tmp_path: Path) -> None:
    root = shutil.copytree(raw, tmp_path / "another name")
    build(root)
    assert contents(root) == contents(built)


def test_another_seed_draws_another_split(dataset: Path, built: Path) -> None:
    build(dataset, seed=1)
    path = "quality/split.json"
    assert parse_json((dataset / path).read_bytes())["digest"] != parse_json((built / path).read_bytes())["digest"]


def shuffled(root: Path, folder: str, seed: int) -> dict[str, pa.Table]:
    """Tables of a shard with their rollouts in another order."""
    tables = {}
    for name in TABLES:
        path = f"{folder}/{name}.parquet"
        if (root / path).is_file():
            rows = conform(read_table(Folder(root), path, name), name)
            ids = rows["rollout_id"].to_numpy(zero_copy_only=False)
            known, label = np.unique(ids.astype(str), return_inverse=True)
            rank = np.random.default_rng(seed).permutation(len(known))
            tables[name] = rows.take(pa.array(np.argsort(rank[label], kind="stable")))
    return tables


def test_neither_the_order_of_shards_nor_of_rows_decides_anything(raw: Path, built: Path, tmp_path: Path) -> None:
    folders = sorted(path.relative_to(raw).as_posix() for path in (raw / "raw").iterdir())
    assert len(folders) > 1
    renumbered = {other: shuffled(raw, folder, 5) for folder, other in zip(folders, folders[::-1], strict=True)}
    root = tmp_path / "reordered"
    write_dataset(root, dict(sorted(renumbered.items())), parse_json((raw / "branchdrive.json").read_bytes()))
    build(root)
    found, expected = derived(root), derived(built)
    differing = {path: table_file(path) for path in expected if found[path] != expected[path]}
    names = {path: file.table for path, file in differing.items() if file is not None}
    assert names.keys() == differing.keys()
    assert {*names.values()} == {"records", "media_index"}
    for path, name in names.items():
        rows, wanted = (read_table(Folder(place), path, name).drop_columns("shard") for place in (root, built))
        assert rows.equals(wanted)


BUILD = """
import sys
from pathlib import Path
from tests.validator.release.running import build
from branchdrive.release.builder import STAGES
from branchdrive.leakage.classifier import Unavailable
import branchdrive.release.leakage as stage

stage.sequence_classifier = lambda: Unavailable("none in this test")
build(Path(sys.argv[1]), stages=STAGES)
"""


@pytest.mark.parametrize("threads", ["2", pytest.param("1", marks=pytest.mark.thorough)])
def test_the_number_of_threads_changes_no_byte(built: Path, audited: Path, tmp_path: Path, threads: str) -> None:
    root = shutil.copytree(built, tmp_path / "release")
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    subprocess.run(
        [sys.executable, "-c", BUILD, str(root)],
        env={**os.environ, **dict.fromkeys(names, threads), "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        check=True,
    )
    assert contents(root) == contents(audited)
