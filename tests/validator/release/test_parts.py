"""Releases of several parts: shards 63 and 64 are neighbours in different parts."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest
from tests.sampling import sampled
from tests.synthetic import seal_dataset
from tests.synthetic_release import SEED
from tests.validator.release.running import SHARDS, build, call, contents, derived, read, rewrite

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import parse_json
from branchdrive.contract.layer import LAYERS, part_of, table_file, table_path, table_paths
from branchdrive.diff.compare import compare_datasets
from branchdrive.engine.derived_rules import LayersTask
from branchdrive.engine.report import Report
from branchdrive.engine.spool import SpooledFrames
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import conform, join_parts, read_layer_table, read_table
from branchdrive.model.reader import open_model
from branchdrive.runtime.executor import in_process
from branchdrive.runtime.standing import standing
from branchdrive.tables.arrow import from_arrow


def tables(root: Path) -> dict[str, Any]:
    return {path: file for path in derived(root) if (file := table_file(path)) is not None}


def findings(report: Report) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for finding in report.findings:
        if next(t.info.decides for t in report.tallies if t.rule_id == finding.rule):
            found.setdefault(finding.rule, []).append({**finding.location})
    return found


def test_a_row_is_in_the_part_of_the_shard_of_its_group(two_parts: Path) -> None:
    folder = Folder(two_parts)
    records = from_arrow(read_layer_table(folder, "records"), "records")
    shards = {g: s for g, s in zip(records["group_id"], records["shard"], strict=True) if s is not None}
    assert {part_of(shard) for shard in shards.values()} == {0, 1}
    for path, file in tables(two_parts).items():
        rows = from_arrow(read_table(folder, path, file.table), file.table)
        if file.part is None:
            assert not LAYER_TABLES[file.table].is_of_groups
            continue
        assert {part_of(shards[group]) for group in rows["group_id"].tolist()} <= {file.part}
        assert len(rows["group_id"]) or path == table_path(file.table, file.partition)


def test_workers_and_this_process_build_the_same_parts(raw: Path, two_parts: Path, tmp_path: Path) -> None:
    root = shutil.copytree(two_parts, tmp_path / "dataset")
    for path in tables(root):
        (root / path).unlink()
    with standing(2) as workers:  # test_determinism.py builds one part by processes that are new for every step
        build(root, executor=workers)
    assert contents(root) == contents(two_parts)


@pytest.mark.parametrize(("most", "starts"), [(10**6, False), (0, True)])
def test_a_few_groups_of_one_part_start_no_process(
    most: int, starts: bool, raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[str] = []

    def noted(function: Any, tasks: Any) -> Any:
        called.append(function.__name__)
        return in_process(function, tasks)

    monkeypatch.setattr("branchdrive.release.stage_work.MAX_GROUPS_HERE", most)
    build(shutil.copytree(raw, tmp_path / "dataset"), stages=["canonical"], executor=noted)
    assert ("canonical_part" in called) == starts


def test_a_stage_refuses_layers_whose_shards_were_renumbered_since(two_parts: Path, raw: Path, tmp_path: Path) -> None:
    output = tmp_path / "release"
    build(raw, output=output)
    with pytest.raises(UsageError, match=r"part 0 of the layers holds other groups than its shards; start with the st"):
        build(two_parts, output=output, stages=["model"])
    build(two_parts, output=output)
    assert derived(output) == derived(two_parts)


def test_no_table_waits_in_the_builder(raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of one part are read at a time, by the worker that has it, and never those of all."""
    taken: list[tuple[str, int]] = []
    read = SpooledFrames.__getitem__

    def noted(frames: SpooledFrames, name: str) -> Any:
        taken.append((name, len(frames._shards)))
        return read(frames, name)

    root = shutil.copytree(raw, tmp_path / "dataset")
    monkeypatch.setattr(SpooledFrames, "__getitem__", noted)
    monkeypatch.setattr("branchdrive.release.scan.part_of", lambda folder: int(folder[-5:]))
    build(root, stages=["canonical", "quality"])
    assert {name for name, num_shards in taken if num_shards > 1} == {"routes"}
    assert {"pairs", "records", "state"} <= {name for name, _ in taken}


def test_the_release_is_valid_and_equals_that_of_one_part_but_for_names_of_shards(two_parts: Path, built: Path) -> None:
    report = validate(two_parts)
    assert report.verdict == "valid", findings(report)
    folders = [Folder(root) for root in (built, two_parts)]
    for name, table in LAYER_TABLES.items():
        if name in LAYERS["benchmark"].tables or table.optional:
            continue
        rows = [conform(read_layer_table(folder, name), name) for folder in folders]
        kept = [column for column in table_columns(name) if column != "shard"]
        order = [(column, "ascending") for column in table.key]
        ours, theirs = (one.select(kept).sort_by(order) for one in rows)
        assert ours.equals(theirs), name
    documents = [
        {path: parse_json((root / path).read_bytes()) for path in derived(root) if path.endswith(".json")}
        for root in (built, two_parts)
    ]
    for one in documents:
        one.pop("canonical/source.json")
    assert documents[0] == documents[1]


def table_columns(name: str) -> list[str]:
    return [column.name for column in LAYER_TABLES[name].columns]


def test_diff_takes_a_row_that_has_moved_to_another_part_for_the_same(two_parts: Path, built: Path) -> None:
    found = compare_datasets(Folder(built), Folder(two_parts))
    for path, table in found.tables.items():
        assert (table.only_first, table.only_second) == (0, 0), path
        assert not table.columns or {*table.columns} == {"shard"}, path


