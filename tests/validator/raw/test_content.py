"""Digests of what data say, held against the bytes that the specification names, and every way to write them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests import synthetic
from tests.validator.engine.datasets import FOLDER, OTHER_FOLDER, Tables, edited, parquet_bytes, write_with
from tests.validator.raw.spelled_content import ORDER, group_blocks, lines_digest, sha, table_block

from branchdrive.contract.columns import declared_table
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.identity import document_digest
from branchdrive.engine.validate import validate
from branchdrive.files.shard_facts import ShardFacts
from branchdrive.formats.parquet import encode_table
from branchdrive.raw.content import group_content, raw_content
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.content import table_digest


def spelled_content(tables: Tables) -> str:
    """Content digest of a raw layer, without any of the code that it is a digest of."""
    rows = {name: [row for shard in tables.values() for row in shard[name].to_pylist()] for name in ORDER}
    groups = {record["group_id"] for record in rows["rollouts"]}
    return lines_digest({f"group {one}": sha(b"".join(group_blocks(one, rows).values())).hex() for one in groups})


def content_of(root: Path) -> str | None:
    return validate(root, select=["BD-LAY", "BD-TAB"]).dataset.content.get("raw")


def written(root: Path, tables: Tables, encode: Callable[[pa.Table], bytes] = encode_table) -> Path:
    files = {
        f"{folder}/{name}.parquet": encode(table) for folder, shard in tables.items() for name, table in shard.items()
    }
    return write_with(root, files)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> str:
    found = content_of(written(tmp_path_factory.mktemp("base") / "dataset", synthetic.base_tables()))
    assert found is not None
    return found


def test_it_is_what_the_specification_spells(base: str) -> None:
    assert base == spelled_content(synthetic.base_tables())


@pytest.mark.parametrize("name", ORDER)
def test_a_table_without_rows_is_a_block(name: str) -> None:
    empty = synthetic.base_tables()[FOLDER][name].slice(0, 0)
    assert table_digest(name, empty) == table_block(name, []).hex()


def shuffled(tables: Tables) -> Tables:
    rng = np.random.default_rng(7)
    return {
        folder: {name: table.take(rng.permutation(len(table))) for name, table in shard.items()}
        for folder, shard in tables.items()
    }


def as_one_shard(tables: Tables) -> Tables:
    names = tables[FOLDER]
    whole = {name: pa.concat_tables([shard[name] for shard in tables.values()]) for name in names}
    return {FOLDER: whole, OTHER_FOLDER: {name: table.slice(0, 0) for name, table in whole.items()}}


def without_dictionaries(table: pa.Table) -> bytes:
    return parquet_bytes(table, compression="gzip", use_dictionary=False, row_group_size=101)


def with_dictionaries(table: pa.Table) -> bytes:
    return parquet_bytes(table, compression="none", use_dictionary=True, data_page_version="2.0", store_schema=False)


def reversed_columns(table: pa.Table) -> bytes:
    return parquet_bytes(table.select(table.column_names[::-1]))


@pytest.mark.parametrize("change", [shuffled, as_one_shard], ids=lambda change: change.__name__)
def test_order_and_shards_leave_it_alone(change: Callable[[Tables], Tables], base: str, tmp_path: Path) -> None:
    assert content_of(written(tmp_path / "dataset", change(synthetic.base_tables()))) == base


@pytest.mark.parametrize("encode", [without_dictionaries, with_dictionaries, reversed_columns])
def test_writing_leaves_it_alone(encode: Callable[[pa.Table], bytes], base: str, tmp_path: Path) -> None:
    assert content_of(written(tmp_path / "dataset", synthetic.base_tables(), encode)) == base


def replaced(name: str, column: str, change: Callable[[list[Any]], list[Any]]) -> Tables:
    """The valid tables with all cells of a column in the first shard given new values."""

    def edit(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index(column)
        field = table.schema.field(place)
        return table.set_column(place, field, pa.array(change(table[column].to_pylist()), field.type))

    return edited(name, edit)


def first(change: Callable[[Any], Any]) -> Callable[[list[Any]], list[Any]]:
    return lambda cells: [change(cells[0]), *cells[1:]]


CHANGES: Mapping[str, Callable[[], Tables]] = {
    "last bit": lambda: replaced("observations", "x_m", first(lambda x: math.nextafter(x, math.inf))),
    "sign of zero": lambda: replaced("controls", "applied_brake", lambda cells: [-0.0 if x == 0 else x for x in cells]),
    "flag": lambda: replaced("observations", "vehicle_hazard", first(lambda flag: not flag)),
    "text": lambda: replaced("observations", "command", first(lambda _: "right")),
    "null": lambda: replaced("controls", "nominal_steer", lambda cells: [x or 0.0 for x in cells]),
    "vertex": lambda: replaced("rollouts", "route_x_m", first(lambda xs: [*xs[:-1], xs[-1] + 1])),
    "row less": lambda: edited("actors", lambda table: table.slice(1)),
}


@pytest.mark.parametrize("name", CHANGES)
def test_everything_that_is_said_changes_it(name: str, base: str, tmp_path: Path) -> None:
    assert content_of(written(tmp_path / "dataset", CHANGES[name]())) not in (base, None)


def content_by_group(tables: Mapping[str, pa.Table]) -> dict[str, str]:
    view = ShardView(tables, Descriptor.model_validate(synthetic.descriptor()))
    found = group_content(view)
    assert found is not None
    return dict(zip(view.group_ids, (digest.tobytes().hex() for digest in found), strict=True))


def with_another_cell(table: pa.Table, column: str, row: int) -> pa.Table:
    place, cells = table.schema.get_field_index(column), table[column].to_pylist()
    field, cell = table.schema.field(place), cells[row]
    if pa.types.is_list(field.type):
        cells[row] = [*(cell or []), 1.5]
    elif pa.types.is_string(field.type):
        cells[row] = f"{cell}-other"
    else:
        cells[row] = not cell if pa.types.is_boolean(field.type) else (cell or 0) + 1
    return table.set_column(place, field, pa.array(cells, field.type))


def columns_of(name: str) -> list[str]:
    return [column.name for column in declared_table(name).columns if column.name not in ("rollout_id", "group_id")]


@pytest.mark.parametrize(("name", "column"), [(name, column) for name in ORDER for column in columns_of(name)])
def test_every_cell_is_in_the_digest_of_its_group_alone(name: str, column: str) -> None:
    tables = synthetic.base_tables()[FOLDER]
    row = len(tables[name]) - 1
    rollout_id = tables[name]["rollout_id"][row].as_py()
    owner = next(r["group_id"] for r in tables["rollouts"].to_pylist() if r["rollout_id"] == rollout_id)
    before = content_by_group(tables)
    after = content_by_group({**tables, name: with_another_cell(tables[name], column, row)})
    assert len(before) > 1
    assert [group for group in before if before[group] != after[group]] == [owner]


def renamed(tables: Tables, new: Callable[[str], str]) -> Tables:
    """The tables with other identities of attempts."""
    names = {"rollout_id", "nominal_rollout_id", "trigger_rollout_id"}

    def named(table: pa.Table) -> pa.Table:
        for place, field in enumerate(table.schema):
            if field.name in names:
                cells = [one and new(one) for one in table[field.name].to_pylist()]
                table = table.set_column(place, field, pa.array(cells, field.type))
        return table

    return {folder: {name: named(table) for name, table in shard.items()} for folder, shard in tables.items()}


@pytest.mark.parametrize("change", [lambda tables: tables, shuffled, as_one_shard])
def test_attempts_of_groups_may_alternate(change: Callable[[Tables], Tables], tmp_path: Path) -> None:
    tables = renamed(synthetic.base_tables(), lambda one: one[::-1])
    assert content_of(written(tmp_path / "dataset", change(tables))) == spelled_content(tables)


def test_a_group_in_several_shards_has_no_content() -> None:
    one = ShardFacts("raw/shard-00000", group_ids=["g"], groups=np.zeros((1, 32), np.uint8))
    assert raw_content([one]) is not None
    assert raw_content([one, replace(one, folder="raw/shard-00001")]) is None


def test_a_repeated_attempt_has_no_content() -> None:
    shards = [
        ShardFacts(f"raw/shard-0000{i}", rollout_ids=["r"], group_ids=[name], groups=np.zeros((1, 32), np.uint8))
        for i, name in enumerate("ab")
    ]
    assert raw_content(shards) is None


def test_an_attempt_without_a_group_has_no_content() -> None:
    tables = synthetic.base_tables()[FOLDER]
    place = tables["rollouts"].schema.get_field_index("group_id")
    groups = pa.array([None, *tables["rollouts"]["group_id"].to_pylist()[1:]], pa.string())
    rollouts = tables["rollouts"].set_column(place, pa.field("group_id", pa.string()), groups)
    view = ShardView({**tables, "rollouts": rollouts}, Descriptor.model_validate(synthetic.descriptor()))
    assert group_content(view) is None


def test_repeated_rows_have_one_order(tmp_path: Path) -> None:
    def twice(table: pa.Table) -> pa.Table:
        other = table.slice(40, 3)
        place = other.schema.get_field_index("applied_steer")
        other = other.set_column(place, other.schema.field(place), pa.array([0.5] * 3, pa.float32()))
        return pa.concat_tables([table, other, other])

    tables = edited("controls", twice)
    found = content_of(written(tmp_path / "one", tables))
    assert found is not None
    assert content_of(written(tmp_path / "other", shuffled(tables))) == found


def test_rows_of_nobody_have_no_content(tmp_path: Path) -> None:
    lost = edited("rollouts", lambda table: table.slice(1))
    assert content_of(written(tmp_path / "dataset", lost)) is None
    report = validate(tmp_path / "dataset")
    assert (report.dataset.content_identity, report.verdict) == (None, "invalid")


def test_many_texts_are_counted_like_few(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.tables.content._CELLS_PER_RUN", 0)
    assert content_of(written(tmp_path / "dataset", synthetic.base_tables())) == base


@pytest.mark.parametrize(
    ("document", "spelled"),
    [
        (None, "n"),
        ([True, False], "a2:tf"),
        ({"b": 1.0, "a": -3}, "o2:s1:ai-3;s1:bi1;"),
        ("\u00e9", "s2:\u00e9"),
        (0.1, "d0x1.999999999999ap-4;"),
        (1e300, f"i{int(1e300)};"),
        (2**63, "i9223372036854775808;"),
    ],
)
def test_documents_are_spelled(document: Any, spelled: str) -> None:
    assert document_digest(document) == sha(spelled.encode()).hex()


def spelled_bytes(value: Any) -> bytes:
    """The definition, clause by clause."""
    if value is None or isinstance(value, bool):
        return {None: b"n", True: b"t", False: b"f"}[value]
    if isinstance(value, int | float) and value == value // 1:
        return b"i%d;" % int(value)
    if isinstance(value, float):
        return b"d" + value.hex().encode() + b";"
    if isinstance(value, str):
        return b"s%d:" % len(value.encode()) + value.encode()
    if isinstance(value, list):
        return b"a%d:" % len(value) + b"".join(map(spelled_bytes, value))
    members = sorted(value.items(), key=lambda member: member[0].encode())
    return b"o%d:" % len(members) + b"".join(spelled_bytes(key) + spelled_bytes(item) for key, item in members)


JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.sampled_from([0.0, -0.0, 1.0, 5e-324, 1e300, 2.0**53])
    | st.text(st.characters(exclude_categories=["Cs"])),
    lambda parts: st.lists(parts) | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), parts),
)


@given(JSON_VALUES)
def test_any_document_is_spelled_as_defined(document: Any) -> None:
    assert document_digest(document) == sha(spelled_bytes(document)).hex()


def duckdb_bytes(table: pa.Table, folder: Path) -> bytes:
    duckdb = pytest.importorskip("duckdb")
    path = folder / "duckdb.parquet"
    with duckdb.connect() as connection:
        connection.register("source", table)
        connection.execute(f"COPY (SELECT * FROM source) TO '{path}' (FORMAT parquet, COMPRESSION gzip)")
    return path.read_bytes()


def polars_bytes(table: pa.Table, folder: Path) -> bytes:
    polars = pytest.importorskip("polars")
    path = folder / "polars.parquet"
    polars.from_arrow(table).write_parquet(path, compression="lz4")
    return path.read_bytes()


@pytest.mark.parametrize("encode", [duckdb_bytes, polars_bytes])
def test_files_of_other_programs_are_read_like_our_own(
    encode: Callable[[pa.Table, Path], bytes], base: str, tmp_path: Path
) -> None:
    root = written(tmp_path / "dataset", synthetic.base_tables(), partial(encode, folder=tmp_path))
    report = validate(root)
    assert [finding.message for finding in report.findings] == []
    assert (report.verdict, report.dataset.content["raw"]) == ("valid", base)
