"""Columnar views of tables: typed columns, categories of text, and streams in order of attempt and tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import declared_table
from branchdrive.contract.mismatch import Stretch
from branchdrive.tables.arrow import filled, present
from branchdrive.tables.join import find_sorted

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["RowSummary", "StreamView", "TableView", "Tables"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

V = TypeVar("V", bound=np.generic)

_TICK_SPAN = 1 << 32

_CACHED_ROWS = 1 << 15
"""Rows of a column that stay in a processor's cache between two passes."""


class Tables(Protocol):
    """Tables under their names: a shard, or the derived layers of a dataset."""

    @property
    def table_names(self) -> tuple[str, ...]:
        """Names of the tables, in declared order."""

    def __getitem__(self, table: str) -> TableView:
        """View of a table."""


class TableView:
    """Typed numpy columns of one table, each in one piece; nulls are filled, and `valid` says where."""

    def __init__(self, name: str, table: pa.Table, order: Index | None = None) -> None:
        self.name = name
        self._table = (table.take(order) if order is not None else table).combine_chunks()
        self._values: dict[str, NDArray[Any]] = {}
        self._valid: dict[str, Mask] = {}
        self._categories: dict[str, tuple[NDArray[np.int32], list[str]]] = {}
        self._extremes: dict[str, tuple[Any, Any]] = {}
        self._cells: dict[str, Index] = {}

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def __contains__(self, column: str) -> bool:
        return column in self._table.column_names

    def __repr__(self) -> str:
        return f"TableView({self.name!r}, rows={len(self)}, columns={self._table.num_columns})"

    def _array(self, column: str) -> pa.Array:
        pieces = self._table[column]
        return pieces.chunk(0) if pieces.num_chunks == 1 else pieces.combine_chunks()

    @property
    def arrow(self) -> pa.Table:
        """The rows as they are seen here."""
        return self._table

    def num_nulls(self, column: str) -> int:
        """Number of rows whose value is null."""
        return int(self._table[column].null_count)

    def valid(self, column: str) -> Mask:
        """Rows whose value is not null, ``[rows]``."""
        if column not in self._valid:
            array = self._array(column)
            found = self._all
            if array.null_count:
                found = present(array)
                # Columns often lack values together: one mask is enough for them.
                found = next((m for m in self._valid.values() if np.array_equal(m, found)), found)
            self._valid[column] = found
        return self._valid[column]

    @cached_property
    def _all(self) -> Mask:
        return np.broadcast_to(np.True_, len(self))

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Values ``[rows]``; null numbers read 0, null flags false, null text ``""``."""
        if column not in self._values:
            self._values[column] = self._load(column)
        return self._values[column]

    def _load(self, column: str) -> NDArray[Any]:
        array = self._array(column)
        kind = declared_table(self.name)[column].type
        if kind == "string":
            codes, categories = self.categories(column)
            lookup = np.array([*categories, ""], dtype=object)
            return np.asarray(lookup[codes])
        if kind.startswith("list"):
            items, lengths = self.items(column)
            cells = np.empty(len(lengths), dtype=object)
            for i, (stop, length) in enumerate(zip(np.cumsum(lengths), lengths, strict=True)):
                cells[i] = items[stop - length : stop]
            return cells
        values = filled(array)
        if array.null_count and values.dtype != bool:
            self._keep(column, array, values)
        return values

    def _keep(self, column: str, array: pa.Array, values: NDArray[Any]) -> None:
        """Let the table have the filled values of a column, of which there need not be two."""
        import pyarrow as pa

        valid = pa.py_buffer(np.packbits(self.valid(column), bitorder="little"))
        same = pa.Array.from_buffers(array.type, len(array), [valid, pa.py_buffer(values)], array.null_count)
        place = self._table.schema.get_field_index(column)
        self._table = self._table.set_column(place, self._table.schema.field(place), same)

    def is_text(self, column: str) -> bool:
        """Whether a column holds text."""
        return declared_table(self.name)[column].type == "string"

    def extremes(self, column: str) -> tuple[Any, Any]:
        """Smallest and largest present value of a column of numbers, list cells by item.

        Both are NaN where any value is, and ``(inf, -inf)`` where there is no value: finite extremes
        within a range prove that every value is finite and within it.
        """
        if column not in self._extremes:
            if declared_table(self.name)[column].type.startswith("list"):
                values = self.items(column)[0]
            else:
                values = self[column][self.valid(column)] if self.num_nulls(column) else self[column]
            pieces = (values[start : start + _CACHED_ROWS] for start in range(0, len(values), _CACHED_ROWS))
            bounds = [(np.minimum.reduce(p), np.maximum.reduce(p)) for p in pieces] or [(np.inf, -np.inf)]
            least, most = zip(*bounds, strict=True)
            self._extremes[column] = np.min(least), np.max(most)  # they keep a NaN, as their parts do
        return self._extremes[column]

    def items(self, column: str) -> tuple[NDArray[Any], Index]:
        """Items of all cells of a list column, one after the other, and the number in each cell ``[rows]``."""
        array = self._array(column)
        lengths = array.value_lengths().fill_null(0).to_numpy(zero_copy_only=False).astype(np.int64)
        return array.flatten().to_numpy(zero_copy_only=False), lengths

    def cells(self, column: str) -> Index:
        """Codes of the cells of a list column, equal where these hold the same bits ``[rows]``."""
        if column not in self._cells:
            known: dict[bytes, int] = {}
            codes = [known.setdefault(cell.tobytes(), len(known)) for cell in self[column]]
            self._cells[column] = np.array(codes, np.int64)
        return self._cells[column]

    def categories(self, column: str) -> tuple[NDArray[np.int32], list[str]]:
        """Codes ``[rows]`` into the distinct categories of a text column; -1 where null."""
        if column not in self._categories:
            self._categories[column] = self._encode(column)
        return self._categories[column]

    def _encode(self, column: str) -> tuple[NDArray[np.int32], list[str]]:
        import pyarrow as pa

        array = self._array(column)
        if not pa.types.is_dictionary(array.type):
            array = array.dictionary_encode()
        codes = array.indices.cast(pa.int32())
        if codes.null_count:
            codes = codes.fill_null(-1)
        return codes.to_numpy(zero_copy_only=False), array.dictionary.to_pylist()

    def differs(self, column: str, rows: Index, others: Index) -> Mask:
        """Where `rows` hold other bits than `others`, or are null where those are not; of no list column.

        0 and -0 differ, a NaN and the same NaN do not.
        """
        if self.is_text(column):
            codes, _ = self.categories(column)
            return np.asarray(codes[rows] != codes[others])
        bits = self[column].view(np.dtype(f"u{self[column].itemsize}"))
        differs: Mask = bits.take(rows, mode="clip") != bits.take(others, mode="clip")  # faster than by index
        if self.num_nulls(column):
            valid = self.valid(column)
            differs |= valid[rows] != valid[others]
        return differs

    def equals(self, column: str, category: str) -> Mask:
        """Rows whose text is `word`."""
        codes, categories = self.categories(column)
        matching = np.array([candidate == category for candidate in categories] + [False])
        return np.asarray(matching[codes])


@dataclass(frozen=True)
class RowSummary:
    """Marked rows of a stream by rollout: which rollouts have any, the first one's row, how many, and their ticks."""

    any: Mask
    first_row: Index
    count: Index
    stretch: Stretch


