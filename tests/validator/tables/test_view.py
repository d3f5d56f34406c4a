"""Columnar views: columns, their extremes, the order of streams, and rows that are compared bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from branchdrive.contract.columns import table_schema
from branchdrive.tables.view import StreamView, TableView

NAN = float("nan")


@pytest.mark.parametrize(
    ("column", "values", "differs"),
    [
        ("separation_m", [1.0, 1.0], False),
        ("separation_m", [1.0, np.nextafter(1.0, 2.0)], True),
        ("separation_m", [0.0, -0.0], True),
        ("separation_m", [NAN, NAN], False),
        ("separation_m", [None, 0.0], True),
        ("separation_m", [None, None], False),
        ("collision", [True, False], True),
        ("collision", [True, True], False),
        ("lane_id", ["a", "b"], True),
        ("lane_id", ["a", "a"], False),
        ("lane_id", [None, ""], True),
        ("lane_id", [None, None], False),
    ],
)
def test_rows_differ_where_their_bits_or_nulls_do(column: str, values: list[Any], differs: bool) -> None:
    values = pa.array(values, table_schema("evidence").field(column).type)
    view = TableView("evidence", pa.table({column: values}))
    assert view.differs(column, np.array([0]), np.array([1])).tolist() == [differs]
    assert view.differs(column, np.array([0, 1]), np.array([0, 1])).tolist() == [False, False]


@pytest.mark.parametrize(
    ("values", "least", "most"),
    [
        ([3.0, -1.0, 2.0], -1.0, 3.0),
        ([None, 2.0, 1.0], 1.0, 2.0),
        ([None, None], np.inf, -np.inf),
        ([], np.inf, -np.inf),
        ([*np.arange(100_000.0).tolist(), -5.0], -5.0, 99_999.0),
        ([1.0] * 100_000 + [NAN], NAN, NAN),
        ([NAN] + [1.0] * 100_000, NAN, NAN),
        ([None, NAN], NAN, NAN),
    ],
    ids=["plain", "null", "nulls", "empty", "long", "nan at the end", "nan at the start", "nan and null"],
)
def test_extremes_are_of_what_is_there(values: list[Any], least: float, most: float) -> None:
    view = TableView("evidence", pa.table({"separation_m": pa.array(values, pa.float64())}))
    np.testing.assert_array_equal(view.extremes("separation_m"), (least, most))


def test_columns_of_several_pieces_are_joined() -> None:
    pieces = pa.chunked_array([[1.0, None], [], [3.0]], pa.float64())
    view = TableView("evidence", pa.table({"separation_m": pieces}))
    assert view["separation_m"].tolist() == [1.0, 0.0, 3.0]
    assert view.valid("separation_m").tolist() == [True, False, True]


def test_rows_of_a_stream_know_their_places() -> None:
    stored = pa.table({"rollout_id": ["b", "a", "b"], "tick": pa.array([4, 0, 2], pa.int32())})
    stream = StreamView("controls", stored, {"a": 0, "b": 1}, 2)
    assert stream.position.tolist() == [1, 2, 0]
    assert StreamView("controls", stored.take([1, 2, 0]), {"a": 0, "b": 1}, 2).position.tolist() == [0, 1, 2]


def test_codes_of_texts_without_null_are_where_arrow_has_them() -> None:
    texts = pa.array(["a", "b", "a"]).dictionary_encode()
    codes, categories = TableView("evidence", pa.table({"lane_id": texts})).categories("lane_id")
    assert (codes.tolist(), categories) == ([0, 1, 0], ["a", "b"])
    assert codes.ctypes.data == texts.indices.buffers()[1].address


def actors_of(rows: list[tuple[str, int]]) -> StreamView:
    ids, ticks = zip(*rows, strict=True) if rows else ((), ())
    stored = pa.table({"rollout_id": pa.array(ids, pa.string()), "tick": pa.array(ticks, pa.int32())})
    return StreamView("actors", stored, {"a": 0, "b": 1, "d": 3}, 4)


@pytest.mark.parametrize(
    "rows",
    [
        [("a", 0), ("a", 0), ("a", 5), ("b", 5), ("b", 5), ("b", 5), ("d", 0)],
        [("d", 0), ("b", 5), ("?", 1), ("a", 5), ("b", 5), ("?", 1), ("a", 0), ("a", -3), ("b", 2**31 - 1)],
        [("a", 0), ("a", 5), ("b", 0)],
        [("?", 0), ("?", 0)],
        [],
    ],
    ids=["several at a moment", "in no order, some unknown", "one at a moment", "unknown", "none"],
)
def test_moments_say_of_every_row_what_it_says(rows: list[tuple[str, int]]) -> None:
    stream, place = actors_of(rows), {"a": 0, "b": 1, "d": 3}
    seen = sorted((place.get(name, -1), tick) for name, tick in rows)
    assert [*zip(stream.rollout.tolist(), stream.tick.tolist(), strict=True)] == seen
    assert stream.moments.tolist() == [i for i, row in enumerate(seen) if row not in seen[:i]]
    assert stream.rows_at_moments.tolist() == [seen.count(seen[i]) for i in stream.moments]
    assert stream.of_moments(stream.moments).tolist() == [seen.index(row) for row in seen]
    assert stream.repeats.tolist() == [row in seen[:i] for i, row in enumerate(seen)]
    assert stream.num_unknown == sum(rollout < 0 for rollout, _ in seen)
    assert stream.is_as_stored == (seen == [(place.get(name, -1), tick) for name, tick in rows])
    for rollout in range(4):
        own = [i for i, row in enumerate(seen) if row[0] == rollout]
        assert [*range(stream.start[rollout], stream.stop[rollout])] == own
        ticks = {seen[i][1] for i in own}
        assert stream.distinct_ticks(*np.array([[rollout], [0], [5]])).tolist() == [sum(0 <= t <= 5 for t in ticks)]
    for rollout, tick in [*seen, (0, 1), (2, 0), (3, 9)]:
        own = [i for i, row in enumerate(seen) if row == (rollout, tick) and rollout >= 0]
        assert stream.find(np.array([rollout]), np.array([tick])).tolist() == [own[0] if own else -1]
        if rollout >= 0:
            (first,), (last,) = stream.span(np.array([rollout]), np.array([tick]))
            assert [*range(first, last)] == own


@pytest.mark.parametrize("others", [[("a", 0), ("a", 5), ("b", 5)], [("a", 5), ("a", 5), ("?", 5)], []])
def test_rows_are_found_for_rows_of_another_stream(others: list[tuple[str, int]]) -> None:
    other, stream = actors_of(others), actors_of([("?", 5), ("a", 0), ("a", 0), ("a", 5), ("b", 5)])
    other.name = "frames"
    expected = stream.find(other.rollout, other.tick)
    assert stream.rows_of(other).tolist() == expected.tolist()
    assert stream.rows_of_moments(other).tolist() == expected[other.moments].tolist()


@pytest.mark.parametrize("column", ["separation_m", "separation_actor_id", "collision"])
@pytest.mark.parametrize("start", [0, 3, 8])
def test_columns_with_nulls_are_filled_and_stay_in_the_table_as_they_were(column: str, start: int) -> None:
    kind = table_schema("evidence").field(column).type
    values = [None if i % 3 == 0 else (i % 2 == 0 if pa.types.is_boolean(kind) else i) for i in range(20)]
    array = pa.array(values, kind)[start:]
    view = TableView("evidence", pa.table({column: array}))
    assert view[column].tolist() == [0 if value is None else value for value in values[start:]]
    assert view.valid(column).tolist() == [value is not None for value in values[start:]]
    assert view.num_nulls(column) == array.null_count
    assert view.arrow[column].combine_chunks().equals(array)


def test_nulls_hold_no_numbers_that_somebody_left_there() -> None:
    left = pa.Array.from_buffers(pa.int32(), 3, [pa.py_buffer(b"\5"), pa.py_buffer(np.array([1, 7, 3], "<i4"))])
    view = TableView("evidence", pa.table({"separation_actor_id": left}))
    assert view["separation_actor_id"].tolist() == [1, 0, 3]


def test_cells_of_lists_are_told_apart_by_their_bits() -> None:
    cells = [[1.0, 2.0], [1.0], [], [1.0, 2.0], [0.0], [-0.0]]
    view = TableView("rollouts", pa.table({"route_x_m": pa.array(cells, pa.list_(pa.float64()))}))
    codes = view.cells("route_x_m")
    assert (codes[:, None] == codes).sum() == len(cells) + 2
    assert codes[0] == codes[3]


@pytest.mark.parametrize(
    ("ids", "ascends"), [([1, 2, 1], True), ([2, 1, 1], False), ([1, 1, 1], False)], ids=["ascending", "not", "twice"]
)
def test_keys_ascend_where_their_parts_do_in_every_moment(ids: list[int], ascends: bool) -> None:
    table = pa.table({"rollout_id": ["a", "a", "b"], "tick": [0, 0, 0], "actor_id": ids})
    assert StreamView("actors", table, {"a": 0, "b": 1}, 2).ascends is ascends


def test_marked_rows_are_counted_by_rollout() -> None:
    stream = actors_of([("?", 0), ("a", 0), ("a", 0), ("a", 5), ("c", 0)])
    marked = np.array([True, False, True, True, False])
    summary = stream.by_rollout(marked)
    assert (summary.any.tolist(), summary.count.tolist()) == ([True, False, False, False], [2, 0, 0, 0])
    assert summary.first_row.tolist() == [2, -1, -1, -1]
    assert stream.with_rows(np.flatnonzero(marked)).tolist() == [True, False, False, False]
    assert not stream.by_rollout(~marked & marked).any.any()


def test_a_column_with_nulls_is_held_once() -> None:
    view = TableView("evidence", pa.table({"separation_m": pa.array([1.0, None, 3.0])}))
    values = view["separation_m"]
    assert view.arrow["separation_m"].chunk(0).buffers()[1].address == values.ctypes.data
