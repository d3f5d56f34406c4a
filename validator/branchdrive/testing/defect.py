"""Hypothesis strategies for datasets with one defect, each of a rule that must fail at a known place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import pyarrow as pa
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from branchdrive.contract.columns import TABLES, Column
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.testing.dataset import SmallDataset, show_call, write_dataset
from branchdrive.testing.driven import datasets
from branchdrive.testing.group import Tables

__all__ = ["Defect", "defects", "with_cells", "with_column", "without_row"]

Make: TypeAlias = "Callable[[DrawFn, SmallDataset], Defect | None]"

_BEYOND_M = 2.0
"""Farther than any tolerance on evidence, poses and displacements."""


@dataclass(frozen=True)
class Defect:
    """A valid dataset with one defect.

    Attributes:
        rule: The rule that must fail.
        at: Parts of the location of one of its findings.
        what: The defect in words.
        dataset: The dataset without the defect.
        tables: Tables by shard folder and name that take the place of those of the dataset.
        descriptor: The descriptor document.
        edit: What happens to the written folder after it is sealed.
    """

    rule: str
    at: Mapping[str, Any]
    what: str
    dataset: SmallDataset
    tables: Mapping[str, Tables] = field(default_factory=dict, repr=False)
    descriptor: Mapping[str, Any] | None = field(default=None, repr=False)
    edit: Callable[[Path], object] | None = field(default=None, repr=False)

    def write(self, root: Path | str) -> Path:
        """Write the dataset with its defect into the new folder `root`, which is returned."""
        tables = {folder: {**shard, **self.tables.get(folder, {})} for folder, shard in self.dataset.tables.items()}
        write_dataset(Path(root), tables, self.descriptor or self.dataset.descriptor, media=self.dataset.media)
        if self.edit is not None:
            self.edit(Path(root))
        return Path(root)

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        """Show what is wrong first; Hypothesis asks for it."""
        shown = {name: getattr(self, name) for name in ("rule", "at", "what", "dataset")}
        show_call(printer, "Defect", shown)


@st.composite
def defects(draw: DrawFn, dataset: SearchStrategy[SmallDataset] | None = None, *, rule: str = "") -> Defect:
    """Datasets with one defect; other rules may fail as well where they follow from it.

    Args:
        draw: Given by Hypothesis.
        dataset: Datasets to spoil; `datasets` by default.
        rule: Id of the rule that must fail, or the beginning of ids; any by default.
    """
    makes = [make for name, make in _MAKES.items() if name.startswith(rule)]
    valid = draw(datasets() if dataset is None else dataset)
    made = [draw(st.sampled_from(makes)), *makes] if makes else []
    for make in made:  # the first that the dataset has a place for
        defect = make(draw, valid)
        if defect is not None:
            return defect
    raise ValueError(f"no defect of {rule!r} fits into {valid!r}")


_MAKES: dict[str, Make] = {}


def _makes(rule: str) -> Callable[[Make], Make]:
    """Register a function as the one that makes defects of a rule, or none where a dataset has no place for one."""

    def register(make: Make) -> Make:
        _MAKES[rule] = make
        return make

    return register


# --- places


def _columns(dataset: SmallDataset) -> Iterator[tuple[str, Column]]:
    """Columns of the tables that a dataset holds."""
    for name in next(iter(dataset.tables.values())):
        yield from ((name, column) for column in TABLES[name].columns)


def _cell(draw: DrawFn, dataset: SmallDataset, name: str, column: str) -> tuple[str, pa.Table, int] | None:
    """A folder with its table and a row in which a column has a value; ``None`` where no row has one."""
    folder = draw(st.sampled_from(sorted(dataset.tables)))
    table = dataset.tables[folder][name]
    rows = [row for row, value in enumerate(table[column].to_pylist()) if value is not None]
    return (folder, table, draw(st.sampled_from(rows))) if rows else None


def _place(name: str, table: pa.Table, row: int, column: str) -> dict[str, Any]:
    """Location of a cell."""
    whole = {"table": name, "column": column}
    key = {"rollout_id", "tick", "actor_id"} & set(TABLES[name].key) if column not in TABLES[name].key else set()
    return {**whole, **{part: table[part][row].as_py() for part in sorted(key)}}


def _in_words(table: str, column: str, row: int, value: Any, old: Any) -> str:
    return f"{table}.{column} is {value!r} instead of {old!r} in row {row}"


def _changed(
    dataset: SmallDataset, rule: str, name: str, column: str, value: Any, folder: str, table: pa.Table, row: int
) -> Defect:
    """The defect of one cell with another value."""
    what = _in_words(name, column, row, value, table[column][row].as_py())
    tables = {folder: {name: with_cells(table, column, {row: value})}}
    return Defect(rule, _place(name, table, row, column), what, dataset, tables)


# --- values


def _is_extent(column: Column) -> bool:
    return column.unit == "m" and column.min is None and column.name.endswith(("length_m", "width_m", "height_m"))


def _not_finite(draw: DrawFn, dataset: SmallDataset, rule: str, *, of_boxes: bool) -> Defect | None:
    choices = [
        (name, column)
        for name, column in _columns(dataset)
        if column.type in ("float32", "float64") and _is_extent(column) == of_boxes
    ]
    name, column = draw(st.sampled_from(choices))
    cell = _cell(draw, dataset, name, column.name)
    value = draw(st.sampled_from([math.nan, math.inf, -math.inf]))
    return cell and _changed(dataset, rule, name, column.name, value, *cell)


@_makes("BD-VAL-001")
def _value_not_finite(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    return _not_finite(draw, dataset, "BD-VAL-001", of_boxes=False)


@_makes("BD-BOX-001")
def _box_not_finite(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    return _not_finite(draw, dataset, "BD-BOX-001", of_boxes=True)


@_makes("BD-VAL-002")
def _out_of_range(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    choices = [
        (name, column)
        for name, column in _columns(dataset)
        if column.type in ("int32", "float32", "float64") and column.min is not None and column.name != "ttc_s"
    ]
    name, column = draw(st.sampled_from(choices))
    cell = _cell(draw, dataset, name, column.name)
    below = (column.min or 0) - draw(st.integers(1, 1000))
    return cell and _changed(
        dataset, "BD-VAL-002", name, column.name, below if "int" in column.type else float(below), *cell
    )


@_makes("BD-VAL-003")
def _unknown_word(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    name, column = draw(st.sampled_from([(name, column) for name, column in _columns(dataset) if column.values]))
    cell = _cell(draw, dataset, name, column.name)
    return cell and _changed(dataset, "BD-VAL-003", name, column.name, "unheard-of", *cell)


@_makes("BD-NUL-001")
def _null(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    choices = [
        (name, column)
        for name, column in _columns(dataset)
        if column.available is None and column.name not in TABLES[name].key and column.name != "rollout_id"
    ]
    name, column = draw(st.sampled_from(choices))
    cell = _cell(draw, dataset, name, column.name)
    return cell and _changed(dataset, "BD-NUL-001", name, column.name, None, *cell)


# --- rows


@_makes("BD-KEY-007")
def _row_missing(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    name = draw(st.sampled_from(["controls", "observations"]))
    cell = _cell(draw, dataset, name, "tick")
    if cell is None:
        return None
    folder, table, row = cell
    rollout_id, tick = (table[column][row].as_py() for column in ("rollout_id", "tick"))
    tables = {folder: {name: without_row(table, row)}}
    return Defect("BD-KEY-007", {"rollout_id": rollout_id}, f"{name} has no tick {tick} any more", dataset, tables)


@_makes("BD-KEY-004")
def _rows_of_nobody(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    cell = _cell(draw, dataset, "rollouts", "rollout_id")
    if cell is None:
        return None
    folder, table, row = cell
    rollout_id = table["rollout_id"][row].as_py()
    tables = {folder: {"rollouts": without_row(table, row)}}
    return Defect("BD-KEY-004", {"rollout_id": rollout_id}, "its rollout is not recorded", dataset, tables)


# --- driving


@_makes("BD-CTL-009")
def _another_command(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    column = f"applied_{draw(st.sampled_from(['throttle', 'brake']))}"
    folder = draw(st.sampled_from(sorted(dataset.tables)))
    table = dataset.tables[folder]["controls"]
    row = draw(st.sampled_from([i for i, active in enumerate(table["active"].to_pylist()) if not active]))
    old = table[column][row].as_py()
    value = old + (0.5 if old < 0.5 else -0.5)
    at = {"table": "controls", **{name: table[name][row].as_py() for name in ("rollout_id", "tick")}}
    what = _in_words("controls", column, row, value, old)
    tables = {folder: {"controls": with_cells(table, column, {row: value})}}
    return Defect("BD-CTL-009", at, what, dataset, tables)


@_makes("BD-MOT-001")
def _jump(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    cell = _cell(draw, dataset, "observations", "x_m")
    if cell is None:
        return None
    folder, table, row = cell
    old = table["x_m"][row].as_py()
    defect = _changed(dataset, "BD-MOT-001", "observations", "x_m", old + 50.0, folder, table, row)
    # The way to the place and the way from it are both too long; at tick 0 there is only one.
    at = {name: defect.at[name] for name in ("table", "rollout_id")}
    return Defect(defect.rule, at, defect.what, dataset, defect.tables)


@_makes("BD-EVD-001")
def _another_separation(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    if "actor_risk_evidence" not in dataset.streams:
        return None
    cell = _cell(draw, dataset, "evidence", "separation_m")
    if cell is None:
        return None
    folder, table, row = cell
    old = table["separation_m"][row].as_py()
    return _changed(dataset, "BD-EVD-001", "evidence", "separation_m", old + _BEYOND_M, folder, table, row)


@_makes("BD-GRP-003")
def _another_seed(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    folder = draw(st.sampled_from(sorted(dataset.tables)))
    table = dataset.tables[folder]["rollouts"]
    interventions = [i for i, role in enumerate(table["role"].to_pylist()) if role == "intervention"]
    row = draw(st.sampled_from(interventions))
    what = _in_words("rollouts", "seed", row, 1, table["seed"][row].as_py())
    at = {"group_id": table["group_id"][row].as_py()}
    return Defect("BD-GRP-003", at, what, dataset, {folder: {"rollouts": with_cells(table, "seed", {row: 1})}})


# --- tables, documents and files


@_makes("BD-TAB-002")
def _column_missing(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    folder = draw(st.sampled_from(sorted(dataset.tables)))
    name, column = draw(st.sampled_from([*_columns(dataset)]))
    table = dataset.tables[folder][name].drop_columns(column.name)
    at = {"file": f"{folder}/{TABLES[name].file_name}", "column": column.name}
    return Defect("BD-TAB-002", at, f"{name} has no column {column.name}", dataset, {folder: {name: table}})


@_makes("BD-DOC-003")
def _property_missing(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    missing = draw(st.sampled_from(["title", "licence", "simulator", "collector", "action_bank"]))
    document = {name: value for name, value in dataset.descriptor.items() if name != missing}
    what = f"the descriptor has no {missing!r}"
    return Defect("BD-DOC-003", {"file": DESCRIPTOR_FILE}, what, dataset, descriptor=document)


@_makes("BD-LAY-002")
def _bit_flipped(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    path = draw(st.sampled_from(_files(dataset)))

    def flip(root: Path) -> None:
        content = bytearray((root / path).read_bytes())
        content[len(content) // 2] ^= 1
        (root / path).write_bytes(content)

    return Defect("BD-LAY-002", {"file": path}, "one bit flipped behind the manifest", dataset, edit=flip)


@_makes("BD-LAY-003")
def _file_missing(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    path = draw(st.sampled_from(_files(dataset)))
    what = "a file removed behind the manifest"
    return Defect("BD-LAY-003", {"file": path}, what, dataset, edit=lambda root: (root / path).unlink())


@_makes("BD-LAY-004")
def _file_unlisted(draw: DrawFn, dataset: SmallDataset) -> Defect | None:
    path = f"{draw(st.sampled_from(sorted(dataset.tables)))}/notes.txt"
    what = "a file that the manifest does not list"
    return Defect("BD-LAY-004", {"file": path}, what, dataset, edit=lambda root: (root / path).write_text("x"))


def _files(dataset: SmallDataset) -> list[str]:
    """Table files of a dataset."""
    return [f"{folder}/{TABLES[name].file_name}" for folder, shard in dataset.tables.items() for name in shard]


def with_column(table: pa.Table, column: str, values: Any) -> pa.Table:
    """A table with one column replaced, which may hold nulls if the new values do."""
    index = table.schema.get_field_index(column)
    field = table.schema.field(index)
    array = values if isinstance(values, pa.Array) else pa.array(values, field.type)
    return table.set_column(index, field.with_nullable(field.nullable or array.null_count > 0), array)


def with_cells(table: pa.Table, column: str, cells: Mapping[int, Any]) -> pa.Table:
    """A table with some cells of one column, by row, replaced."""
    values = table[column].to_pylist()
    for row, value in cells.items():
        values[row] = value
    return with_column(table, column, values)


def without_row(table: pa.Table, row: int) -> pa.Table:
    """A table without one row."""
    return pa.concat_tables([table[:row], table[row + 1 :]]).combine_chunks()
