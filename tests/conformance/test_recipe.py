"""Recipes and differences: one is the inverse of the other, and no recipe leaves its dataset."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.recipes.byte_difference import parts_between
from tests.recipes.cell_difference import cell_operations
from tests.recipes.difference import recipe_between, tree
from tests.recipes.table_difference import equal_tables
from tests.sampling import THOROUGH

from branchdrive.contract.columns import TABLES
from branchdrive.contract.document import dump_json
from branchdrive.formats.parquet import encode_table
from branchdrive_conformance.archive import base_files
from branchdrive_conformance.case import cases_dir
from branchdrive_conformance.recipe import apply_recipe
from branchdrive_conformance.splice import spliced
from branchdrive_conformance.table_operation import encoded, read_table

FILE = "raw/shard-00000/controls.parquet"
BASE = pa.table(
    {
        "rollout_id": [f"r{i // 20}" for i in range(100)],
        "tick": pa.array([i % 20 for i in range(100)], pa.int32()),
        "speed": pa.array(np.linspace(-1, 7, 100), pa.float32()),
        "points": [[float(i), None] for i in range(100)],
    }
)
CELLS = st.none() | st.floats(width=32) | st.sampled_from([0.1, -0.0])


@st.composite
def edited(draw: st.DrawFn) -> pa.Table:
    """The table with rows taken in another order, cells changed, and maybe a column more, less or of another type."""
    rows = draw(st.lists(st.integers(0, 99), min_size=1, max_size=60) | st.just(list(range(100))))
    table = BASE.take(pa.array(rows))
    speeds = table["speed"].to_pylist()
    for place, cell in draw(st.dictionaries(st.integers(0, len(rows) - 1), CELLS, max_size=5)).items():
        speeds[place] = cell
    table = table.set_column(2, "speed", pa.array(speeds, pa.float32()))
    change = draw(st.sampled_from(["none", "drop", "add", "cast", "reverse", "metadata"]))
    if change == "drop":
        return table.drop_columns("points")
    if change == "add":
        return table.append_column("more", pa.array(range(len(rows)), pa.int64()))
    if change == "cast":
        return table.set_column(1, "tick", table["tick"].cast(pa.int64()))
    if change == "reverse":
        return table.select(table.column_names[::-1])
    return table.replace_schema_metadata({"a": "b"}) if change == "metadata" else table


@given(table=edited())
@settings(max_examples=30, deadline=None)
def test_a_recipe_leads_to_the_table_that_it_was_made_from(table: pa.Table, tmp_path_factory: Any) -> None:
    folder = tmp_path_factory.mktemp("tables")
    for name, content in (("base", BASE), ("changed", table)):
        path = folder / name / FILE
        path.parent.mkdir(parents=True)
        path.write_bytes(encode_table(content))
    recipe = recipe_between(folder / "base", folder / "changed")
    shutil.copytree(folder / "base", folder / "made")
    apply_recipe(recipe, folder / "made")
    assert equal_tables(read_table((folder / "made" / FILE).read_bytes()), table)


def test_a_recipe_leads_to_the_files_that_it_was_made_from(tmp_path: Path) -> None:
    base, changed = tmp_path / "base", tmp_path / "changed"
    for root in (base, changed):
        (root / "folder").mkdir(parents=True)
        (root / "a.json").write_bytes(dump_json({"a": [1, 2, {"b": 0.5}], "c": "d"}))
        (root / "text.md").write_text("one\ntwo\nthree\n" * 50)
        (root / "folder" / "old").write_text("moves")
        (root / "gone").write_text("goes")
    (changed / "a.json").write_bytes(dump_json({"a": [1, 2, {"b": 0.25}], "e": None}))
    (changed / "text.md").write_text("one\ntwo\nthree\n" * 40 + "four\n" + "one\n")
    (changed / "folder" / "old").rename(changed / "new")
    (changed / "folder").rmdir()
    (changed / "gone").unlink()
    (changed / "empty").mkdir()
    (changed / "link").symlink_to("../elsewhere")
    (changed / "binary").write_bytes(bytes(range(256)))
    recipe = recipe_between(base, changed)
    assert {operation["op"] for operation in recipe} == {"json", "lines", "move", "delete", "folder", "link", "bytes"}
    apply_recipe(recipe, base)
    assert tree(base) == tree(changed)
    files = [path for path, (kind, _) in tree(base).items() if kind == "file"]
    assert all((base / path).read_bytes() == (changed / path).read_bytes() for path in files)


@pytest.mark.parametrize("path", ["../outside", "/outside", "a/../../outside", "out/outside", ""])
def test_a_recipe_stays_inside_its_dataset(path: str, tmp_path: Path) -> None:
    root = tmp_path / "dataset"
    root.mkdir()
    (root / "out").symlink_to(tmp_path)
    with pytest.raises(ValueError, match=r"no path inside|through a link"):
        apply_recipe([{"op": "text", "file": path, "text": "x"}], root)
    assert [place.name for place in tmp_path.iterdir()] == ["dataset"]


@pytest.mark.parametrize(
    "operation",
    [
        {"op": "rows", "keep": [[90, 101]]},
        {"op": "set", "column": "speed", "rows": [[0, 2]], "values": [1.0]},
        {"op": "set", "column": "none", "rows": [[0, 1]], "value": 1.0},
        {"op": "set", "rows": [[0, 1]], "cells": {"speed": 1.0, "none": 1.0}},
        {"op": "set", "column": "speed", "where": {"rollout_id": "r0", "tick": 20}, "value": 1.0},
        {"op": "unknown"},
    ],
)
def test_an_operation_that_does_not_fit_is_refused(operation: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / FILE).parent.mkdir(parents=True)
    (tmp_path / FILE).write_bytes(encode_table(BASE))
    with pytest.raises(ValueError, match=r"within|values for|no column|no row|no operation"):
        apply_recipe([{"file": FILE, **operation}], tmp_path)


def _another(cell: Any, kind: pa.DataType) -> Any:
    """A cell of a type that differs from a cell."""
    if cell is None:
        filled = {pa.types.is_list: [], pa.types.is_boolean: False, pa.types.is_string: "", pa.types.is_dictionary: ""}
        return next((value for is_kind, value in filled.items() if is_kind(kind)), 0)
    if isinstance(cell, list):
        return [*cell, *cell[-1:]] if cell else [_another(None, kind.value_type)]
    return not cell if isinstance(cell, bool) else f"{cell}x" if isinstance(cell, str) else cell + 1 if cell < 1 else 0


@pytest.mark.parametrize("is_every", [False, pytest.param(True, marks=THOROUGH)])
def test_one_changed_cell_of_any_table_is_one_operation(is_every: bool, tmp_path: Path) -> None:
    """And so a case says what it is about; of the columns of a table, one of each type or every one is changed."""
    tables = {
        Path(path).stem.partition("-")[0]: table.slice(0, 5)
        for files in base_files(cases_dir()).values()
        for path, content in sorted(files.items())
        if path.endswith(".parquet") and len(table := read_table(content))
    }
    base, changed = tmp_path / "base", tmp_path / "changed"
    for folder in (base, changed):
        folder.mkdir()
    for stem, table in tables.items():
        name = f"{stem}.parquet"
        (base / name).write_bytes(encode_table(table))
        of_type = {str(field.type): field.name for field in table.schema}
        for column in table.column_names if is_every else of_type.values():
            kind = table.schema.field(column).type
            first, *others = table[column].to_pylist()
            cells = pa.array([_another(first, kind), *others], kind)
            edited = table.set_column(table.column_names.index(column), table.schema.field(column), cells)
            (changed / name).write_bytes(encode_table(edited))
            operations = recipe_between(base, changed)
            assert [(one["op"], one["column"], one["rows"]) for one in operations] == [("set", column, [[0, 1]])]
        (base / name).unlink()
        (changed / name).unlink()
    assert {*TABLES} <= {*tables}


def operations(tmp_path: Path, before: dict[str, bytes], after: dict[str, bytes]) -> list[dict[str, Any]]:
    """The recipe between two datasets, which is seen to lead from one to the other."""
    base, changed = tmp_path / "base", tmp_path / "changed"
    for root, files in ((base, before), (changed, after)):
        for path, content in files.items():
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            (root / path).write_bytes(content)
    recipe = [dict(operation) for operation in recipe_between(base, changed)]
    apply_recipe(recipe, base)
    assert tree(base) == tree(changed)
    for path, content in after.items():
        made = (base / path).read_bytes()
        assert made == content or equal_tables(read_table(made), read_table(content)), path
    return recipe


def _history(groups: list[int]) -> bytes:
    """State histories of groups, four rows each."""
    rows = [(f"g{group}", offset, group + offset / 10) for group in groups for offset in range(4)]
    names, offsets, speeds = zip(*rows, strict=True)
    return encode_table(pa.table({"group_id": names, "offset": offsets, "speed_mps": speeds}))


@pytest.mark.parametrize("kind", [pa.float32(), pa.float64(), pa.list_(pa.float64())])
def test_zeros_of_another_sign_are_other_cells(kind: pa.DataType) -> None:
    zeros = [(0.0, -0.0), (-0.0, -0.0), (float("nan"), float("nan"))]
    one, other = (
        pa.table({"a": pa.array([[z[i]] if pa.types.is_list(kind) else z[i] for z in zeros], kind)}) for i in (0, 1)
    )
    assert equal_tables(one, one)
    assert not equal_tables(one, other)
    assert len(list(cell_operations(one, other))) == 1


def test_a_group_that_moves_to_another_partition_is_one_operation_a_table(tmp_path: Path) -> None:
    train, val = "model/state-train-00000.parquet", "model/state-val-00000.parquet"
    before = {train: _history([*range(0, 40, 2)]), val: _history([*range(1, 40, 2)])}
    after = {train: _history(sorted([*range(0, 40, 2), 7])), val: _history([n for n in range(1, 40, 2) if n != 7])}
    assert operations(tmp_path, before, after) == [
        {"op": "rows", "file": train, "keep": [[0, 16], [12, 16, val], [16, 80]]},
        {"op": "rows", "file": val, "keep": [[0, 12], [16, 80]]},
    ]


@pytest.mark.parametrize(
    ("changed", "ranges"), [([*range(60)][::-1], [[59, -1]]), ([*range(30, 60), *range(30)], [[30, 60], [0, 30]])]
)
def test_rows_in_another_order_are_one_operation(changed: list[int], ranges: list[list[int]], tmp_path: Path) -> None:
    table = pa.table({"rollout_id": ["r"] * 60, "tick": range(60), "x": np.sin(np.arange(60))})
    made = operations(tmp_path, {FILE: encode_table(table)}, {FILE: encode_table(table.take(changed))})
    assert made == [{"op": "rows", "file": FILE, "keep": ranges}]


@pytest.mark.parametrize(("column", "of"), [("x", {}), ("y", {"of": "y"})])
def test_cells_of_other_rows_or_another_column_are_one_operation(
    column: str, of: dict[str, str], tmp_path: Path
) -> None:
    x, y = np.sin(np.arange(90)), np.cos(np.arange(90))
    new = x.copy()
    new[41:80] = {"x": x, "y": y}[column][40:79]
    tables = [pa.table({"tick": range(90), "x": values, "y": y}) for values in (x, new)]
    before, after = ({FILE: encode_table(table)} for table in tables)
    assert operations(tmp_path, before, after) == [
        {"op": "set", "file": FILE, "column": "x", "rows": [[41, 80]], "from": [[40, 79]], **of}
    ]


def test_cells_of_another_column_in_the_same_rows_are_one_operation(tmp_path: Path) -> None:
    x = np.sin(np.arange(90))
    y = np.where(np.arange(90) % 3, np.cos(np.arange(90)), x)
    before, after = (
        {FILE: encode_table(pa.table({"tick": range(90), "x": values, "y": y}))}
        for values in (x, np.where((np.arange(90) >= 10) & (np.arange(90) < 80), y, x))
    )
    assert operations(tmp_path, before, after) == [{"op": "set", "file": FILE, "column": "x", "rows": ANY, "of": "y"}]


def test_columns_that_change_in_the_same_rows_are_one_operation(tmp_path: Path) -> None:
    numbers = np.arange(90.0)
    is_meant = (numbers >= 10) & (numbers < 12)
    columns = {
        "x": np.where(is_meant, 2.5, numbers),
        "y": np.where(is_meant, np.nan, numbers),
        "z": np.where(numbers == 3, 0.5, numbers),
    }
    before = {FILE: encode_table(pa.table({"tick": range(90), **dict.fromkeys(columns, numbers)}))}
    after = {FILE: encode_table(pa.table({"tick": range(90), **columns}))}
    assert operations(tmp_path, before, after) == [
        {"op": "set", "file": FILE, "rows": [[10, 12]], "cells": {"x": 2.5, "y": "NaN"}},
        {"op": "set", "file": FILE, "column": "z", "rows": [[3, 4]], "value": 0.5},
    ]


def _of_attempts(x: Any) -> dict[str, bytes]:
    """A table of three attempts of 40 ticks, in each of which two actors are."""
    places = np.arange(240)
    columns = {"rollout_id": [f"r{i}" for i in places // 80], "tick": places // 2 % 40, "actor_id": places % 2}
    return {FILE: encode_table(pa.table({**columns, "x": x}))}


def test_rows_of_an_actor_are_told_by_what_it_is_called(tmp_path: Path) -> None:
    places = np.arange(240)
    is_meant = (places // 80 == 1) & (places % 2 == 1) & (places // 2 % 40 >= 10)
    x = np.sin(places)
    made = operations(tmp_path, _of_attempts(x), _of_attempts(np.where(is_meant, 2.5, x)))
    where = {"rollout_id": "r1", "actor_id": 1, "tick": {"from": 10, "to": 39}}
    assert made == [{"op": "set", "file": FILE, "column": "x", "where": where, "value": 2.5}]


def test_angles_that_are_turned_and_wrapped_are_two_shifts(tmp_path: Path) -> None:
    yaw, turn = np.arange(-120, 120) / 64, 0.25
    turned = np.where(yaw + turn > 1.75, yaw + turn - 3.5, yaw + turn)
    made = operations(tmp_path, _of_attempts(yaw), _of_attempts(turned))
    assert [(one["op"], one["by"]) for one in made] == [("shift", -3.25), ("shift", 0.25)]


@pytest.mark.parametrize("factor", [0.97, -0.2, 0.5])
def test_a_column_times_a_number_is_one_operation(factor: float, tmp_path: Path) -> None:
    speed = np.linspace(1, 9, 240).astype(np.float32)
    changed = (speed.astype(float) * factor).astype(np.float32)
    (made,) = operations(tmp_path, _of_attempts(speed), _of_attempts(changed))
    assert (made["op"], made["by"]) == ("scale", pytest.approx(factor, rel=1e-6))


def test_rows_in_the_order_of_a_column_are_one_operation(tmp_path: Path) -> None:
    before = _of_attempts(np.sin(np.arange(240)))
    table = read_table(before[FILE])
    after = table.take(pa.array(np.argsort(table["tick"].to_numpy(), kind="stable")))
    made = operations(tmp_path, before, {FILE: encode_table(after)})
    assert made == [{"op": "sort", "file": FILE, "by": ["tick"]}]


def test_a_flipped_byte_is_one_splice(tmp_path: Path) -> None:
    content = np.random.default_rng(1).bytes(5000)
    flipped = content[:700] + bytes([content[700] ^ 255]) + content[701:]
    (made,) = operations(tmp_path, {"media.bin": content}, {"media.bin": flipped})
    assert (made["op"], len(made["parts"]), made["parts"][::2]) == ("splice", 3, [[0, 700], [701, 5000]])


def test_a_file_under_a_second_name_is_one_copy(tmp_path: Path) -> None:
    content = bytes(range(256)) * 4
    made = operations(tmp_path, {"media.bin": content}, {"media.bin": content, "again.bin": content})
    assert made == [{"op": "copy", "path": "media.bin", "to": "again.bin"}]


def test_a_table_that_is_written_otherwise_says_how(tmp_path: Path) -> None:
    made = operations(tmp_path, {FILE: encode_table(BASE)}, {FILE: encoded(BASE, {"compression": "snappy"})})
    assert made == [{"op": "written", "file": FILE, "settings": {"compression": "snappy"}}]


def test_metadata_of_one_column_is_one_operation(tmp_path: Path) -> None:
    field = BASE.schema.field("tick").with_metadata({"unit": "s"})
    changed = BASE.cast(BASE.schema.set(1, field))
    made = operations(tmp_path, {FILE: encode_table(BASE)}, {FILE: encode_table(changed)})
    assert made == [{"op": "describe", "file": FILE, "columns": {"tick": {"unit": "s"}}}]


@given(old=st.binary(max_size=400), cuts=st.lists(st.integers(0, 400), max_size=4), more=st.binary(max_size=40))
def test_bytes_are_parts_of_other_bytes(old: bytes, cuts: list[int], more: bytes) -> None:
    new = b"".join(old[cut : cut + 60] + more for cut in cuts)
    assert spliced(old, parts_between(old, new)) == new
