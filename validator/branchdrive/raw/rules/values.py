"""Value rules: finite, in range, in vocabulary, in pattern. Source: spec/05-raw-streams.md#values.

Null rules: a value is absent exactly where its availability says so. Source: spec/06-masks.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import PATTERNS, Availability, Column, declared_table
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Check
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.driving.risk import MIN_CLOSING_MPS, RANGE_M
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import Tables, TableView

__all__ = []

MAX_EXTENT_M = 100.0

NONE = np.zeros(0, np.intp)
"""No row."""


def _columns(view: Tables, wanted: Callable[[Column], bool]) -> Iterator[tuple[TableView, Column]]:
    for name in view.table_names:
        for column in declared_table(name).columns:
            if wanted(column):
                yield view[name], column


def _is_extent(column: Column) -> bool:
    return column.name.endswith(("length_m", "width_m", "height_m"))


def _numbers(table: TableView, column: Column) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Numbers of a column and, for list columns, the row of each."""
    if not column.type.startswith("list"):
        return table[column.name], None
    items, lengths = table.items(column.name)
    return items, np.repeat(np.arange(len(table)), lengths)


def _rows(bad: NDArray[np.bool_], owner: NDArray[np.int64] | None) -> NDArray[np.intp]:
    places = np.flatnonzero(bad)
    return places if owner is None else np.unique(owner[places])


def _describe(expected: str, table: TableView, column: Column) -> Callable[[int], tuple[str, str]]:
    return lambda row: (expected, quote(table[column.name][row]))


@rule("BD-VAL-001")
def values_are_finite(view: Tables) -> Iterator[Check]:
    """No NaN and no infinity in any floating-point column."""
    for table, column in _columns(view, lambda c: "float" in c.type and not _is_extent(c)):
        bad = NONE
        if not np.isfinite(table.extremes(column.name)).all():
            numbers, owner = _numbers(table, column)
            bad = _rows(~np.isfinite(numbers), owner)
        yield Check.of_rows(table.name, column.name, len(table), bad, _describe("a finite number", table, column))


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
            table.name, column.name, len(table), bad, _describe(f"{low:g} .. {high:g}{unit}", table, column)
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
            table.name, column.name, len(table), bad, _describe(f"one of {list(column.values)}", table, column)
        )


@cache
def _pattern(name: str) -> re.Pattern[str]:
    return re.compile(PATTERNS[name].removeprefix("^").removesuffix("$"))


@rule("BD-VAL-004")
def text_matches_pattern(view: Tables) -> Iterator[Check]:
    """Every text of a patterned column matches it from start to end."""
    for table, column in _columns(view, lambda c: c.pattern is not None):
        pattern = _pattern(str(column.pattern))
        bad = _rejected_rows(table, column, lambda category, p=pattern: p.fullmatch(category) is not None)  # type: ignore[misc]
        expected = f"text like {PATTERNS[str(column.pattern)]}"
        yield Check.of_rows(table.name, column.name, len(table), bad, _describe(expected, table, column))


@rule("BD-VAL-005")
def routes_are_polylines(view: ShardView) -> Iterator[Check]:
    """Route x and y have the same length, two to `max_route_vertices` vertices, and no vertex twice in a row."""
    xs, ys = view.rollouts["route_x_m"], view.rollouts["route_y_m"]
    limit = spec_limits().max_route_vertices

    @cache  # attempts of a group share their route
    def broken(x_bytes: bytes, y_bytes: bytes) -> bool:
        x, y = np.frombuffer(x_bytes), np.frombuffer(y_bytes)
        return len(x) != len(y) or not 2 <= len(x) <= limit or bool(((np.diff(x) == 0) & (np.diff(y) == 0)).any())

    bad = np.flatnonzero([broken(x.tobytes(), y.tobytes()) for x, y in zip(xs, ys, strict=True)])
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