def test_readers_give_the_rows_of_all_parts(two_parts: Path, built: Path) -> None:
    ours, theirs = (open_model(root) for root in (two_parts, built))
    assert ours.groups() == theirs.groups()
    for name in ("state", "controls"):
        assert (getattr(ours.sensor_inputs(), name) == getattr(theirs.sensor_inputs(), name)).all()


def test_a_change_of_one_shard_changes_its_parts_and_what_is_of_no_part(two_parts: Path, built: Path) -> None:
    ours, theirs = derived(two_parts), derived(built)
    for path, file in tables(two_parts).items():
        if file.part == 1:
            assert path not in theirs
            assert ours[path]


@pytest.mark.parametrize("table", sampled(["records", "group_quality", "attempts"], every=2))
def test_rows_of_a_group_in_another_part_are_one_finding_for_their_file(table: str, copied: Path) -> None:
    first, second = (table_path(table, part=part) for part in (0, 1))
    rows, others = read(copied, first), read(copied, second)
    group = rows["group_id"][0].as_py()
    is_moved = [one.as_py() == group for one in rows["group_id"]]
    import pyarrow as pa

    mask = pa.array(is_moved)
    rewrite(
        copied,
        second,
        join_parts([rows.filter(mask), others]).sort_by([(k, "ascending") for k in LAYER_TABLES[table].key])
        if table != "records"
        else join_parts([rows.filter(mask), others]),
    )
    rewrite(copied, first, rows.filter(pa.array([not one for one in is_moved])))
    seal_dataset(copied)
    found = findings(validate(copied))
    assert {*found} - {"BD-LYR-009"} == {"BD-LYR-010"}
    assert all(place["file"] for place in found["BD-LYR-010"])
    assert second in {place["file"] for place in found["BD-LYR-010"]}


@pytest.mark.parametrize(
    "path",
    sampled(
        [table_path("records", part=2), table_path("scalars", "train", 7), table_path("scalars", "calibration", 1)],
        every=2,
    ),
)
def test_a_part_without_rows_has_no_file(path: str, copied: Path) -> None:
    file = table_file(path)
    assert file is not None
    full = next(iter(table_paths(file.table, derived(copied))))
    rewrite(copied, path, read(copied, full).slice(0, 0))
    seal_dataset(copied)
    assert findings(validate(copied)) == {"BD-LYR-010": [{"file": path, "table": file.table}]}


def test_a_part_that_is_missing_is_missing_rows(copied: Path) -> None:
    path = table_path("group_quality", part=1)
    (copied / path).unlink()
    seal_dataset(copied)
    found = findings(validate(copied))
    assert "BD-LYR-001" not in found
    assert {
        place["file"] for places in found.values() for place in places if place.get("table") == "group_quality"
    } == {path}
    assert "BD-QUA-005" in found


def test_a_part_of_an_optional_table_that_is_missing_is_missing_rows(copied: Path) -> None:
    assert call("build", copied, "--stage", "model", "--seed", SEED, "--endings")[0] == 0
    assert validate(copied).verdict == "valid"
    path = next(path for path in table_paths("endings", derived(copied)) if path.endswith("-00001.parquet"))
    num_rows = read(copied, path).num_rows
    (copied / path).unlink()
    seal_dataset(copied)
    report = validate(copied)
    assert {(rule, place["file"]) for rule, places in findings(report).items() for place in places} >= {
        ("BD-MOD-004", path)
    }
    assert next(t.num_findings for t in report.tallies if t.rule_id == "BD-MOD-004") == num_rows


def test_a_table_without_a_file_misses_its_first_part(copied: Path) -> None:
    for path in table_paths("pairs", derived(copied)):
        (copied / path).unlink()
    seal_dataset(copied)
    assert findings(validate(copied)) == {"BD-LYR-001": [{"file": table_path("pairs")}]}


def test_tables_of_an_earlier_draft_are_refused_and_built_anew(copied: Path, two_parts: Path) -> None:
    for name in ("records", "attempts"):
        rows = join_parts([read(copied, path) for path in table_paths(name, derived(copied))])
        for path in table_paths(name, derived(copied)):
            (copied / path).unlink()
        (copied / f"canonical/{name}.parquet").write_bytes(encode_table(rows))
    seal_dataset(copied)
    found = findings(validate(copied))
    assert {*found} == {"BD-LYR-001", "BD-LAY-009"}
    build(copied)
    assert derived(copied) == derived(two_parts)


def test_tasks_on_a_part_name_its_files_and_no_others(two_parts: Path) -> None:
    tasks: list[Any] = []

    def noting(function: Any, some: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        tasks.extend(task for task in some if isinstance(task, LayersTask))
        return in_process(function, some)

    assert validate(two_parts, executor=noting).verdict == "valid"
    of_parts = [task for task in tasks if task.part is not None]
    assert [task.part for task in of_parts] == [0, 1]
    for task in of_parts:
        for named in (task.names, task.num_rows, task.digests, task.content):
            assert {file.part for path in named if (file := table_file(path)) is not None} <= {None, task.part}
        assert {part_of(shard.replace("-", "/", 1)) for shard in task.raw.shards} == {task.part}
    shards = [shard for task in of_parts for shard in task.raw.shards]
    assert len(shards) == len({*shards}) == len(SHARDS)


def test_files_of_a_table_stand_in_the_order_of_partition_and_part(two_parts: Path) -> None:
    paths = table_paths("scalars", sorted(derived(two_parts), reverse=True))
    partitions = LAYER_TABLES["scalars"].partitions
    places = [(partitions.index(str(file.partition)), file.part) for path in paths if (file := table_file(path))]
    assert places == sorted(places)
    for before, after in zip_longest(places, places[1:]):
        assert before != after
