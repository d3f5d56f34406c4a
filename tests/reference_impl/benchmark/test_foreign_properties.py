"""Whatever columns a file of predictions has, it is refused in one line or read as it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.each import each
from tests.validator.benchmark.samples import small_protocol
from tests.validator.benchmark.tiny import CANDIDATES, data

from branchdrive import DatasetError
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive_reference.benchmark.foreign import read_predictions

Columns = dict[str, pa.Array]

GROUPS = data().part("test").groups
SIZE = len(GROUPS) * len(CANDIDATES)
NAMES = ("group_id", "action_key", "seed", *(target.name for target in TARGETS), *TRAJECTORY)
INTEGERS = (pa.int8(), pa.int16(), pa.int32(), pa.int64(), pa.uint8(), pa.uint16(), pa.uint32(), pa.uint64())
FLOATS = (pa.float16(), pa.float32(), pa.float64())


def columns() -> Columns:
    """A whole prediction of the test partition, each value another."""
    rng = np.random.default_rng(0)
    found: Columns = {
        "group_id": pa.array([group for group in GROUPS for _ in CANDIDATES]),
        "action_key": pa.array(list(CANDIDATES) * len(GROUPS)),
        "seed": pa.array([5] * SIZE),
    }
    found |= {target.name: pa.array(rng.normal(size=SIZE)) for target in TARGETS}
    return found | {name: pa.array(rng.normal(size=(SIZE, 10)).tolist()) for name in TRAJECTORY}


def read(folder: Path, found: Columns, **options: Any) -> PredictionSet | None:
    """Predictions of a file of these columns; ``None`` where it is refused in one line."""
    file = folder / "theirs.parquet"
    pq.write_table(pa.table(list(found.values()), names=list(found)), file, **options)
    try:
        return read_predictions(file, "theirs", data(), small_protocol())
    except DatasetError as error:
        assert "\n" not in str(error) and str(file) in str(error)
        return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("foreign")


def fitting(dtype: pa.DataType) -> st.SearchStrategy[Any]:
    """Values of a type."""
    if pa.types.is_floating(dtype):
        return st.floats(width={"halffloat": 16, "float": 32, "double": 64}[str(dtype)])  # type: ignore[arg-type]
    if pa.types.is_integer(dtype):
        is_signed = pa.types.is_signed_integer(dtype)
        bits = dtype.bit_width - is_signed
        return st.integers(-(2**bits) if is_signed else 0, 2**bits - 1)
    if pa.types.is_boolean(dtype):
        return st.booleans()
    if pa.types.is_binary(dtype):
        return st.binary(max_size=9)
    if pa.types.is_null(dtype):
        return st.none()
    return st.one_of(st.sampled_from([*GROUPS, *CANDIDATES]), st.text(max_size=9))


@st.composite
def arrays(draw: st.DrawFn) -> pa.Array:
    """A column of any type and content, with nulls perhaps, and in lists perhaps."""
    dtype = draw(
        st.sampled_from([*INTEGERS, *FLOATS, pa.bool_(), pa.string(), pa.large_string(), pa.binary(), pa.null()])
    )
    value = fitting(dtype)
    if draw(st.booleans()):
        value = st.one_of(value, st.none())
    kind = draw(st.sampled_from(["plain", "list", "large", "fixed", "struct", "dictionary"]))
    if kind == "plain" or (kind == "dictionary" and not pa.types.is_string(dtype)):
        return pa.array(draw(st.lists(value, min_size=SIZE, max_size=SIZE)), dtype)
    if kind == "dictionary":
        return pa.array(draw(st.lists(value, min_size=SIZE, max_size=SIZE)), dtype).dictionary_encode()
    length = draw(st.sampled_from([0, 9, 10, 11])) if kind != "fixed" else 10
    values = draw(st.lists(value, min_size=length, max_size=length))
    cells = [values] * SIZE
    if kind == "struct":
        return pa.array(
            [{"a": one} for one in draw(st.lists(value, min_size=SIZE, max_size=SIZE))], pa.struct([("a", dtype)])
        )
    make: dict[str, Callable[[pa.DataType], pa.DataType]] = {
        "list": pa.list_, "large": pa.large_list, "fixed": lambda of: pa.list_(of, 10),
    }  # fmt: skip
    return pa.array(cells, make[kind](dtype))


def values_of(found: PredictionSet, name: str) -> list[Any]:
    """What was read of a column, in the order of groups and candidates."""
    (seed,) = found.seeds("theirs")
    if name == "seed":
        return [seed] * SIZE
    (one,) = found.by_model["theirs"][seed].values()
    if name in TRAJECTORY:
        return list(one.paths.reshape(SIZE, 10, -1)[:, :, TRAJECTORY.index(name)].tolist())
    place = [target.name for target in TARGETS].index(name)
    return list(one.scalars.reshape(SIZE, -1)[:, place].tolist())


def test_a_whole_prediction_is_read_as_it_is(folder: Path) -> None:
    found = read(folder, columns())
    assert found is not None
    for name in NAMES[2:]:
        assert values_of(found, name) == columns()[name].to_pylist()


@settings(max_examples=100)
@given(name=st.sampled_from(NAMES), array=arrays())
def test_a_column_of_any_type_is_refused_or_read_as_it_is(folder: Path, name: str, array: pa.Array) -> None:
    found = read(folder, columns() | {name: array})
    if found is not None:
        assert name in NAMES[2:]
        assert values_of(found, name) == array.to_pylist()


@given(name=st.sampled_from(NAMES[3:]), dtype=st.sampled_from(FLOATS), draw=st.data())
def test_floats_of_any_width_are_read_as_they_are(
    folder: Path, name: str, dtype: pa.DataType, draw: st.DataObject
) -> None:
    number = draw.draw(fitting(dtype))
    cells, kind = ([[number] * 10] * SIZE, pa.list_(dtype)) if name in TRAJECTORY else ([number] * SIZE, dtype)
    array = pa.array(cells, kind)
    found = read(folder, columns() | {name: array})
    assert (found is not None) == (abs(number) <= 1e12)
    assert found is None or values_of(found, name) == array.to_pylist()


@given(dtype=st.sampled_from(INTEGERS), draw=st.data())
def test_seeds_of_any_width_are_read_as_they_are(folder: Path, dtype: pa.DataType, draw: st.DataObject) -> None:
    seed = draw.draw(fitting(dtype))
    found = read(folder, columns() | {"seed": pa.array([seed] * SIZE, dtype)})
    assert (found is not None) == (0 <= seed < 2**63)
    assert found is None or found.seeds("theirs") == (seed,)


@given(order=st.permutations(range(SIZE)), pieces=st.integers(1, SIZE))
def test_rows_come_in_any_order_and_any_pieces(folder: Path, order: list[int], pieces: int) -> None:
    found = read(
        folder, {name: array.take(pa.array(order)) for name, array in columns().items()}, row_group_size=pieces
    )
    assert found is not None
    for name in NAMES[2:]:
        assert values_of(found, name) == columns()[name].to_pylist()


@given(names=st.lists(st.sampled_from(NAMES), min_size=1, unique=True), more=st.lists(st.text(max_size=9), max_size=2))
def test_columns_that_lack_or_are_unknown_are_refused(folder: Path, names: list[str], more: list[str]) -> None:
    found: list[tuple[str, pa.Array]] = [(name, array) for name, array in columns().items() if name not in names]
    found += [(name, columns()["min_ttc_s"]) for name in more]
    if set(names) != {"seed"} or more:
        assert read(folder, dict(found)) is None


@each("name", NAMES)
def test_a_column_that_is_there_twice_is_refused(folder: Path, name: str) -> None:
    file, table = folder / "twice.parquet", pa.table(columns())
    pq.write_table(table.append_column(name, columns()[name]), file)
    with pytest.raises(DatasetError, match=r"twice\.parquet: table repeats a column name"):
        read_predictions(file, "theirs", data(), small_protocol())


@given(st.binary(max_size=40), st.integers(0, 2**16))
def test_a_damaged_file_is_refused(folder: Path, content: bytes, place: int) -> None:
    file = folder / "damaged.parquet"
    pq.write_table(pa.table(columns()), file)
    whole = file.read_bytes()
    for damaged in (content, whole[: place % len(whole)], whole[: place % len(whole)] + content):
        file.write_bytes(damaged)
        with pytest.raises(DatasetError, match=r"^\S+damaged\.parquet: "):
            read_predictions(file, "theirs", data(), small_protocol())
