"""Value rules: finite, in range, in vocabulary, in pattern. Source: spec/05-raw-streams.md#values."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import PATTERNS, Column, declared_table
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.machine_trace import trace_of
from branchdrive.contract.mismatch import Check
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.raw.motion.route_state import distinct_routes
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import Tables, TableView

MAX_EXTENT_M = 100.0

NONE = np.zeros(0, np.intp)
"""No row."""


def _columns(view: Tables, wanted: Callable[[Column], bool]) -> Iterator[tuple[TableView, Column]]:
    for name in view.table_names:
        for column in declared_table(name).columns:
            if wanted(column):
                yield view[name], column


def _is_extent(column: Column) -> bool:
    is_list = column.type.startswith("list")
    return column.name.endswith(("length_m", "width_m", "height_m")) and not is_list


def _numbers(table: TableView, column: Column) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Numbers of a column and, for list columns, the row of each."""
    if not column.type.startswith("list"):
        return table[column.name], None
    items, lengths = table.items(column.name)
    return items, np.repeat(np.arange(len(table)), lengths)


def _num_values(table: TableView, column: Column) -> int:
    """Rows in which a column has a value: those that are compared."""
    return len(table) - table.num_nulls(column.name)


def _rows(bad: NDArray[np.bool_], owner: NDArray[np.int64] | None) -> NDArray[np.intp]:
    places = np.flatnonzero(bad)
    return places if owner is None else np.unique(owner[places])


def _in_unit(value: Any, unit: str | None) -> str:
    """A value in words, with the unit that it seems to have in place of radians."""
    in_degrees = unit == "rad" and isinstance(value, (float, np.floating)) and math.pi < abs(float(value)) <= 360
    return f"{quote(value)}, as what is in degrees" if in_degrees else quote(value)


def _describe(expected: str, table: TableView, column: Column) -> Callable[[int], tuple[str, str]]:
    return lambda row: (expected, _in_unit(table[column.name][row], column.unit))


@rule("BD-VAL-001")
def values_are_finite(view: Tables) -> Iterator[Check]:
    """No NaN and no infinity in any floating-point column."""
    for table, column in _columns(view, lambda c: "float" in c.type and not _is_extent(c)):
        bad = NONE
        if not np.isfinite(table.extremes(column.name)).all():
            numbers, owner = _numbers(table, column)
            bad = _rows(~np.isfinite(numbers), owner)
        yield Check.of_rows(
            table.name, column.name, _num_values(table, column), bad, _describe("a finite number", table, column)
        )


@rule("BD-VAL-002")
def values_lie_in_range(view: Tables) -> Iterator[Check]:
    """``min <= value <= max`` of every present finite number."""
    for table, column in _columns(view, lambda c: c.min is not None or c.max is not None):
        low = -np.inf if column.min is None else column.min
        high = np.inf if column.max is None else column.max
        least, most = table.extremes(column.name)
        bad = NONE
        if not (least >= low and most <= high):
            numbers, owner = _numbers(table, column)
            outside = np.isfinite(numbers) & ((numbers < low) | (numbers > high))
            bad = _rows(outside & table.valid(column.name) if owner is None else outside, owner)
        unit = f" {column.unit}" if column.unit else ""
        yield Check.of_rows(
            table.name,
            column.name,
            _num_values(table, column),
            bad,
            _describe(f"{low:g} .. {high:g}{unit}", table, column),
        )


def _rejected_rows(table: TableView, column: Column, accept: Callable[[str], bool]) -> NDArray[np.intp]:
    codes, categories = table.categories(column.name)
    rejected = np.array([not accept(category) for category in categories] + [False])
    return np.flatnonzero(rejected[codes]) if rejected.any() else NONE


@rule("BD-VAL-003")
def categories_are_declared(view: Tables) -> Iterator[Check]:
    """Every category of an enumerated column is one that the column declares."""
    for table, column in _columns(view, lambda c: bool(c.values)):
        vocabulary = set(column.values)
        bad = _rejected_rows(table, column, vocabulary.__contains__)
        yield Check.of_rows(
            table.name,
            column.name,
            _num_values(table, column),
            bad,
            _describe(f"one of {list(column.values)}", table, column),
        )


