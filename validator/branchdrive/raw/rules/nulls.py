"""Null rules: a value is absent exactly where its availability says so. Source: spec/06-masks.md."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import Availability, Column, declared_table
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.mismatch import Check
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.driving.risk import MIN_CLOSING_MPS, RANGE_M
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import Tables, TableView

IMPOSSIBLE_TTC_S = RANGE_M / MIN_CLOSING_MPS
"""500 s, all the range at the slowest closing speed: no time to collision can lie beyond."""

Mask = NDArray[np.bool_]

NONE = np.zeros(0, np.intp)
"""No row."""


class DescribedTables(Tables, Protocol):
    """Tables of a dataset whose descriptor is known."""

    @property
    def descriptor(self) -> Descriptor:
        """What the dataset says of itself."""


def _nullable(view: Tables, accept: Callable[[Availability], bool]) -> Iterator[tuple[TableView, Column, Availability]]:
    for name in view.table_names:
        for column in declared_table(name).columns:
            if column.available is not None and accept(column.available):
                yield view[name], column, column.available


def _presence(table: TableView, column: Column, expected: Mask, because: Callable[[int], str]) -> Check:
    present = table.valid(column.name)

    def describe(row: int) -> tuple[str, str]:
        demand = "a value" if expected[row] else "null"
        found = quote(table[column.name][row]) if present[row] else "null"
        return f"{demand} ({because(row)})", found

    return Check.of_rows(table.name, column.name, len(table), np.flatnonzero(present != expected), describe)


def _switch(name: str, is_on: Mask) -> Callable[[int], str]:
    return lambda row: f"{name} is {'on' if is_on[row] else 'off'}"


def _stated(table: TableView, name: str) -> Callable[[int], str]:
    """What a column holds."""
    return lambda row: f"`{name}` is {quote(table[name][row]) if table.valid(name)[row] else 'null'}"


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
        is_on = table[str(available.mask)].astype(bool)
        yield _presence(table, column, is_on, _switch(f"`{available.mask}`", is_on))


@rule("BD-NUL-003")
def policy_columns_follow_active(view: ShardView) -> Iterator[Check]:
    """Intended and stored nominal commands are there exactly at active ticks."""
    for table, column, _ in _nullable(view, lambda a: a.when == "active"):
        is_on = table["active"].astype(bool)
        yield _presence(table, column, is_on, _switch("`active`", is_on))


@rule("BD-NUL-004")
def rollout_columns_follow_conditions(view: ShardView) -> Iterator[Check]:
    """Conditional columns of an attempt are there exactly where their condition holds."""
    table = view.rollouts
    conditions = {
        "branched": (view.branched, "branch_tick"),
        "not_complete": (~view.complete, "status"),
        "not_nominal": (~view.role("nominal"), "role"),
    }
    for _, column, available in _nullable(view, lambda a: a.when in conditions):
        is_on, name = conditions[str(available.when)]
        yield _presence(table, column, is_on, _stated(table, name))
    for _, column, available in _nullable(view, lambda a: a.when == "valued"):
        name = str(available.rule)
        carries = table.equals(name, "absolute") | table.equals(name, "floor")
        yield _presence(table, column, carries, _stated(table, name))


@rule("BD-NUL-006")
def unrecorded_columns_are_null(view: DescribedTables) -> Iterator[Check]:
    """A column that a world may lack is null throughout where the descriptor lists it, and nowhere else."""
    for table, column, _ in _nullable(view, lambda a: a.when == "recorded"):
        is_recorded = column.is_recorded(view.descriptor.unrecorded)
        bad = NONE
        if table.num_nulls(column.name) != (0 if is_recorded else len(table)):
            bad = np.flatnonzero(table.valid(column.name) != is_recorded)
        yield Check.of_rows(table.name, column.name, len(table), bad, _recorded_text(table, column, is_recorded))


def _recorded_text(table: TableView, column: Column, is_recorded: bool) -> Callable[[int], tuple[str, str]]:
    if is_recorded:
        return lambda _: ("a value (the descriptor does not list the column as `unrecorded`)", "null")
    expected = "null (the descriptor lists the column as `unrecorded`)"
    return lambda row: (expected, quote(table[column.name][row]))


@rule("BD-NUL-005")
def absent_ttc_is_null(view: ShardView) -> Iterator[Check]:
    """No time to collision above what range and closing cut-off allow: such values are sentinels."""
    if "evidence" in view:
        table = view["evidence"]
        ttc = table["ttc_s"]
        there = table.valid("ttc_s")
        bad = np.flatnonzero(there & np.isfinite(ttc) & (ttc > IMPOSSIBLE_TTC_S))
        yield Check.of_rows(
            "evidence", "ttc_s", int(there.sum()), bad, lambda row: ("null, or at most 500 s", quote(ttc[row]))
        )
