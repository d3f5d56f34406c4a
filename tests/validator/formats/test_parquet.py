from __future__ import annotations

import random
from contextlib import suppress
from dataclasses import replace
from io import BytesIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.validator.writer.invented import control_rows, generator

from branchdrive.contract.columns import table_schema
from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.errors import DecodeError, LimitError
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import conform
from branchdrive.formats.untrusted_parquet import decode_table, promised_rows


def controls(num_rows: int = 300) -> pa.Table:
    rng = generator("parquet")
    columns = control_rows(rng, num_rows, np.arange(num_rows) % 3 == 0)
    arrays = {name: pa.array(np.ma.getdata(v), mask=np.ma.getmaskarray(v)) for name, v in columns.items()}
    schema = table_schema("controls")
    arrays["rollout_id"] = pa.array([f"r{i // 100}" for i in range(num_rows)])
    return pa.Table.from_arrays([arrays[name].cast(schema.field(name).type) for name in schema.names], schema=schema)


def written(table: pa.Table, **options: object) -> bytes:
    sink = BytesIO()
    pq.write_table(table, sink, **options)
    return sink.getvalue()


def limits(**bounds: int) -> Limits:
    return replace(spec_limits(), **bounds)


def test_a_table_survives_encoding_with_its_metadata() -> None:
    table = controls()
    decoded = decode_table(encode_table(table), "controls")
    assert pa.types.is_dictionary(decoded.schema.field("rollout_id").type)
    assert decoded.schema.field("expert_steer").metadata == table.schema.field("expert_steer").metadata
    assert conform(decoded, "controls").equals(table, check_metadata=True)


def test_bytes_do_not_depend_on_the_form_in_memory() -> None:
    table = controls()
    in_chunks = pa.concat_tables([table.slice(0, 7), table.slice(7, 100), table.slice(107)])
    assert encode_table(in_chunks) == encode_table(table)


def test_encodings_are_pinned() -> None:
    file = pq.ParquetFile(BytesIO(encode_table(controls(100_001))))
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == [100_000, 1]
    group = file.metadata.row_group(0)
    columns = {group.column(i).path_in_schema: group.column(i) for i in range(group.num_columns)}
    assert {column.compression for column in columns.values()} == {"ZSTD"}
    assert "BYTE_STREAM_SPLIT" in columns["expert_steer"].encodings
    assert "DELTA_BINARY_PACKED" in columns["tick"].encodings
    with_dictionary = {name for name, column in columns.items() if column.has_dictionary_page}
    assert with_dictionary == {"rollout_id", "source"}


def test_string_columns_share_one_dictionary_over_row_groups() -> None:
    content = written(pa.table({"word": [f"w{i // 10}" for i in range(100)]}), row_group_size=30)
    (word,) = decode_table(content).column("word").chunks
    assert word.dictionary.to_pylist() == [f"w{i}" for i in range(10)]
    assert word.to_pylist() == [f"w{i // 10}" for i in range(100)]


def test_every_column_is_in_one_piece_and_its_pieces_are_freed() -> None:
    num_rows = 150_000
    table = pa.table(
        {
            "number": pa.array(np.arange(num_rows, dtype=np.float64), mask=np.arange(num_rows) % 7 == 0),
            "flag": np.arange(num_rows) % 3 == 0,
            "list": pa.array([[0.5] * (i % 3) or None for i in range(num_rows)], pa.list_(pa.float64())),
        }
    )
    content = written(table, row_group_size=40_000)
    before = pa.total_allocated_bytes()
    decoded = decode_table(content)
    assert pa.total_allocated_bytes() - before < 1.25 * decoded.nbytes
    assert {column.num_chunks for column in decoded.columns} == {1}
    assert decoded.to_pydict() == table.to_pydict()


@pytest.mark.parametrize(
    ("table", "bounds", "message"),
    [
        (pa.table({"x": np.zeros(1001)}), {"max_table_rows": 1000}, "1001 rows"),
        (pa.table({"x": np.zeros(100_000)}), {"max_table_decoded_bytes": 10_000}, "decodes to"),
        (pa.table({"x": pa.array([[0.0] * 100_000])}), {"max_table_decoded_bytes": 10_000}, "decodes to"),
        (pa.table({"x": ["a" * 1_000_000]}), {"max_table_decoded_bytes": 10_000}, "decodes to"),
        (pa.table({f"x{i}": [0] for i in range(5)}), {"max_table_columns": 4}, "5 columns"),
        (pa.table({"x": np.arange(1000)}), {"max_table_bytes": 100}, "the limit is 100"),
    ],
)
def test_a_table_over_a_limit_is_refused(table: pa.Table, bounds: dict[str, int], message: str) -> None:
    with pytest.raises(LimitError, match=message):
        decode_table(written(table, compression="zstd"), limits=limits(**bounds))