@cache
def _pattern(name: str) -> re.Pattern[str]:
    return re.compile(PATTERNS[name].removeprefix("^").removesuffix("$"))


@rule("BD-VAL-004")
def text_matches_pattern(view: Tables) -> Iterator[Check]:
    """Every text of a patterned column matches it from start to end."""

    @cache  # identities come in every stream
    def matches(pattern: str, text: str) -> bool:
        return _pattern(pattern).fullmatch(text) is not None

    for table, column in _columns(view, lambda c: c.pattern is not None):
        bad = _rejected_rows(table, column, partial(matches, str(column.pattern)))
        expected = f"text like {PATTERNS[str(column.pattern)]}"
        yield Check.of_rows(
            table.name, column.name, _num_values(table, column), bad, _describe(expected, table, column)
        )


@rule("BD-VAL-005")
def routes_are_polylines(view: ShardView) -> Iterator[Check]:
    """Route x and y have the same length, two to `max_route_vertices` vertices, and no vertex twice in a row."""
    xs, ys = view.rollouts["route_x_m"], view.rollouts["route_y_m"]
    limit = spec_limits().max_route_vertices

    def broken(x: NDArray[np.float64], y: NDArray[np.float64]) -> bool:
        return len(x) != len(y) or not 2 <= len(x) <= limit or bool(((np.diff(x) == 0) & (np.diff(y) == 0)).any())

    first, which = distinct_routes(view)
    bad = np.flatnonzero(np.array([broken(xs[row], ys[row]) for row in first], bool)[which])
    yield Check.of_rows(
        "rollouts",
        "route_x_m",
        len(xs),
        bad,
        lambda row: (
            f"2 .. {limit} vertices, no two neighbours equal",
            f"{len(xs[row])} x and {len(ys[row])} y values",
        ),
    )


@rule("BD-VAL-007")
def zeros_are_positive(view: Tables) -> Iterator[Check]:
    """No zero of a floating-point column has a sign, which equality ignores."""
    for table, column in _columns(view, lambda c: "float" in c.type):
        bad = NONE
        if not table.extremes(column.name)[0] > 0:
            numbers, owner = _numbers(table, column)
            bits = numbers.view(f"i{numbers.itemsize}")
            least = np.iinfo(bits.dtype).min  # the sign alone
            if np.minimum.reduce(bits, initial=0) == least:
                bad = _rows(bits == least, owner)
        yield Check.of_rows(table.name, column.name, len(table), bad, lambda _: ("0.0", "-0.0"))


@rule("BD-VAL-006")
def texts_name_no_machine(view: ShardView) -> Iterator[Check]:
    """No text holds a path, a host or a time of the machine that wrote it; ids count once, in their own table."""
    yield from texts_hold_no_trace(view, lambda table, column: column != "rollout_id" or table == "rollouts")


def texts_hold_no_trace(view: Tables, is_judged: Callable[[str, str], bool]) -> Iterator[Check]:
    """No text of the columns that `is_judged` picks, by table and name, holds a trace of a machine."""
    for table, column in _columns(view, lambda c: c.type == "string" and not c.values and c.pattern != "checksum"):
        if is_judged(table.name, column.name):
            bad = _rejected_rows(table, column, lambda text: trace_of(text) is None)
            yield Check.of_rows(
                table.name, column.name, len(table), bad, _describe("no path, host or clock time", table, column)
            )


@rule("BD-BOX-001")
def boxes_are_positive(view: ShardView) -> Iterator[Check]:
    """Box extents are finite, above 0 and at most 100 m."""
    for table, column in _columns(view, _is_extent):
        least, most = table.extremes(column.name)
        bad = NONE
        lacks = table.num_nulls(column.name) > 0 and not column.nullable
        if lacks or not (least > 0 and most <= MAX_EXTENT_M):
            extent = table[column.name]
            may_lack = column.nullable & ~table.valid(column.name)
            bad = np.flatnonzero(~((extent > 0) & (extent <= MAX_EXTENT_M) | may_lack))
        yield Check.of_rows(
            table.name, column.name, len(table), bad, _describe("above 0 and at most 100 m", table, column)
        )
