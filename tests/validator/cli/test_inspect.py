"""`branchdrive inspect`: what a path is, on one screen, whatever lies there."""

from __future__ import annotations

import io
import shutil
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests import synthetic
from tests.bucket_server import serving, use
from tests.places import packed
from tests.validator.cli.test_main import call
from tests.validator.engine.datasets import FOLDER, write
from tests.validator.engine.rules.release import release_draft

from branchdrive.cli import inspect_text
from branchdrive.cli.main import run
from branchdrive.contract.columns import LAYER_TABLES, TABLES
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.place import open_store
from branchdrive.inspection import overview, table_files
from branchdrive.inspection.loading import loading
from branchdrive.inspection.overview import look_over
from branchdrive.raw.reader import open_dataset
from branchdrive.text.terminal import render

inspect = partial(call, run, "inspect")


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("raw") / "dataset")


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return release_draft().write(tmp_path_factory.mktemp("release") / "dataset")


def facts_of(text: str) -> dict[str, str]:
    """Facts of an overview by name, each on one line."""
    lines = [line.split("  ", 1) for line in text.split("\n\n")[0].splitlines()[1:] if not line.startswith(" ")]
    return {name: said.strip() for name, said in lines}


def rows_of(text: str) -> dict[str, list[str]]:
    """Cells of the table of tables by the name of the table."""
    section = text.split("\nTables\n")[1].split("\n\n")[0]
    cells = [line.split() for line in section.splitlines()[2:]]
    layers = ("raw", "canonical", "quality", "model")
    return {row[row[0] in layers]: row[1 + (row[0] in layers) :] for row in cells}


def look(root: Path) -> overview.Overview:
    return look_over(Folder(root), read_descriptor(Folder(root)))


def test_a_dataset_is_told_with_its_groups_and_tables(raw: Path) -> None:
    code, out, err = inspect(raw)
    assert (code, err) == (0, "")
    dataset = open_dataset(raw)
    descriptor = dataset.descriptor
    assert out.startswith(f"{descriptor.dataset_id} {descriptor.dataset_version} a dataset\n")
    facts = facts_of(out)
    assert facts["groups"] == f"{len(dataset.groups)} branch groups in {len(dataset.shards)} shards"
    assert facts["streams"] == ", ".join(descriptor.streams)
    types = {context["scenario_type"] for context in dataset.contexts.values()}
    assert all(name in out for name in types)
    rows = rows_of(out)
    assert [*rows] == [*descriptor.tables]
    for name in descriptor.tables:
        assert rows[name][:2] == [f"{dataset.table(name).read().num_rows:,}", str(len(dataset.shards))]


def test_a_release_is_told_with_its_partitions(release: Path) -> None:
    _, out, _ = inspect(release)
    contexts = open_dataset(release).contexts.values()
    frozen = [one["partition"] for one in contexts if one["core_valid"] and not one["near_duplicate"]]
    partitions = ", ".join(f"{name} ({frozen.count(name)})" for name in ("train", "val", "test"))
    assert facts_of(out)["partitions"] == partitions
    assert set(rows_of(out)) >= {"records", "group_quality", "scalars", "trajectories"}
    assert "a release beside its raw layer" in out.splitlines()[0]


def test_a_detached_release_is_told_without_attempts(release: Path, tmp_path: Path) -> None:
    root = tmp_path / "detached"
    shutil.copytree(release, root, ignore=shutil.ignore_patterns("raw"))
    text = (root / "branchdrive.json").read_text().replace('"raw",', "", 1)
    (root / "branchdrive.json").write_text(text)
    _, out, _ = inspect(root)
    assert "a detached release" in out.splitlines()[0]
    assert "rollouts" not in rows_of(out)
    code, group, _ = inspect(root, open_dataset(release).groups[0])
    assert code == 0
    assert "with 0 attempts" in group