def test_decoding_stops_at_the_limit_and_not_at_the_end() -> None:
    bomb = written(pa.table({"x": np.zeros(2_000_000)}), compression="zstd")
    pool = pa.default_memory_pool()
    watched = pa.proxy_memory_pool(pool)
    pa.set_memory_pool(watched)
    try:
        with pytest.raises(LimitError):
            decode_table(bomb, limits=limits(max_table_decoded_bytes=1_000_000))
    finally:
        pa.set_memory_pool(pool)
    assert len(bomb) < 10_000
    assert watched.bytes_allocated() == 0
    assert watched.max_memory() < 5_000_000


def test_a_footer_that_lies_about_its_rows_is_found_out() -> None:
    content = written(pa.table({"x": np.arange(100, dtype=np.int8)}), compression="none", store_schema=False)
    footer_bytes = int.from_bytes(content[-8:-4], "little")
    data, footer = content[: -8 - footer_bytes], content[-8 - footer_bytes :]
    # Field 3 of the footer, the total of rows, is the first zigzag varint 200 after an i64 field header.
    assert footer.count(b"\x16\xc8\x01") >= 1
    forged = data + footer.replace(b"\x16\xc8\x01", b"\x16\xca\x01", 1)
    with pytest.raises(DecodeError, match="promises 101 rows in its footer and holds 100"):
        decode_table(forged)


def test_strings_that_are_not_utf8_are_refused() -> None:
    buffers = pa.array([b"fine", b"\xff\xfe"], pa.binary()).buffers()
    table = pa.table({"x": pa.Array.from_buffers(pa.string(), 2, buffers)})
    with pytest.raises(DecodeError, match="UTF8"):
        decode_table(written(table))


def test_a_repeated_column_name_is_refused() -> None:
    table = pa.Table.from_arrays([pa.array([1]), pa.array([2])], names=["x", "x"])
    with pytest.raises(DecodeError, match="repeats a column"):
        decode_table(written(table), "controls")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.5, 0.9, 0.99, 0.999])
def test_a_truncated_file_is_refused(share: float) -> None:
    content = encode_table(controls())
    with pytest.raises(DecodeError):
        decode_table(content[: int(len(content) * share)])


@pytest.mark.parametrize("seed", range(4))
def test_damaged_bytes_decode_or_raise_a_decode_error(seed: int) -> None:
    content = encode_table(controls())
    rng = random.Random(seed)
    num_refused = 0
    for _ in range(250):
        damaged = bytearray(content)
        for _ in range(rng.choice([1, 2, 8])):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        try:
            decode_table(bytes(damaged))
        except DecodeError as error:
            num_refused += 1
            assert str(error).isprintable()
            assert len(str(error)) < 300
    assert num_refused > 50


def test_rows_are_promised_by_the_footer_alone() -> None:
    content = encode_table(controls())
    assert promised_rows(BytesIO(content)) == 300
    footer = int.from_bytes(content[-8:-4], "little") + 8
    assert promised_rows(BytesIO(bytes(len(content) - footer) + content[-footer:])) == 300


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1PAR1", bytes(100), b"x" * 92 + b"\xff\xff\xff\x7fPAR1"])
def test_what_has_no_footer_promises_nothing(content: bytes) -> None:
    with pytest.raises(DecodeError, match="footer"):
        promised_rows(BytesIO(content))


def test_a_damaged_footer_promises_nothing_or_a_number() -> None:
    content, generator = encode_table(controls()), random.Random(1)
    footer = int.from_bytes(content[-8:-4], "little")
    for _ in range(200):
        damaged = bytearray(content)
        damaged[-8 - generator.randrange(1, footer)] ^= 1 << generator.randrange(8)
        with suppress(DecodeError):
            assert isinstance(promised_rows(BytesIO(damaged)), int)
