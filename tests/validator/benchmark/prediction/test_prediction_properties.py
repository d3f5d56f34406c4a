"""Predictions of any value survive their tables and files, and one edit of a row is named by its place."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy
from tests.validator.benchmark.samples import rows_of, small_protocol
from tests.validator.benchmark.tiny import CANDIDATES, SIZES, data

from branchdrive.benchmark.prediction.check import prediction_mismatches
from branchdrive.benchmark.prediction.metric.outcome import MAX_MAGNITUDE, Predictions
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES, PredictionRows
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import table_path
from branchdrive.contract.mismatch import Mismatch
from branchdrive.formats.folder import Folder
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import read_table
from branchdrive.tables.arrow import from_arrow, to_arrow
from branchdrive.tables.frame import Frame, sort_rows, take

Frames = dict[str, dict[str, Any]]

KEYS = {"predictions": 4, "predicted_trajectories": 5}
"""How many of the columns of a table are its key."""


@cache
def frames() -> Frames:
    """Tables of a whole prediction of every model and seed of the protocol, each value another; not to be changed."""
    protocol, rng = small_protocol(), np.random.default_rng(1)
    by_model: dict[str, dict[int, dict[str, Predictions]]] = {}
    for model in protocol.models:
        for seed in model.seeds:
            by_model.setdefault(model.id, {})[seed] = {
                name: Predictions.of(
                    rng.normal(size=data().part(name).outcomes.scalars.shape),
                    rng.normal(size=data().part(name).outcomes.paths.shape),
                )
                for name in protocol.predicted
            }
    return PredictionSet(by_model).to_frames(data())


def size_of(table: str) -> int:
    return len(frames()[table]["model"])


def mismatches(broken: Frames) -> list[Mismatch]:
    return list(prediction_mismatches(rows_of(broken, data()), small_protocol()))


def place_of(table: str, row: int) -> dict[str, Any]:
    """Table and key of a row, as mismatches name them."""
    columns = list(frames()[table])[: KEYS[table]]
    values = {name: frames()[table][name][row] for name in columns}
    return {"table": table} | {name: v if isinstance(v, str) else int(v) for name, v in values.items()}


NUMBERS = st.floats(-MAX_MAGNITUDE, MAX_MAGNITUDE, width=64)


@st.composite
def prediction_sets(draw: st.DrawFn) -> PredictionSet:
    """Predictions of up to three models and seeds, of up to all partitions, with every number there is."""
    by_model: dict[str, dict[int, dict[str, Predictions]]] = {}
    names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,5}", fullmatch=True)
    owners = st.tuples(names, st.integers(0, 2**63 - 1))
    for model, seed in draw(st.lists(owners, min_size=1, max_size=3, unique=True)):
        partitions = draw(st.lists(st.sampled_from(sorted(SIZES)), min_size=1, max_size=2, unique=True))
        for name in partitions:
            outcomes = data().part(name).outcomes
            shapes = outcomes.scalars.shape, outcomes.paths.shape
            values = [draw(st_numpy.arrays(np.float64, shape, elements=NUMBERS)) for shape in shapes]
            by_model.setdefault(model, {}).setdefault(seed, {})[name] = Predictions.of(*values)
    return PredictionSet(by_model)


def bits(predictions: PredictionSet) -> dict[tuple[str, int, str], tuple[bytes, bytes]]:
    """Bytes of every array, by model, seed and partition."""
    return {
        (model, seed, name): (one.scalars.tobytes(), one.paths.tobytes())
        for model, seeds in predictions.by_model.items()
        for seed, parts in seeds.items()
        for name, one in parts.items()
    }


@given(prediction_sets(), st.randoms(use_true_random=False))
def test_predictions_come_back_from_tables_bit_for_bit(predictions: PredictionSet, rng: Any) -> None:
    tables = predictions.to_frames(data())
    for name, frame in tables.items():
        order = list(range(len(frame["model"])))
        rng.shuffle(order)
        tables[name] = dict(take(frame, np.array(order, np.int64)))
    found = PredictionSet.of_rows(rows_of(tables, data()))
    assert bits(found) == bits(predictions)
    assert found.digest(data()) == predictions.digest(data())
    files = {name: list(cut(frame, rng)) for name, frame in tables.items()}
    assert bits(PredictionSet.of_rows(PredictionRows(files, data()))) == bits(predictions)


def cut(frame: Frame, rng: Any) -> Iterator[Frame]:
    """Rows of a table in files of any number of rows, none too."""
    ends = sorted(rng.randint(0, len(frame["model"])) for _ in range(3))
    for start, stop in pairwise([0, *ends, len(frame["model"])]):
        yield take(frame, slice(start, stop))


@given(prediction_sets())
def test_predictions_come_back_from_files_bit_for_bit(tmp_path_factory: Any, predictions: PredictionSet) -> None:
    root: Path = tmp_path_factory.mktemp("release")
    (root / "benchmark").mkdir()
    for name, frame in predictions.to_frames(data()).items():
        rows = sort_rows(frame, LAYER_TABLES[name].key, {"action_key": CANDIDATES})
        (root / table_path(name)).write_bytes(encode_table(to_arrow(name, rows)))
    read = {name: from_arrow(read_table(Folder(root), table_path(name), name), name) for name in TABLES}
    assert bits(PredictionSet.of_rows(rows_of(read, data()))) == bits(predictions)


@st.composite
def rows(draw: st.DrawFn) -> tuple[str, int]:
    """A table and one of its rows."""
    table = draw(st.sampled_from(TABLES))
    return table, draw(st.integers(0, size_of(table) - 1))


@given(st.sampled_from(TABLES), st.integers(0, 2**32))
def test_the_order_of_rows_is_no_mismatch(table: str, seed: int) -> None:
    order = np.random.default_rng(seed).permutation(size_of(table))
    assert mismatches({**frames(), table: dict(take(frames()[table], order))}) == []


@given(rows())
def test_a_row_that_is_gone_is_named(at: tuple[str, int]) -> None:
    table, row = at
    kept = take(frames()[table], np.arange(size_of(table)) != row)
    (mismatch,) = mismatches({**frames(), table: dict(kept)})
    assert (mismatch.location, mismatch.found) == (place_of(table, row), "no row")


@given(rows(), st.data())
def test_a_row_that_is_there_twice_is_named(at: tuple[str, int], draw: st.DataObject) -> None:
    table, row = at
    order = np.insert(np.arange(size_of(table)), draw.draw(st.integers(0, size_of(table))), row)
    (mismatch,) = mismatches({**frames(), table: dict(take(frames()[table], order))})
    assert (mismatch.location, mismatch.found) == (place_of(table, row), "several rows")


@given(rows(), st.data())
def test_a_value_that_is_no_number_is_named(at: tuple[str, int], draw: st.DataObject) -> None:
    table, row = at
    column = draw.draw(st.sampled_from(list(frames()[table])[KEYS[table] :]))
    value = draw.draw(st.sampled_from((np.nan, np.inf, -np.inf, np.nextafter(MAX_MAGNITUDE, np.inf), None)))
    values = frames()[table][column].copy()
    if value is None:
        values = np.ma.masked_array(values, np.arange(len(values)) == row)
    else:
        values[row] = value
    (mismatch,) = mismatches({**frames(), table: {**frames()[table], column: values}})
    assert mismatch.location == {**place_of(table, row), "column": column}
    assert mismatch.expected == f"a finite `{column}`"


_OTHER: dict[str, st.SearchStrategy[Any]] = {
    "model": st.sampled_from(["M0", "M1", "M2", "M3", "theirs", "M", ""]),
    "seed": st.sampled_from([0, 11, 23, 37, 1, 2**63 - 1, -1]),
    "group_id": st.one_of(st.sampled_from([g for part in data().parts.values() for g in part.groups]), st.text()),
    "action_key": st.one_of(st.sampled_from(CANDIDATES), st.text()),
    "step": st.integers(-(2**31), 2**31 - 1),
}


@settings(max_examples=100)
@given(rows(), st.data())
def test_a_row_of_another_key_is_missed_where_it_was(at: tuple[str, int], draw: st.DataObject) -> None:
    table, row = at
    column = draw.draw(st.sampled_from(list(frames()[table])[: KEYS[table]]))
    values = frames()[table][column].copy()
    other = draw.draw(_OTHER[column].filter(lambda value: value != values[row]))
    values[row] = other
    broken = {**frames(), table: {**frames()[table], column: values}}
    found = mismatches(broken)
    assert any((m.location, m.found) == (place_of(table, row), "no row") for m in found)