@pytest.mark.parametrize("width", [80, 120])
def test_nothing_but_lines_to_copy_is_wider_than_the_terminal(
    width: int, release: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive.text.terminal.PLAIN_WIDTH", width)
    group = open_dataset(release).groups[0]
    for arguments in ([release], [release, "observations"], [release, "scalars"], [release, group]):
        text = inspect(*arguments)[1].split("\nLoad it\n")[0]
        assert max(map(len, text.splitlines())) <= width


def test_a_table_is_told_column_by_column(release: Path) -> None:
    code, out, _ = inspect(release, "scalars")
    assert code == 0
    for column in LAYER_TABLES["scalars"].columns:
        line = next(line for line in out.splitlines() if line.startswith(f"{column.name} "))
        assert column.track in line
        assert column.unit is None or f" {column.unit} " in line
    stored = pq.read_table(sorted(release.glob("model/scalars-train-*.parquet"))[0])
    values = [value for value in stored["displacement_m"].to_pylist() if value is not None]
    assert f"{min(values):.6g} .. {max(values):.6g}" in out


def test_an_optional_table_is_told_where_it_is_there(release: Path, tmp_path: Path) -> None:
    _, out, _ = inspect(release)
    assert "endings" not in out
    assert "Not read" not in out
    code, out, err = inspect(release, "endings")
    assert (code, out) == (2, "")
    assert "has no table `endings`, which `branchdrive build --endings` adds" in err
    draft = release_draft()
    draft.add_endings()
    root = draft.write(tmp_path / "dataset")
    assert rows_of(inspect(root)[1])["endings"][0] == f"{len(draft.tables['model']['endings']):,}"
    code, out, _ = inspect(root, "endings")
    assert code == 0
    assert "route_fraction" in out


def test_a_group_is_told_attempt_by_attempt(raw: Path) -> None:
    dataset = open_dataset(raw)
    code, out, _ = inspect(raw, dataset.groups[0])
    assert code == 0
    group = dataset.group(dataset.groups[0])
    rows = out.split("went\n")[1].splitlines()[2:]
    policies = [str(rollout.record["action_key"]) for rollout in group.rollouts]
    assert [row.split()[0] for row in rows] == policies
    assert str(group.nominal.record["town"]) in out


def test_a_dataset_is_told_wherever_it_is(
    release: Path, raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serving() as server:
        use(server, monkeypatch)
        server.fill(release, "release")
        for place in (str(packed(release, tmp_path / "release.zip")), "s3://bucket/release"):
            for word in ("scalars", open_dataset(release).groups[0]):
                expected, found = inspect(release, word)[1], inspect(place, word)
                assert found[::2] == (0, "")
                assert found[1].split("\nLoad it\n")[0] == expected.split("\nLoad it\n")[0]
            expected, (code, found, _) = inspect(release)[1], inspect(place)
            assert code == 0
            assert rows_of(found) == rows_of(expected)
            assert {**facts_of(found), "at": ""} == {**facts_of(expected), "at": ""}
            assert f"BranchGroupDataset('{place}', 'train', 'sensor')" in found
        code, _, err = inspect("s3://bucket/release/raw")
        assert (code, err.count("\n")) == (2, 1)
        assert "is no dataset: there is no 'branchdrive.json'" in err
    archive = packed(raw, tmp_path / "raw.zip")
    (lines,) = loading(look_over(open_store(archive), read_descriptor(Folder(raw))))
    scope: dict[str, object] = {}
    exec("\n".join(lines.lines), scope)
    assert len(scope["rows"]) == open_dataset(raw).rollouts().num_rows  # type: ignore[arg-type]


def test_files_of_a_dataset_are_told(release: Path) -> None:
    _, out, _ = inspect(release / "raw/shard-00000/controls.parquet")
    assert "table 'controls'" in out.splitlines()[0]
    assert "applied_steer" in out
    for path, what in {
        "quality/split.json": "document of the quality layer",
        "MANIFEST.sha256": "manifest",
        "branchdrive.json": "descriptor",
    }.items():
        code, out, _ = inspect(release / path)
        assert (code, what in out.splitlines()[0]) == (0, True)


def test_files_of_others_are_told(tmp_path: Path) -> None:
    pq.write_table(pa.table({"speed": [1.5, None, 2.5], "name": ["a", "b", "b"]}), tmp_path / "mine.parquet")
    code, out, _ = inspect(tmp_path / "mine.parquet")
    assert code == 0
    assert "a table that is not declared" in " ".join(out.split())
    assert "1.5 .. 2.5" in out
    assert "33%" in out
    assert "b, a" in out
    (tmp_path / "notes.txt").write_text("x")
    assert "no file of a dataset" in inspect(tmp_path / "notes.txt")[1]


def test_a_damaged_table_is_named_and_costs_no_other(raw: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(raw, tmp_path / "copy"))
    (root / FOLDER / "controls.parquet").write_bytes(b"PAR1 and no more PAR1")
    code, out, err = inspect(root)
    assert (code, err) == (0, "")
    assert "Not read: table 'controls' " in out
    assert rows_of(out)["controls"][0] == "-"
    assert rows_of(out)["observations"][0] != "-"
    code, out, err = inspect(root, "controls")
    assert (code, out, err.count("\n")) == (2, "", 1)
    (root / FOLDER / "rollouts.parquet").unlink()
    code, out, err = inspect(root)
    assert (code, err) == (0, "")
    assert "'raw/shard-00000/rollouts.parquet' does not exist" in " ".join(out.split())


def test_what_is_no_dataset_is_one_clear_line(raw: Path, tmp_path: Path) -> None:
    (tmp_path / "two").mkdir()
    shutil.copy(raw / "branchdrive.json", tmp_path / "two")
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    (damaged / "branchdrive.json").write_text("{")
    (tmp_path / "empty").mkdir()
    for arguments, said in {
        (tmp_path / "nothing",): "there is nothing at",
        (tmp_path / "empty",): "is no dataset: there is no 'branchdrive.json' in it",
        (tmp_path,): f"is no dataset and holds some: `{damaged}`, `{tmp_path / 'two'}`",
        (raw / "raw",): f"run `branchdrive inspect {raw}`",
        (damaged,): "is not a descriptor",
        (raw, "obervations"): "did you mean 'observations'?",
        (raw, "zzz"): "there are `rollouts`",
        (raw / "MANIFEST.sha256", "controls"): "is a file",
    }.items():
        code, out, err = inspect(*arguments)
        assert (code, out, err.count("\n")) == (2, "", 1), said
        assert said in err


def test_an_unfinished_collection_is_told_how_to_go_on(raw: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(raw, tmp_path / "copy"))
    (root / "MANIFEST.sha256").unlink()
    (root / ".staging").mkdir()
    _, out, _ = inspect(root)
    assert "a collection that is not finished" in out.splitlines()[0]
    assert f"branchdrive staging {root}" in out


def test_of_many_shards_the_first_are_looked_at(raw: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (table_files, overview, inspect_text):
        monkeypatch.setattr(module, "MOST_SHARDS", 1)
    _, out, _ = inspect(raw)
    num_shards = len(open_dataset(raw).shards)
    assert f"in the first 1 of {num_shards} shards" in out
    assert rows_of(out)["controls"][1] == "1"
    last = open_dataset(raw).groups[-1]
    assert inspect(raw, last)[0] == 0


def test_text_of_a_dataset_is_printable(tmp_path: Path) -> None:
    root = write(tmp_path / "dataset", None, {**synthetic.descriptor(), "title": "red \x1b[31m alert\u202e"})
    text = render(partial(inspect_text.print_overview, found=look(root)), io.StringIO())
    assert text.replace("\n", "").isprintable()
    assert "\\x1b[31m" in text


def test_the_lines_load_the_rows(release: Path) -> None:
    found = {lines.library: lines.lines for lines in loading(look(release))}
    assert [*found] == ["pandas", "polars", "DuckDB", "datasets", "torch"]
    num_rows = sum(len(pq.read_table(path)) for path in release.glob("model/scalars-train-*.parquet"))
    scope: dict[str, object] = {}
    exec("\n".join(found["pandas"]), scope)
    assert len(scope["rows"]) == num_rows  # type: ignore[arg-type]
    pytest.importorskip("torch")
    exec("\n".join(found["torch"]), scope)
    assert len(scope["groups"]) * 13 == num_rows  # type: ignore[arg-type]


def test_the_lines_load_the_rows_of_several_files(raw: Path) -> None:
    found = {lines.library: lines.lines for lines in loading(look(raw))}
    num_rows = open_dataset(raw).rollouts().num_rows
    scope: dict[str, object] = {}
    exec("\n".join(found["pandas"]), scope)
    assert len(scope["rows"]) == num_rows  # type: ignore[arg-type]
    pytest.importorskip("duckdb")
    exec("\n".join(found["DuckDB"]), scope)
    assert len(scope["rows"]) == num_rows  # type: ignore[arg-type]


@pytest.mark.parametrize(("library", "package"), [("polars", "polars"), ("datasets", "datasets")])
def test_the_lines_of_heavy_libraries_load_the_rows(library: str, package: str, raw: Path) -> None:
    pytest.importorskip(package, reason=f"{package} is heavy: run `pip install {package}` to try these lines")
    found = {lines.library: lines.lines for lines in loading(look(raw))}
    scope: dict[str, object] = {}
    exec("\n".join(found[library]), scope)
    assert len(scope["rows"]) == open_dataset(raw).rollouts().num_rows  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("table", "row"), [("actors", "observation and actor"), ("map", "town and element"), ("evidence", "observation")]
)
def test_what_has_a_row_is_all_of_the_key(table: str, row: str) -> None:
    assert inspect_text._rate(TABLES[table]) == row