class StreamView(TableView):
    """A table of rows that belong to rollouts at ticks, sorted by (rollout, tick).

    Rows whose rollout is unknown come first, with ``rollout == -1``. Rows at one (rollout, tick) are a moment; many
    tables have a row at each, that of actors ten, so what is said of moments is kept once for each of them.

    Attributes:
        start: First row of each rollout ``[rollouts]``.
        stop: Row after the last of each rollout ``[rollouts]``.
    """

    def __init__(self, name: str, table: pa.Table, rollout_index: Mapping[str, int], num_rollouts: int) -> None:
        raw = TableView(name, table)
        codes, categories = raw.categories("rollout_id")
        rollout = np.array([rollout_index.get(category, -1) for category in categories] + [-1], np.int64)[codes]
        key = rollout * _TICK_SPAN + raw["tick"]
        order = None
        if len(key) > 1 and (key[1:] < key[:-1]).any():
            order = np.argsort(key, kind="stable")
            rollout, key = rollout[order], key[order]
        super().__init__(name, table, order)
        if order is None:
            self._values, self._categories = raw._values, raw._categories
        self._order = order
        is_new = np.ones(len(key), bool)
        np.not_equal(key[1:], key[:-1], out=is_new[1:])
        self._ends: Index | None = None  # of moments, where not every row is one
        if not is_new.all():
            self._ends = np.append(np.flatnonzero(is_new), len(key))
            rollout, key = rollout[is_new], key[is_new]
        self._rollout, self._key = rollout, key
        self._rows_of: dict[str, NDArray[np.int32]] = {}  # tables have fewer rows
        self.num_rollouts = num_rollouts
        every = np.arange(num_rollouts)
        self.start = self._first_rows(np.searchsorted(rollout, every, side="left"))
        self.stop = self._first_rows(np.searchsorted(rollout, every, side="right"))

    def _first_rows(self, moments: Index) -> Index:
        """First row of moments, of which one more is at the end."""
        return moments if self._ends is None else self._ends[moments]

    @property
    def moments(self) -> Index:
        """First row of each moment ``[moments]``."""
        return np.arange(len(self)) if self._ends is None else self._ends[:-1]

    @property
    def rollout(self) -> Index:
        """Index into the shard's rollouts ``[rows]``, computed at each call where moments have several rows."""
        return self.of_moments(self._rollout)

    @property
    def tick(self) -> Index:
        """Tick ``[rows]``, computed at each call."""
        return self["tick"].astype(np.int64)

    def of_moments(self, values: NDArray[V]) -> NDArray[V]:
        """Values of moments for each of their rows ``[rows]``."""
        return values if len(values) == len(self) else np.repeat(values, self.rows_at_moments)

    @property
    def rows_at_moments(self) -> Index:
        """Number of rows of each moment ``[moments]``."""
        return np.ones(len(self), np.int64) if self._ends is None else np.diff(self._ends)

    @property
    def num_unknown(self) -> int:
        """Number of rows whose rollout is unknown."""
        return int(self._first_rows(np.searchsorted(self._rollout, np.array([0])))[0])

    @property
    def is_as_stored(self) -> bool:
        """Whether rows are in the order of the stored table."""
        return self._order is None

    @cached_property
    def position(self) -> Index:
        """Place of each row in the stored table ``[rows]``."""
        return np.arange(len(self)) if self._order is None else self._order

    def find(self, rollout: Index, tick: Index) -> Index:
        """Row of each (rollout, tick), the first if there are several, -1 if there is none."""
        key = np.asarray(rollout, np.int64) * _TICK_SPAN + tick
        moment = np.where(np.asarray(rollout) >= 0, find_sorted(self._key, key), -1)
        return moment if self._ends is None else np.append(self.moments, -1)[moment]

    def span(self, rollout: Index, tick: Index) -> tuple[Index, Index]:
        """First row of each (rollout, tick), and the row after its last; equal where there is none."""
        key = np.asarray(rollout, np.int64) * _TICK_SPAN + tick
        first, last = (np.searchsorted(self._key, key, side=side) for side in ("left", "right"))
        return self._first_rows(first), self._first_rows(last)

    def rows_of(self, other: StreamView) -> Index:
        """Row here for each row of `other`, as `find` has it, made anew; streams share most of their moments."""
        if other.name not in self._rows_of:
            self._rows_of[other.name] = other.of_moments(self.rows_of_moments(other).astype(np.int32))
        return self._rows_of[other.name].astype(np.int64)

    def rows_of_moments(self, other: StreamView) -> Index:
        """Row here for each moment of `other`, as `find` has it ``[moments of other]``."""
        if np.array_equal(other._key, self._key):
            other._key, other._rollout = self._key, self._rollout  # of which one copy is enough
            return np.where(self._rollout >= 0, self.moments, -1)
        return self.find(other._rollout, other["tick"][other.moments])

    @cached_property
    def repeats(self) -> Mask:
        """Rows that repeat the previous row's rollout and tick."""
        if self._ends is None:
            return np.broadcast_to(np.False_, len(self))
        found = np.ones(len(self), bool)
        found[self.moments] = False
        return found

    @cached_property
    def ascends(self) -> bool:
        """Whether every row surely has a greater key than the one before; unknown where a key takes text."""
        if self._ends is None:
            return True
        further = declared_table(self.name).key[2:]
        if not further or self.is_text(further[0]):
            return False
        part = self[further[0]]
        descends = part[1:] <= part[:-1]
        descends[self.moments[1:] - 1] = False
        return not descends.any()

    def repeats_with(self, part: NDArray[Any]) -> Mask:
        """Rows that repeat another row's rollout, tick and `part`, a further part of the table's key ``[rows]``."""
        repeated = np.zeros(len(self), bool)
        if not (self.repeats[1:] & (part[1:] <= part[:-1])).any():
            return repeated  # parts ascend within every moment
        order = np.lexsort((part, self.tick, self.rollout))
        columns = [values[order] for values in (self.rollout, self.tick, part)]
        same = np.logical_and.reduce([values[1:] == values[:-1] for values in columns])
        repeated[order[1:][same]] = True
        return repeated

    def distinct_ticks(self, rollout: Index, low: Index, high: Index) -> Index:
        """Number of distinct ticks of each rollout in ``low <= tick <= high``."""
        base = np.asarray(rollout, np.int64) * _TICK_SPAN
        left = np.searchsorted(self._key, base + low, side="left")
        return np.asarray(np.searchsorted(self._key, base + high, side="right") - left)

    @property
    def is_there(self) -> Mask:
        """Rollouts that have a row ``[rollouts]``."""
        return np.asarray(self.stop > self.start)

    def with_rows(self, rows: NDArray[np.integer]) -> Mask:
        """Rollouts that have one of some rows, which come in the order of rollouts ``[rollouts]``."""
        return np.asarray(np.searchsorted(rows, self.stop) > np.searchsorted(rows, self.start))

    def by_rollout(self, marked: Mask) -> RowSummary:
        """Summary of marked rows by rollout."""
        rows = np.flatnonzero(marked)
        if not len(rows):
            none = np.zeros(self.num_rollouts, np.int64)
            return RowSummary(none > 0, none - 1, none, Stretch(self.name, none - 1, none - 1, none > 0))
        first, stop = np.searchsorted(rows, self.start), np.searchsorted(rows, self.stop)
        count, first_row = stop - first, rows.take(first, mode="clip")
        is_there, last_row = count > 0, rows.take(stop - 1, mode="clip")
        first_tick, last_tick = (
            np.where(is_there, self.tick[row], Stretch.UNKNOWN).astype(np.int64) for row in (first_row, last_row)
        )
        stretch = Stretch(self.name, first_tick, last_tick, is_there)
        return RowSummary(is_there, np.where(is_there, first_row, -1), count, stretch)
