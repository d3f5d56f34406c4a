"""A copy of a valid dataset to edit: cells, rows, attempts, documents and files, then written and sealed."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from tests.content_cache import remembered
from tests.synthetic import Tables, evidence_columns, group_name, seal_dataset, to_table, write_dataset

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.columns import TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.testing.drive import Array, route_columns
from branchdrive.testing.group import by_key, collision_counts

FileEdit = Callable[[Path], object]


def _replaced(old: pa.Array, mask: pa.BooleanArray, new: list[Any]) -> pa.Array:
    if not pa.types.is_list(old.type):
        return pc.replace_with_mask(old, mask, pa.array(new, old.type))
    cells, values = old.to_pylist(), iter(new)
    return pa.array(
        [next(values) if hit else cell for cell, hit in zip(cells, mask.to_pylist(), strict=True)], old.type
    )


class Draft:
    """Tables and descriptor of a dataset, free to change; the shared tables behind them stay as they are.

    Rows are named by ``where``: columns with the value, or the list or range of values, that they have.
    An edit that finds no row is an error, so that no case passes by missing its place.
    """

    def __init__(self, tables: Mapping[str, Tables], document: Mapping[str, Any]) -> None:
        self.tables = {folder: dict(shard) for folder, shard in tables.items()}
        self.descriptor: dict[str, Any] = copy.deepcopy(dict(document))
        self.texts: dict[str, str] = {}
        self.documents: dict[str, dict[str, Any]] = {}
        self._unsealed: list[FileEdit] = []
        self._sealed: list[FileEdit] = []
        self.is_sealed = True

    # Rows

    def _matching(self, table: str, where: Mapping[str, Any]) -> Iterator[tuple[str, pa.Table, pa.Array]]:
        count = 0
        for folder, shard in self.tables.items():
            if table not in shard:
                continue
            rows = shard[table]
            mask = pa.array(np.ones(len(rows), bool))
            for column, value in where.items():
                many = isinstance(value, list | tuple | range)
                kind = rows.schema.field(column).type
                wanted = pa.array(list(value) if many else [value], kind)
                mask = pc.and_(mask, pc.is_in(rows[column].combine_chunks(), wanted))
            hits = pc.sum(mask).as_py() or 0
            count += hits
            if hits:
                yield folder, rows, mask
        assert count, f"no row of {table} has {dict(where)}"

    def take(self, table: str, **where: Any) -> pa.Table:
        """The rows that match."""
        return pa.concat_tables([rows.filter(mask) for _, rows, mask in self._matching(table, where)]).combine_chunks()

    def value(self, table: str, column: str, **where: Any) -> Any:
        """The value of the one row that matches."""
        (value,) = self.take(table, **where)[column].to_pylist()
        return value

    def set(self, table: str, columns: str | tuple[str, ...], value: Any, **where: Any) -> None:
        """Give matching cells a value; a callable gets the old value. Any column can become null."""
        for folder, rows, mask in self._matching(table, where):
            for column in (columns,) if isinstance(columns, str) else columns:
                field, old = rows.schema.field(column), rows[column].combine_chunks()
                new = [value(o) if callable(value) else value for o in old.filter(mask).to_pylist()]
                rows = rows.set_column(
                    rows.schema.get_field_index(column), field.with_nullable(True), _replaced(old, mask, new)
                )
            self.tables[folder][table] = rows

    def fill(self, table: str, columns: Mapping[str, Any], **where: Any) -> None:
        """Give each matching row a value of its own: arrays of one value for each, in their order."""
        for column, values in columns.items():
            left = iter(values.tolist())
            self.set(table, column, lambda _, left=left: next(left), **where)

    def swap(self, table: str, first: str, second: str, **where: Any) -> None:
        """Exchange the values of two columns."""
        rows = self.take(table, **where)
        self.fill(table, {first: rows[second].to_numpy(), second: rows[first].to_numpy()}, **where)

    def drop(self, table: str, **where: Any) -> None:
        """Remove matching rows."""
        for folder, rows, mask in self._matching(table, where):
            self.tables[folder][table] = rows.filter(pc.invert(mask))

    def append(self, table: str, rows: pa.Table, *, folder: str) -> None:
        """Add rows to a shard's table, which stays in the order of its keys."""
        here = self.tables[folder][table]
        joined = pa.concat_tables([here, rows.cast(here.schema)]).combine_chunks()
        self.tables[folder][table] = by_key(table, joined) if table in TABLES else joined

    def duplicate(self, table: str, changes: Mapping[str, Any] | None = None, **where: Any) -> None:
        """Add a changed copy of matching rows to the shards that they are in."""
        for folder, rows, mask in list(self._matching(table, where)):
            copies = rows.filter(mask)
            for column, value in (changes or {}).items():
                field = rows.schema.field(column)
                array = pa.array([value] * len(copies), field.type)
                copies = copies.set_column(rows.schema.get_field_index(column), field, array)
            self.append(table, copies, folder=folder)

    def map_table(self, table: str, change: Callable[[pa.Table], pa.Table], *, folder: str) -> None:
        """Replace a shard's table."""
        self.tables[folder][table] = change(self.tables[folder][table])

    # Attempts and groups

    def folder_of(self, rollout_id: str) -> str:
        """Shard of an attempt."""
        return next(folder for folder, _, _ in self._matching("rollouts", {"rollout_id": rollout_id}))

    def streams_of(self, rollout_id: str) -> list[str]:
        """Tables with rows of an attempt, without its record."""
        shard = self.tables[self.folder_of(rollout_id)]
        mine = {name: pc.sum(pc.equal(rows["rollout_id"], rollout_id)).as_py() for name, rows in shard.items()}
        return [name for name, count in mine.items() if count and name != "rollouts"]

    def copy_attempt(self, rollout_id: str, new_id: str, **changes: Any) -> None:
        """Record an attempt once more under another identity."""
        for table in self.streams_of(rollout_id):
            self.duplicate(table, {"rollout_id": new_id}, rollout_id=rollout_id)
        self.duplicate("rollouts", {"rollout_id": new_id, **changes}, rollout_id=rollout_id)

    def drop_attempt(self, rollout_id: str) -> None:
        """Remove an attempt with all its rows."""
        for table in [*self.streams_of(rollout_id), "rollouts"]:
            self.drop(table, rollout_id=rollout_id)

    def recount(self, rollout_id: str) -> None:
        """Record the row counts that the streams now have."""
        for column, table in (("num_ticks", "controls"), ("num_observations", "observations")):
            count = len(self.take(table, rollout_id=rollout_id))
            self.set("rollouts", column, count, rollout_id=rollout_id)

    def drop_observation(self, rollout_id: str, tick: int) -> None:
        """Remove a saved observation with its actors and its evidence."""
        shard = self.tables[self.folder_of(rollout_id)]
        for table in [name for name in ("observations", "evidence", "actors") if name in shard]:
            self.drop(table, rollout_id=rollout_id, tick=tick)
        self.recount(rollout_id)

    def replace_group(self, index: int, tables: Tables) -> None:
        """Put new attempts in the place of a group's."""
        ids = self.take("rollouts", group_id=group_name(index))["rollout_id"].to_pylist()
        folder = self.folder_of(ids[0])
        for table, rows in tables.items():
            if table in self.tables[folder]:
                self.drop(table, rollout_id=ids)
                self.append(table, rows, folder=folder)

    def replace_bank(self, bank: ActionBank, tables: Tables) -> None:
        """Make the dataset one of another bank, with one shard that holds `tables`."""
        self.descriptor["action_bank"] = bank.model_dump(mode="json")
        self.descriptor["action_encoding"] = None
        self.tables = {"raw/shard-00000": dict(tables)}

    def reroute(self, rollout_id: str, line: tuple[Array, Array] | None = None) -> None:
        """Compute the route state of an attempt again from its poses, on another polyline where one is given."""
        record, rows = self.take("rollouts", rollout_id=rollout_id), self.take("observations", rollout_id=rollout_id)
        line = line or tuple(np.array(record[f"route_{axis}_m"][0].as_py()) for axis in "xy")
        columns = route_columns(*(rows[name].to_numpy().astype(float) for name in ("x_m", "y_m", "yaw_rad")), line)
        self.fill("observations", columns, rollout_id=rollout_id)
        for axis, vertices in zip("xy", line, strict=True):
            self.set("rollouts", f"route_{axis}_m", lambda _, v=vertices: v, rollout_id=rollout_id)
        length_m = np.hypot(*(np.diff(axis) for axis in line)).sum()
        fraction = float(columns["route_progress_m"].max() / length_m)
        self.set("rollouts", "result_route_fraction", fraction, rollout_id=rollout_id)

    def refresh_evidence(self, rollout_id: str) -> None:
        """Compute the evidence of an attempt again from its rows as they are now, and count its collisions."""
        record = self.take("rollouts", rollout_id=rollout_id)
        route = tuple(np.array(record[f"route_{axis}_m"][0].as_py()) for axis in "xy")
        observations, actors = (
            {
                name: np.array(column.to_pylist()) if pa.types.is_string(column.type) else column.to_numpy()
                for name, column in zip(rows.column_names, rows.columns, strict=True)
            }
            for rows in (self.take(name, rollout_id=rollout_id) for name in ("observations", "actors"))
        )
        computed = evidence_columns(observations, actors, route)
        folder = self.folder_of(rollout_id)
        self.drop("evidence", rollout_id=rollout_id)
        columns = {**computed, "rollout_id": [rollout_id] * len(observations["tick"])}
        self.append("evidence", to_table("evidence", columns), folder=folder)
        for column, count in collision_counts(computed, actors).items():
            self.set("rollouts", column, count, rollout_id=rollout_id)

    # Files

    def before_seal(self, edit: FileEdit) -> None:
        """Edit the written folder before the manifest is made, which then covers the edit."""
        self._unsealed.append(edit)

    def after_seal(self, edit: FileEdit) -> None:
        """Edit the written folder behind the back of its manifest."""
        self._sealed.append(edit)

    def edit_manifest(self, edit: Callable[[str], str]) -> None:
        """Edit the text of the manifest."""
        self.after_seal(lambda root: (root / MANIFEST_FILE).write_text(edit((root / MANIFEST_FILE).read_text())))

    def write(self, root: Path) -> Path:
        """Write the dataset into the new folder `root`."""
        write_dataset(root, self.tables, self.descriptor, seal=False)
        for path, document in self.documents.items():
            (root / path).write_bytes(remembered(dump_json)(document))
        for path, text in self.texts.items():
            (root / path).write_bytes(text.encode())
        for edit in self._unsealed:
            edit(root)
        if self.is_sealed:
            seal_dataset(root)
        for edit in self._sealed:
            edit(root)
        return root
