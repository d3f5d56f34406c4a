"""Tables, columns and streams, as `schemas/v0.1/columns.json` and `layers.json` declare them.

The only place where a column's type, unit, frame, track, range and availability are read;
Arrow schemas, record schemas, value rules and the spec's tables all derive from here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from branchdrive.contract.resources import load_resource

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "DECISIONS", "LAYER_TABLES", "PATTERNS", "RECORDABLE", "STREAMS", "TABLES", "TICK_TABLES", "Availability", "Column",
    "Stream", "Table", "declared_table", "table_schema", "tables_of",
]  # fmt: skip


@dataclass(frozen=True)
class Availability:
    """When a nullable column holds a value.

    Attributes:
        mask: Boolean column of the same row that is true exactly where the value is present.
        when: Named condition: ``branched``, ``not_complete``, ``not_nominal``, ``valued``,
            ``active``, ``recorded`` or ``optional`` (spec/06-masks.md).
        rule: For ``valued``: the column whose actuator rule carries the value.
        column: For ``recorded``: the column of the raw layer, as ``table.column``, that a descriptor can list.
    """

    mask: str | None = None
    when: str | None = None
    rule: str | None = None
    column: str | None = None


@dataclass(frozen=True)
class Column:
    """One declared column. ``min``/``max`` are inclusive; ``None`` leaves a side open."""

    name: str
    type: str
    description: str
    track: str
    unit: str | None = None
    frame: str | None = None
    shape: tuple[str, ...] = ()
    min: float | None = None
    max: float | None = None
    values: tuple[str, ...] = ()
    pattern: str | None = None
    available: Availability | None = None

    @property
    def nullable(self) -> bool:
        """Whether the column may hold nulls at all."""
        return self.available is not None

    def is_recorded(self, unrecorded: Collection[str]) -> bool:
        """Whether the world offers the column: a descriptor lists those that it does not as `unrecorded`."""
        return self.available is None or self.available.column not in unrecorded

    def is_required(self, unrecorded: Collection[str]) -> bool:
        """Whether every row has a value, given what the descriptor lists as `unrecorded`."""
        when = None if self.available is None else self.available.when
        return self.available is None or (when == "recorded" and self.is_recorded(unrecorded))

    @property
    def metadata(self) -> dict[str, str]:
        """Field metadata that a stored table carries: unit, frame, shape, track, description."""
        shape = f"[{', '.join(self.shape)}]" if self.shape else None
        pairs = {
            "unit": self.unit,
            "frame": self.frame,
            "shape": shape,
            "track": self.track,
            "description": self.description,
        }
        return {key: value for key, value in pairs.items() if value is not None}


@dataclass(frozen=True)
class Table:
    """One declared table: of shards, each of which has it in a file, or of a derived layer.

    Attributes:
        name: Its name.
        title: What it holds, one sentence.
        rate: What has a row.
        key: Columns whose values no two rows share.
        columns: Its columns.
        partitions: Partitions whose rows have files of their own, in the order of the rows; none where it has none.
        optional: Whether its layer may lack it.
    """

    name: str
    title: str
    rate: str
    key: tuple[str, ...]
    columns: tuple[Column, ...]
    partitions: tuple[str, ...] = ()
    optional: bool = False

    def __getitem__(self, name: str) -> Column:
        for column in self.columns:
            if column.name == name:
                return column
        raise KeyError(name)

    @property
    def is_of_rollouts(self) -> bool:
        """Whether every row belongs to a rollout; rows of the map belong to a town."""
        return "rollout_id" in self.key

    @property
    def is_of_groups(self) -> bool:
        """Whether every row belongs to a group, so that the table grows with them."""
        return not {"group_id", "rollout_id"}.isdisjoint(self.key)

    @property
    def file_name(self) -> str:
        """Name of the table's file inside its folder, of a table in one file."""
        return f"{self.name}.parquet"

    @property
    def value_columns(self) -> tuple[Column, ...]:
        """Columns that are neither of the key nor the partition of the row."""
        return tuple(column for column in self.columns if column.name not in self.order)

    @property
    def order(self) -> tuple[str, ...]:
        """Columns by which rows are sorted."""
        return ("partition", *self.key) if self.partitions else self.key


