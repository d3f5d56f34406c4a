"""Hypothesis strategies for conforming rows, derived from the declared columns."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st
from tests.validator.writer.invented import branch_fields, identity_fields, result_fields

from branchdrive.contract.columns import TABLES, Column
from branchdrive.testing.strategies import column_values

Row = dict[str, Any]

MAX_TTC_S = 499.0
"""Times to collision from 500 s on are taken for sentinels by a rule, not by the column's range."""


def values(column: Column) -> st.SearchStrategy[Any]:
    """Values that a declared column may hold where it is available."""
    if column.name == "ttc_s":
        return st.floats(0, MAX_TTC_S)
    return column_values(column)


@st.composite
def rows(draw: st.DrawFn, table: str, fixed: list[Row]) -> list[Row]:
    """Rows of a stream table: the values in `fixed`, and drawn ones for the other columns."""
    result = []
    for known in fixed:
        row = dict(known)
        for column in TABLES[table].columns:
            if column.name in row or column.name == "rollout_id":
                continue
            available = column.available
            if column.is_required(()) or (available.when == "active" and row["active"]):
                row[column.name] = draw(values(column))
            elif available.mask is not None:
                row[column.name] = draw(values(column)) if row[available.mask] else None
            elif available.when == "optional":
                row[column.name] = draw(st.none() | values(column))
            else:
                row[column.name] = None
        result.append(row)
    return result


@st.composite
def streams(draw: st.DrawFn) -> dict[str, list[Row]]:
    """Rows of every stream of one rollout."""
    ticks = sorted(draw(st.sets(st.integers(0, 1_000_000), max_size=3)))
    observed = sorted(draw(st.sets(st.integers(0, 1_000_000), max_size=3)))
    boxes = (
        sorted(draw(st.sets(st.tuples(st.sampled_from(observed), st.integers(0, 9)), max_size=3))) if observed else []
    )
    return {
        "controls": draw(rows("controls", [{"tick": tick} for tick in ticks])),
        "observations": draw(rows("observations", [{"tick": tick} for tick in observed])),
        "actors": draw(rows("actors", [{"tick": tick, "actor_id": actor_id} for tick, actor_id in boxes])),
        "evidence": draw(rows("evidence", [{"tick": tick} for tick in observed])),
    }


@st.composite
def rollout_fields(draw: st.DrawFn, role: str, action_key: str, nominal_id: str) -> tuple[Row, Row]:
    """Fields for `begin_rollout` and `finish`, null and not null wherever that is allowed."""
    columns = {column.name: column for column in TABLES["rollouts"].columns}
    begin = identity_fields(role, action_key, nominal_id)
    for name in ("scenario_type", "town", "environment", "seed", "repetition", "ego_length_m", "provenance"):
        begin[name] = draw(values(columns[name]))
    finish = result_fields()
    finish["status"] = draw(st.sampled_from(["complete", "partial", "quarantined"]))
    finish["status_reason"] = None if finish["status"] == "complete" else draw(values(columns["status_reason"]))
    if draw(st.booleans()):
        finish |= branch_fields(nominal_id, branch_tick=draw(st.integers(0, 1000)) * 5)
        finish["trigger_value"] = draw(values(columns["trigger_value"]))
    for name, column in columns.items():
        if column.available is not None and column.available.when == "optional":
            finish[name] = draw(st.none() | values(column))
    return begin, finish
