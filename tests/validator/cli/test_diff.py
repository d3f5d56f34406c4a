"""`branchdrive diff`: equal data in other files, and every kind of difference by its name."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from tests import synthetic
from tests.audits import remembering
from tests.synthetic import seal_dataset
from tests.synthetic_map import map_descriptor, map_tables
from tests.validator.engine.datasets import FOLDER, cells, edited, write
from tests.validator.engine.rules.release import release_draft

from branchdrive.cli.main import run
from branchdrive.diff.compare import compare_datasets
from branchdrive.engine.validate import validate
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import read_manifest


def diff(*arguments: object) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    code = run(["diff", *map(str, arguments)], out, err)
    return code, out.getvalue(), err.getvalue()


def document(*arguments: object) -> tuple[int, dict[str, Any]]:
    code, out, err = diff(*arguments, "--format", "json")
    assert err == ""
    return code, json.loads(out)


def rewrite(root: Path) -> None:
    """Write every table again as a program that knows nothing of this format would."""
    for path in root.rglob("*.parquet"):
        pq.write_table(pq.read_table(path), path, compression="gzip", store_schema=False, row_group_size=1000)
    seal_dataset(root)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("base") / "dataset")


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return release_draft().write(tmp_path_factory.mktemp("release") / "dataset")


def test_manifests_are_read_once(release: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = []

    def read_and_noted(dataset: Folder) -> Any:
        read.append(dataset)
        return read_manifest(dataset)

    monkeypatch.setattr("branchdrive.diff.compare.read_manifest", read_and_noted)
    assert compare_datasets(Folder(release), Folder(release)).has_equal_data
    assert len(read) == 2


def test_a_copy_is_equal(base: Path, tmp_path: Path) -> None:
    shutil.copytree(base, tmp_path / "copy")
    assert diff(base, tmp_path / "copy") == (0, "files equal by their manifests, data equal\n", "")


def test_what_lies_beside_one_alone_is_told(base: Path, tmp_path: Path) -> None:
    shutil.copytree(base, tmp_path / "copy")
    (tmp_path / "copy/croissant.json").write_text("{}")
    lines = ["files equal by their manifests, data equal", "beside the dataset, only in B: 1", "  croissant.json", ""]
    assert diff(base, tmp_path / "copy") == (0, "\n".join(lines), "")


def test_data_that_differ_under_one_digest_are_a_fault_of_a_manifest(base: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(base, tmp_path / "copy"))
    path = next(other.glob("raw/*/observations.parquet"))
    table = pq.read_table(path)
    place = table.schema.get_field_index("speed_mps")
    zeros = pa.array([0.0] * len(table), table.schema.field(place).type)
    pq.write_table(table.set_column(place, table.schema.field(place), zeros), path)
    code, out, _ = diff(base, other)
    assert code == 1
    assert out.splitlines()[:2] == [
        "files equal by their manifests, data differ",
        "  a file is not what its manifest lists; run branchdrive-validate on both",
    ]


def test_an_unfinished_dataset_is_told_to_be_finished(base: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(base, tmp_path / "copy"))
    (other / "MANIFEST.sha256").unlink()
    (other / ".staging").mkdir()
    code, _, err = diff(base, other)
    assert code == 2
    assert "run the same command again to finish it, or judge what is committed with `branchdrive-validate" in err


def test_a_release_that_duckdb_wrote_holds_equal_data(release: Path, tmp_path: Path) -> None:
    duckdb = pytest.importorskip("duckdb")
    other = tmp_path / "other"
    shutil.copytree(release, other)
    with duckdb.connect() as connection:
        for path in sorted(other.rglob("*.parquet")):
            connection.register("source", pq.read_table(path))
            connection.execute(f"COPY (SELECT * FROM source) TO '{path}' (FORMAT parquet, COMPRESSION gzip)")
    seal_dataset(other)
    code, out, _ = diff(release, other)
    assert (code, out.splitlines()[0]) == (0, "files differ, data equal")
    reports = [validate(root, executor=remembering) for root in (release, other)]
    assert [report.verdict for report in reports] == ["valid", "valid"]
    assert reports[0].dataset.content == reports[1].dataset.content


def test_files_that_another_program_wrote_hold_equal_data(release: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(release, other)
    rewrite(other)
    code, out, _ = diff(release, other)
    assert code == 0
    assert out.startswith("files differ, data equal\n")


def test_a_descriptor_that_claims_more_is_no_difference_of_data(base: Path, tmp_path: Path) -> None:
    other = write(tmp_path / "other", None, {**synthetic.descriptor(), "title": "Another"})
    code, found = document(base, other)
    assert (code, found["data"], len(found["descriptor"])) == (0, "equal", 1)
    assert "title" in found["descriptor"][0]


def test_cells_are_counted_with_the_largest_difference(base: Path, tmp_path: Path) -> None:
    x = synthetic.base_tables()[FOLDER]["observations"]["x_m"].to_pylist()
    other = write(tmp_path / "other", cells("observations", "x_m", {3: x[3] + 0.5, 4: x[4] - 0.25}))
    code, found = document(base, other)
    assert (code, found["data"], len(found["changed"])) == (1, "differ", 1)
    first = {
        "location": {"rollout_id": "g0.accelerate_0.30.a1", "tick": 15},
        "ours": repr(x[3]),
        "theirs": repr(x[3] + 0.5),
    }
    assert found["tables"]["observations"]["columns"] == {
        "x_m": {"num_cells": 2, "largest": pytest.approx(0.5), "first": first}
    }
    assert "x_m: 2 cells differ, by 0.5 at most" in diff(base, other)[1]
    assert "table observations: 2 cells in 1 column differ\n" in diff(base, other)[1]
    assert "  1 file differs, 0 only in A" in diff(base, other)[1]


def test_the_sign_of_a_zero_is_a_difference(base: Path, tmp_path: Path) -> None:
    brake = synthetic.base_tables()[FOLDER]["controls"]["applied_brake"].to_pylist()
    other = write(tmp_path / "other", cells("controls", "applied_brake", {brake.index(0.0): -0.0}))
    found = document(base, other)[1]["tables"]["controls"]["columns"].pop("applied_brake")
    assert (found["num_cells"], found["largest"]) == (1, 0.0)
    assert (found["first"]["ours"], found["first"]["theirs"]) == ("0.0", "-0.0")
    assert "0.0 in A, -0.0 in B" in diff(base, other)[1]


def test_rows_and_attempts_of_one_alone_are_named(base: Path, tmp_path: Path) -> None:
    other = write(tmp_path / "rows", edited("actors", lambda table: table.slice(2)))
    assert document(base, other)[1]["tables"]["actors"] == {"only_first": 2, "only_second": 0, "columns": {}}

    half = write(tmp_path / "half", {FOLDER: synthetic.base_tables()[FOLDER]})
    code, found = document(half, base)
    assert (code, found["only_first"], found["tables"]) == (1, [], {})
    assert found["only_second"] != []


def with_map(root: Path, change: Callable[[pa.Table], pa.Table] | None = None) -> Path:
    """The valid dataset with maps, those of all shards changed in one way."""
    tables = dict(map_tables())
    for folder, shard in tables.items():
        tables[folder] = {**shard, "map": change(shard["map"]) if change else shard["map"]}
    synthetic.write_dataset(root, tables, map_descriptor())
    return root


def test_maps_are_told_apart_by_town_element_and_column(tmp_path: Path) -> None:
    base = with_map(tmp_path / "base")
    towns = sorted({town for shard in map_tables().values() for town in shard["map"]["town"].to_pylist()})

    def shifted(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index("x_m")
        is_wall = [element == "far-wall" for element in table["element_id"].to_pylist()]
        moved = [
            [x + 0.5 for x in xs] if wall else xs for xs, wall in zip(table["x_m"].to_pylist(), is_wall, strict=True)
        ]
        return table.set_column(place, table.schema.field(place), pa.array(moved, table.schema.field(place).type))

    code, found = document(base, with_map(tmp_path / "moved", shifted))
    assert (code, found["data"], found["changed"], found["towns"]) == (1, "differ", [], towns)
    (column,) = found["tables"]["map"]["columns"].items()
    assert (column[0], column[1]["num_cells"], column[1]["largest"]) == ("x_m", len(towns), None)
    assert column[1]["first"]["location"] == {"town": towns[0], "element_id": "far-wall"}

    def without_signal(table: pa.Table) -> pa.Table:
        return table.filter(pc.not_equal(table["element_id"], "far-signal"))

    other = with_map(tmp_path / "less", without_signal)
    assert document(base, other)[1]["tables"]["map"] == {"only_first": len(towns), "only_second": 0, "columns": {}}
    out = diff(base, other)[1]
    assert f"towns whose maps differ: {len(towns)}\n  {towns[0]}\n" in out

    reordered = with_map(tmp_path / "reordered", lambda table: table.take(np.arange(len(table))[::-1]))
    assert diff(base, reordered)[:2][0] == 0


def test_maps_that_one_alone_has_are_named(base: Path, tmp_path: Path) -> None:
    found = document(base, with_map(tmp_path / "mapped"))[1]
    assert found["towns"]
    assert found["tables"]["map"]["only_first"] == 0
    assert found["tables"]["map"]["only_second"] > 0


def test_split_and_population_have_sections_of_their_own(release: Path, tmp_path: Path) -> None:
    draft = release_draft()
    groups = dict(draft.frame("group_quality"))
    groups["partition"] = groups["partition"].copy()
    place = groups["partition"].tolist().index("train")
    groups["partition"][place] = "val"
    draft.put("group_quality", groups)
    draft.reseal("split")
    code, out, _ = diff(release, draft.write(tmp_path / "other"))
    assert code == 1
    for section in ("population (A, not B)", "split (A, not B)", "table quality/group_quality-*.parquet"):
        assert f"{section}: " in out
    assert "partition: 1 cell differ" in out


def test_a_layer_that_one_alone_has_is_named(release: Path, tmp_path: Path) -> None:
    shutil.copytree(release, tmp_path / "other")
    descriptor = json.loads((release / "branchdrive.json").read_bytes())
    (tmp_path / "other" / "branchdrive.json").write_text(json.dumps({**descriptor, "layers": ["raw", "canonical"]}))
    seal_dataset(tmp_path / "other")
    code, found = document(release, tmp_path / "other")
    assert (code, found["layers"]) == (1, ["quality", "model"])


def test_what_is_no_dataset_is_a_wrong_call(base: Path, tmp_path: Path) -> None:
    code, out, err = diff(base, tmp_path)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
