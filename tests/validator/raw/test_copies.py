"""Copies are rows of nominals to the bit, and what is judged once is judged as it would be twice."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any
from unittest.mock import patch
from weakref import ref

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests import synthetic

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine import shard
from branchdrive.engine.shard import ShardResult, ShardTask
from branchdrive.formats.folder import Folder
from branchdrive.raw import copies
from branchdrive.raw.copies import HISTORIES, Copied, Copies
from branchdrive.raw.shard_view import ShardView

FOLDER = "raw/shard-00001"
MOMENTS = ("observations", "evidence", "actors")


@cache
def descriptor() -> Descriptor:
    document = synthetic.descriptor()
    collection = {**document["collection"], "replay_noise": {"kind": "exact"}}
    return Descriptor.model_validate({**document, "collection": collection})


@cache
def exact_tables() -> synthetic.Tables:
    """One group whose interventions repeat their nominal up to the branch, and whose replays repeat all of it."""
    tables = dict(synthetic.base_tables()[FOLDER])
    attempts = tables["rollouts"].to_pylist()
    for name, offset in HISTORIES.items():
        table, parts = tables[name].combine_chunks(), []
        for attempt in attempts:
            own = table.filter(pc.equal(table["rollout_id"], attempt["rollout_id"]))
            if attempt["role"] != "nominal":
                last = attempt["branch_tick"] + offset if attempt["role"] == "intervention" else np.iinfo(np.int32).max
                nominal = table.filter(pc.equal(table["rollout_id"], attempt["nominal_rollout_id"]))
                repeated = nominal.filter(pc.less_equal(nominal["tick"], last))
                names = pa.array([attempt["rollout_id"]] * len(repeated)).cast(table.schema.field("rollout_id").type)
                own = pa.concat_tables(
                    [repeated.set_column(0, table.schema.field(0), names), own.filter(pc.greater(own["tick"], last))]
                )
            parts.append(own)
        tables[name] = pa.concat_tables(parts).unify_dictionaries().combine_chunks()
    return tables


def judged(tables: synthetic.Tables) -> ShardResult:
    """What becomes of a shard."""
    task = ShardTask(Folder("."), FOLDER, (), descriptor(), frozenset(CATALOGUE), is_hashed=False)
    result = ShardResult(FOLDER)
    shard._judge(task, ShardView(tables, descriptor(), file_prefix=FOLDER), result)
    return result


@contextmanager
def no_copies() -> Iterator[None]:
    """Let every row be judged by itself."""
    nothing = np.zeros(0, np.int64)
    with patch.object(copies, "_copied", lambda *_: Copied(nothing, nothing)):
        yield


def plain(found: Any) -> Any:
    """Values that can be compared, numbers by their bits."""
    if isinstance(found, np.ndarray):
        return found.dtype.str, found.shape, found.tolist() if found.dtype == object else found.tobytes()
    if isinstance(found, dict):
        return {key: plain(value) for key, value in found.items()}
    if isinstance(found, (list, tuple)):
        return [plain(value) for value in found]
    return (
        plain(vars(found))
        if hasattr(found, "__dict__") and type(found).__module__.startswith("branchdrive")
        else (repr(found) if isinstance(found, float) else found)
    )


def changed(table: pa.Table, column: str, row: int, other: int) -> pa.Table:
    """A table with the value of another row, or a little more where both have one."""
    values = table[column].to_pylist()
    same = values[row] == values[other]
    values[row] = values[other]
    if same and isinstance(values[row], float):
        values[row] += 0.25
    field = table.schema.field(column)
    array = pa.array(values, field.type.value_type if pa.types.is_dictionary(field.type) else field.type)
    return table.set_column(table.schema.get_field_index(column), field, array.cast(field.type))


@st.composite
def edits(draw: st.DrawFn) -> synthetic.Tables:
    """The group with a few cells changed, rows left out or repeated, and perhaps its rows in another order."""
    tables = dict(exact_tables())
    for _ in range(draw(st.integers(0, 4))):
        name = draw(st.sampled_from(["rollouts", *HISTORIES]))
        table = tables[name]
        row, other = (draw(st.integers(0, len(table) - 1)) for _ in range(2))
        change = "cell" if name == "rollouts" else draw(st.sampled_from(["cell", "cell", "drop", "repeat"]))
        if change == "cell":
            column = draw(st.sampled_from([c for c in TABLES[name].columns if not c.type.startswith("list")]))
            tables[name] = changed(table, column.name, row, other)
        else:
            kept = np.delete(np.arange(len(table)), row) if change == "drop" else np.append(np.arange(len(table)), row)
            tables[name] = table.take(kept)
    if draw(st.booleans()):
        order = np.random.default_rng(draw(st.integers(0, 9))).permutation(len(tables["actors"]))
        tables["actors"] = tables["actors"].take(order)
    return tables


@settings(max_examples=25, deadline=None)
@given(edits())
def test_copies_change_no_result(tables: synthetic.Tables) -> None:
    found = plain(judged(tables))
    with no_copies():
        assert plain(judged(tables)) == found


def test_exact_attempts_are_copies() -> None:
    view = ShardView(exact_tables(), descriptor())
    found, t_b = view.cached(Copies), view.branch_tick
    for name, offset in HISTORIES.items():
        stream = view.stream(name)
        copied = ~found.rows(name).judged(len(stream))
        before = stream.tick <= t_b[stream.rollout] + offset
        expected = view.role("nominal_replay")[stream.rollout] | (view.role("intervention")[stream.rollout] & before)
        assert np.array_equal(copied, expected)
        if name in MOMENTS:
            assert np.array_equal(found.at_moments(name).row, found.rows(name).row)
    assert len(found.rows("actors").row) > 700


def test_copies_do_not_keep_the_tables_of_a_view() -> None:
    """Otherwise these stay until a cycle is collected, and a worker holds several shards."""
    view = view_of(dict(exact_tables()))
    assert len(view.cached(Copies).at_moments("actors").row)
    gone = ref(view)
    gc.disable()
    try:
        del view
        assert gone() is None
    finally:
        gc.enable()


def test_a_moment_is_a_copy_as_a_whole() -> None:
    tables = dict(exact_tables())
    view = view_of(tables)
    row = int(view.cached(Copies).rows("actors").row[0])
    tables["actors"] = changed(tables["actors"], "length_m", row, row)
    view = view_of(tables)
    moment = view.observations.rows_of(view.stream("actors"))[row]
    for name in MOMENTS:
        at = (
            np.arange(len(view.observations))
            if name == "observations"
            else view.observations.rows_of(view.stream(name))
        )
        assert moment not in at[view.cached(Copies).at_moments(name).row]


def view_of(tables: synthetic.Tables) -> ShardView:
    return ShardView(tables, descriptor())


@pytest.mark.parametrize("column", ["ego_width_m", "town", "branch_tick"])
def test_attempts_of_another_context_have_no_copied_moments(column: str) -> None:
    tables = dict(exact_tables())
    attempts = tables["rollouts"].to_pylist()
    other = next(i for i, attempt in enumerate(attempts) if attempt["role"] == "intervention")
    attempts[other][column] = {
        "ego_width_m": 1.25,
        "town": "Elsewhere",
        "branch_tick": attempts[other]["branch_tick"] + 5,
    }[column]
    tables["rollouts"] = pa.Table.from_pylist(attempts, schema=tables["rollouts"].schema)
    view = view_of(tables)
    for name in MOMENTS:
        assert other not in view.stream(name).rollout[view.cached(Copies).at_moments(name).row]


def test_where_replays_vary_nothing_is_copied() -> None:
    view = ShardView(synthetic.base_tables()[FOLDER], descriptor())
    assert not any(len(view.cached(Copies).at_moments(name).row) for name in MOMENTS)
