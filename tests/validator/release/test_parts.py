"""Releases of several parts: shards 63 and 64 are neighbours in different parts."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic import seal_dataset
from tests.synthetic_release import SEED
from tests.validator.release.running import build, call, contents, derived

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import parse_json
from branchdrive.contract.layer import LAYERS, part_of, table_file, table_path, table_paths
from branchdrive.diff.compare import compare_datasets
from branchdrive.engine.cache import Cache
from branchdrive.engine.derived_rules import LayersTask, judge_part
from branchdrive.engine.report import Report
from branchdrive.engine.spool import SpooledFrames
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import conform, join_parts, read_layer_table, read_table
from branchdrive.model.reader import open_model
from branchdrive.runtime.executor import in_process, isolated
from branchdrive.tables.arrow import StoredFrame, from_arrow

SHARDS = {
    "raw/shard-00000": "raw/shard-00000",
    "raw/shard-00001": "raw/shard-00063",
    "raw/shard-00002": "raw/shard-00064",
}


@pytest.fixture(scope="module")
def two_parts(raw: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release of the same raw layer whose last shard is the first of another part; read-only by agreement."""
    root = shutil.copytree(raw, tmp_path_factory.mktemp("parts") / "dataset")
    for old, new in reversed(SHARDS.items()):
        (root / old).rename(root / new)
    seal_dataset(root)
    build(root)
    return root


@pytest.fixture
def copied(two_parts: Path, tmp_path: Path) -> Path:
    """A copy of one's own."""
    return shutil.copytree(two_parts, tmp_path / "dataset")


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
    build(root, executor=isolated(2))
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
    """Rows of one part are read at a time, by whoever works on it, and never those of all."""
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


def rewrite(root: Path, path: str, rows: Any) -> None:
    file = table_file(path)
    assert file is not None
    (root / path).write_bytes(encode_table(conform(rows, file.table)))


def read(root: Path, path: str) -> Any:
    file = table_file(path)
    assert file is not None
    return conform(read_table(Folder(root), path, file.table), file.table)


@pytest.mark.parametrize("table", ["records", "group_quality", "attempts"])
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
    "path", [table_path("records", part=2), table_path("scalars", "train", 7), table_path("scalars", "calibration", 1)]
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


def told(root: Path, **options: Any) -> Any:
    """What a report says but for how long it took."""
    report = validate(root, **options)
    rules = [(t.rule_id, t.status, t.reason, t.examined, t.total, t.num_findings, t.findings) for t in report.tallies]
    return report.verdict, rules


def on_all_rows(root: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What a report says where parts give no pieces."""
    with monkeypatch.context() as patched:
        patched.setattr("branchdrive.engine.derived._are_in_place", lambda _: False)
        return told(root)


def drop_first_pair(root: Path) -> None:
    path = table_path("pairs", part=1)
    rewrite(root, path, read(root, path).slice(1))


def change_bank_of_part(root: Path) -> None:
    path = table_path("pairs", part=1)
    rows = read(root, path)
    import pyarrow.compute as pc

    rewrite(root, path, rows.filter(pc.not_equal(rows["action_key"], rows["action_key"][0])))


def spoil_history(root: Path) -> None:
    path = next(path for path in table_paths("state", derived(root)) if path.endswith("-00001.parquet"))
    rewrite(root, path, read(root, path).slice(1))


def repeat_context(root: Path) -> None:
    paths = table_paths("contexts", derived(root))
    first, other = (next(path for path in paths if path.endswith(f"-0000{part}.parquet")) for part in (0, 1))
    rewrite(root, first, join_parts([read(root, first), read(root, other)]))


def misstate_documents(root: Path) -> None:
    for path, name in (("quality/thresholds.json", "num_groups"), ("canonical/source.json", "num_attempts")):
        document = parse_json((root / path).read_bytes())
        (root / path).write_text(json.dumps({**document, name: document[name] + 1}))


@pytest.mark.parametrize(
    "change", [None, drop_first_pair, change_bank_of_part, spoil_history, repeat_context, misstate_documents]
)
def test_pieces_of_parts_say_what_all_rows_say(
    change: Callable[[Path], None] | None, copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if change is not None:
        change(copied)
        seal_dataset(copied)
    found = told(copied)
    assert found[0] == ("valid" if change is None else "invalid")
    assert found == on_all_rows(copied, monkeypatch)


LARGE = {"pairs", "state", "past_controls", "expert", "surroundings", "scalars", "trajectories", "candidates"}
"""Tables of which no task on the whole reads a sound release."""


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Parts that are judged, and the tables and rows of several shards that tasks on the whole take."""
    found: dict[str, list[Any]] = {"parts": [], "tables": [], "rows": []}
    column_of, rows_of = StoredFrame.__getitem__, SpooledFrames.__getitem__
    names = {frozenset(table_columns(name)): name for name in LAYER_TABLES}

    def judged(task: Any) -> Any:
        found["parts"].append(task.part)
        return judge_part(task)

    def column(frame: StoredFrame, name: str) -> Any:
        found["tables"] += [names[frozenset(frame)]] if found["parts"][-1:] == [None] else []
        return column_of(frame, name)

    def rows(frames: SpooledFrames, name: str) -> Any:
        found["rows"] += [name] if found["parts"][-1:] == [None] and len(frames._shards) > 1 else []
        return rows_of(frames, name)

    monkeypatch.setattr(StoredFrame, "__getitem__", column)
    monkeypatch.setattr(SpooledFrames, "__getitem__", rows)
    monkeypatch.setattr("branchdrive.engine.derived.judge_part", judged)
    return found


def test_tasks_on_the_whole_take_no_large_table(two_parts: Path, taken: dict[str, list[Any]]) -> None:
    assert validate(two_parts).verdict == "valid"
    assert taken["parts"][:2] == [0, 1]
    assert not {*taken["tables"]} & LARGE
    assert {*taken["rows"]} == {"routes"}


def test_pieces_of_a_part_that_an_earlier_run_judged_are_taken_from_the_cache(
    copied: Path, tmp_path: Path, taken: dict[str, list[Any]]
) -> None:
    cache = Cache(tmp_path / "cache")
    validate(copied, cache=cache)
    path = table_path("attempts", part=1)
    rows = read(copied, path)
    column = rows.schema.get_field_index("disposition")
    kept = [*rows["disposition"].to_pylist()[::-1]]
    import pyarrow as pa

    rewrite(copied, path, rows.set_column(column, rows.schema.field(column), pa.array(kept, rows.schema.types[column])))
    seal_dataset(copied)
    taken["parts"].clear()
    found = told(copied, cache=cache)
    assert {*taken["parts"]} == {1, None}
    assert not {*taken["tables"]} & LARGE
    assert found == told(copied)
    assert found[0] == "invalid"


def test_files_of_a_table_stand_in_the_order_of_partition_and_part(two_parts: Path) -> None:
    paths = table_paths("scalars", sorted(derived(two_parts), reverse=True))
    partitions = LAYER_TABLES["scalars"].partitions
    places = [(partitions.index(str(file.partition)), file.part) for path in paths if (file := table_file(path))]
    assert places == sorted(places)
    for before, after in zip_longest(places, places[1:]):
        assert before != after
