"""How a dataset is stored carries no meaning: order, encoding, sharding and names change no verdict."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests import synthetic
from tests.audits import remembering
from tests.sampling import sampled
from tests.validator.engine.datasets import (
    DEPARTURES,
    FOLDER,
    OTHER_FOLDER,
    Tables,
    outcome,
    parquet_bytes,
    with_column,
    write,
    write_with,
)

from branchdrive.engine.validate import validate

Change = Callable[[Tables], Tables]


def in_each_table(change: Callable[[str, pa.Table], pa.Table]) -> Change:
    """A change of every table by itself."""
    return lambda tables: {
        folder: {name: change(name, table) for name, table in shard.items()} for folder, shard in tables.items()
    }


def shuffled(seed: int) -> Change:
    rng = np.random.default_rng(seed)
    return in_each_table(lambda _, table: table.take(pa.array(rng.permutation(len(table)))))


def columns_reversed(_: str, table: pa.Table) -> pa.Table:
    return table.select(table.column_names[::-1])


def by_groups(*parts: tuple[int, ...]) -> Change:
    """Groups spread over shards by their place among all groups; rows of nobody stay in the first shard."""

    def change(tables: Tables) -> Tables:
        whole = {name: pa.concat_tables([shard[name] for shard in tables.values()]) for name in tables[FOLDER]}
        rollouts = whole["rollouts"]
        groups = sorted(set(rollouts["group_id"].to_pylist()))
        everybody = rollouts["rollout_id"].combine_chunks()
        shards: Tables = {}
        for index, part in enumerate(parts):
            mine = pa.array([groups[i] for i in part])
            own = rollouts.filter(pc.is_in(rollouts["group_id"], mine))
            shard = shards[f"raw/shard-{index:05d}"] = {"rollouts": own}
            for name in set(whole) - {"rollouts"}:
                here = pc.is_in(whole[name]["rollout_id"], own["rollout_id"].combine_chunks())
                if index == 0:
                    here = pc.or_(here, pc.invert(pc.is_in(whole[name]["rollout_id"], everybody)))
                shard[name] = whole[name].filter(here)
        return shards

    return change


def swapped(tables: Tables) -> Tables:
    return {FOLDER: tables[OTHER_FOLDER], OTHER_FOLDER: tables[FOLDER]}


def with_gaps_between_numbers(tables: Tables) -> Tables:
    return {"raw/shard-00007": tables[FOLDER], "raw/shard-12345": tables[OTHER_FOLDER]}


def renamed(tables: Tables) -> Tables:
    """Other identities, in another alphabetical order."""

    def identity(text: str | None) -> str | None:
        return None if text is None else f"x{hash_of(text):08x}"

    def change(_: str, table: pa.Table) -> pa.Table:
        for column in ("rollout_id", "group_id", "nominal_rollout_id", "trigger_rollout_id"):
            if column in table.column_names:
                table = with_column(table, column, [identity(text) for text in table[column].to_pylist()])
        return table

    return in_each_table(change)(tables)


def hash_of(text: str) -> int:
    import zlib

    return zlib.crc32(text.encode())


CHANGES: dict[str, Change] = {
    "rows shuffled": shuffled(1),
    "rows shuffled otherwise": shuffled(2),
    "rows reversed": in_each_table(lambda _, table: table.take(pa.array(np.arange(len(table))[::-1]))),
    "columns reversed": in_each_table(columns_reversed),
    "one shard": by_groups((0, 1, 2)),
    "three shards": by_groups((2,), (0,), (1,)),
    "other shards": by_groups((0,), (1, 2)),
    "shards swapped": swapped,
    "shards of other numbers": with_gaps_between_numbers,
    "identities renamed": renamed,
}

each_departure = pytest.mark.parametrize("name", DEPARTURES)


STORED = [f"{change}-{name}" for change, name in product(CHANGES, DEPARTURES)]
"""What is stored in another order or place, and how."""


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """Outcome of every departure as it is usually stored."""
    folder = tmp_path_factory.mktemp("expected")
    return {name: outcome(validate(write(folder / name, d.tables()))) for name, d in DEPARTURES.items()}


@pytest.mark.parametrize(("change", "name"), sampled(product(CHANGES.values(), DEPARTURES), every=5), ids=STORED)
def test_order_and_place_of_rows_carry_no_meaning(
    name: str, change: Change, expected: dict[str, object], tmp_path: Path
) -> None:
    root = write(tmp_path / "dataset", change(DEPARTURES[name].tables()))
    assert outcome(validate(root, executor=remembering)) == expected[name]


ENCODINGS = {
    "tiny row groups": {"row_group_size": 37},
    "no compression": {"compression": "none", "use_dictionary": False},
    "snappy": {"compression": "snappy", "data_page_size": 512},
    "gzip, second page format": {"compression": "gzip", "data_page_version": "2.0"},
    "oldest format": {"version": "1.0", "compression": "none"},
    "without statistics": {"write_statistics": False, "compression": "zstd", "compression_level": 9},
    "with page index and checksums": {"write_page_index": True, "write_page_checksum": True},
    "one dictionary page after another": {"dictionary_pagesize_limit": 64, "row_group_size": 1000},
}


# What a file says once it is decoded hangs on no encoding, so every encoding and every departure is tried twice.
ENCODED = {
    f"{name}-{encoding}": (name, ENCODINGS[encoding])
    for shift in (0, 3)
    for name, encoding in zip(DEPARTURES, [*ENCODINGS][shift:] + [*ENCODINGS][:shift], strict=True)
}


@pytest.mark.parametrize(("name", "options"), ENCODED.values(), ids=ENCODED)
def test_encoding_of_files_carries_no_meaning(
    name: str, options: dict[str, object], expected: dict[str, object], tmp_path: Path
) -> None:
    content = {
        f"{folder}/{table_name}.parquet": parquet_bytes(table, **options)
        for folder, shard in DEPARTURES[name].tables().items()
        for table_name, table in shard.items()
    }
    assert outcome(validate(write_with(tmp_path / "dataset", content), executor=remembering)) == expected[name]


@each_departure
def test_order_of_claimed_streams_carries_no_meaning(name: str, expected: dict[str, object], tmp_path: Path) -> None:
    document = synthetic.descriptor()
    document["streams"] = document["streams"][::-1]
    root = write(tmp_path / "dataset", DEPARTURES[name].tables(), document)
    assert outcome(validate(root, executor=remembering)) == expected[name]


def test_these_changes_change_something(tmp_path: Path) -> None:
    base = synthetic.base_tables()
    assert all(change(base) != base for change in CHANGES.values())