@rule("BD-BOX-001")
def boxes_are_positive(view: ShardView) -> Iterator[Check]:
    """Box extents are finite, above 0 and at most 100 m."""
    for table, column in _columns(view, _is_extent):
        least, most = table.extremes(column.name)
        bad = NONE
        if table.num_nulls(column.name) or not (least > 0 and most <= MAX_EXTENT_M):
            extent = table[column.name]
            bad = np.flatnonzero(~((extent > 0) & (extent <= MAX_EXTENT_M)))
        yield Check.of_rows(
            table.name, column.name, len(table), bad, _describe("above 0 and at most 100 m", table, column)
        )


IMPOSSIBLE_TTC_S = RANGE_M / MIN_CLOSING_MPS
"""500 s, all the range at the slowest closing speed: no time to collision can lie beyond."""

Mask = NDArray[np.bool_]

"""No row."""


def _nullable(view: Tables, accept: Callable[[Availability], bool]) -> Iterator[tuple[TableView, Column, Availability]]:
    for name in view.table_names:
        for column in declared_table(name).columns:
            if column.available is not None and accept(column.available):
                yield view[name], column, column.available


def _presence(table: TableView, column: Column, expected: Mask, because: str) -> Check:
    present = table.valid(column.name)

    def describe(row: int) -> tuple[str, str]:
        demand = "a value" if expected[row] else "null"
        found = quote(table[column.name][row]) if present[row] else "null"
        return f"{demand} ({because} is {'on' if expected[row] else 'off'})", found

    return Check.of_rows(table.name, column.name, len(table), np.flatnonzero(present != expected), describe)


@rule("BD-NUL-001")
def required_columns_hold_no_null(view: Tables) -> Iterator[Check]:
    """A column without availability has a value in every row."""
    for name in view.table_names:
        table = view[name]
        for column in declared_table(name).columns:
            if not column.nullable:
                bad = np.flatnonzero(~table.valid(column.name)) if table.num_nulls(column.name) else NONE
                yield Check.of_rows(name, column.name, len(table), bad, lambda _: ("a value", "null"))


@rule("BD-NUL-002")
def masks_agree_with_values(view: Tables) -> Iterator[Check]:
    """A masked column is null exactly where its mask is off."""
    for table, column, available in _nullable(view, lambda a: a.mask is not None):
        yield _presence(table, column, table[str(available.mask)].astype(bool), f"`{available.mask}`")


@rule("BD-NUL-003")
def policy_columns_follow_active(view: ShardView) -> Iterator[Check]:
    """Intended and stored nominal commands are there exactly at active ticks."""
    for table, column, _ in _nullable(view, lambda a: a.when == "active"):
        yield _presence(table, column, table["active"].astype(bool), "`active`")


@rule("BD-NUL-004")
def rollout_columns_follow_conditions(view: ShardView) -> Iterator[Check]:
    """Conditional columns of an attempt are there exactly where their condition holds."""
    table = view.rollouts
    conditions = {
        "branched": view.branched,
        "not_complete": ~view.complete,
        "not_nominal": ~view.role("nominal"),
    }
    for _, column, available in _nullable(view, lambda a: a.when in conditions):
        yield _presence(table, column, conditions[str(available.when)], f"condition `{available.when}`")
    for _, column, available in _nullable(view, lambda a: a.when == "valued"):
        carries = table.equals(str(available.rule), "absolute") | table.equals(str(available.rule), "floor")
        yield _presence(table, column, carries, f"a valued `{available.rule}`")


@rule("BD-NUL-005")
def absent_ttc_is_null(view: ShardView) -> Iterator[Check]:
    """No time to collision above what range and closing cut-off allow: such values are sentinels."""
    if "evidence" in view:
        table = view["evidence"]
        ttc = table["ttc_s"]
        bad = np.flatnonzero(table.valid("ttc_s") & np.isfinite(ttc) & (ttc > IMPOSSIBLE_TTC_S))
        yield Check.of_rows(
            "evidence", "ttc_s", len(table), bad, lambda row: ("null, or at most 500 s", quote(ttc[row]))
        )