@dataclass(frozen=True)
class Stream:
    """One recorded data stream of the paper's modality table (paper, "Recorded Modalities")."""

    name: str
    title: str
    rate: str
    track: str
    tables: tuple[str, ...]
    required: bool
    cameras: tuple[str, ...] = ()


def _column(table: str, declared: Mapping[str, Any]) -> Column:
    fields = dict(declared)
    available = fields.pop("available", None)
    if available == {"when": "recorded"}:
        available = {**available, "column": f"{table}.{fields['name']}"}
    return Column(
        **{**fields, "shape": tuple(fields.get("shape", ())), "values": tuple(fields.get("values", ()))},
        available=Availability(**available) if available else None,
    )


def tables_of(declared: Mapping[str, Any]) -> Mapping[str, Table]:
    """Tables by name, from their JSON declarations."""
    return MappingProxyType({name: _table(name, table) for name, table in declared.items()})


def _table(name: str, declared: Mapping[str, Any]) -> Table:
    columns = tuple(_column(name, column) for column in declared["columns"])
    divided_by = declared.get("divided_by")
    partitions = next((column.values for column in columns if column.name == divided_by), ())
    key, optional = tuple(declared["key"]), declared.get("optional", False)
    return Table(name, declared["title"], declared["rate"], key, columns, partitions, optional)


def _streams() -> Mapping[str, Stream]:
    declared = load_resource("columns.json")["streams"]
    return MappingProxyType(
        {
            name: Stream(
                name,
                s["title"],
                s["rate"],
                s["track"],
                tuple(s["tables"]),
                s["required"],
                tuple(s.get("cameras", ())),
            )
            for name, s in declared.items()
        }
    )


TABLES: Mapping[str, Table] = tables_of(load_resource("columns.json")["tables"])
"""Every table of a shard by name."""

TICK_TABLES: tuple[str, ...] = tuple(
    table.name for table in TABLES.values() if table.rate.endswith("Hz") and "camera" not in table.key
)
"""Names of the tables that record an attempt tick by tick; the index of its images and its decisions are none."""

LAYER_TABLES: Mapping[str, Table] = tables_of(
    {
        name: table
        for layer in load_resource("layers.json")["layers"].values()
        for name, table in layer["tables"].items()
    }
)
"""Every table of a derived layer by name; no name is a shard's table's too."""

STREAMS: Mapping[str, Stream] = _streams()
"""Every stream that a descriptor can claim, by name."""

DECISIONS = "decisions"
"""The stream of a dataset of drives, which are in no branch group (spec/04-policies.md#drives), and its table."""

RECORDABLE: tuple[str, ...] = tuple(
    f"{table.name}.{column.name}"
    for table in TABLES.values()
    for column in table.columns
    if column.available is not None and column.available.when == "recorded"
)
"""Columns that a world may be unable to offer, as ``table.column``: those that a descriptor can list."""

PATTERNS: Mapping[str, str] = MappingProxyType(
    {**load_resource("columns.json")["patterns"], **load_resource("layers.json")["patterns"]}
)
"""Regular expressions that text columns name."""


def declared_table(name: str) -> Table:
    """Declaration of a table of a shard or of a derived layer.

    Raises:
        KeyError: No such table.
    """
    return TABLES[name] if name in TABLES else LAYER_TABLES[name]


@cache
def table_schema(name: str) -> pa.Schema:
    """Arrow schema of a table, with unit, frame, shape, track and description as field metadata.

    Raises:
        KeyError: No such table.
    """
    import pyarrow as pa

    types = {
        "string": pa.string(), "bool": pa.bool_(), "int32": pa.int32(), "int64": pa.int64(),
        "float32": pa.float32(), "float64": pa.float64(), "list<float64>": pa.list_(pa.float64()),
    }  # fmt: skip
    return pa.schema(
        [
            pa.field(column.name, types[column.type], nullable=column.nullable, metadata=column.metadata)
            for column in declared_table(name).columns
        ]
    )
