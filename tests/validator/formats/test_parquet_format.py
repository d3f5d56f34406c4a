"""What the file format allows beside what this distribution writes: codecs, encodings, pages, lists, types.

Tables are written by pyarrow, and by a writer of a page of code below, which shares nothing with it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from itertools import groupby, product
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests import synthetic

from branchdrive.contract.columns import TABLES
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DecodeError, LimitError
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import conform
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.tables.schema import type_mismatches

CODECS = ("none", "snappy", "gzip", "brotli", "zstd", "lz4")
ENCODINGS = {
    pa.string(): ("PLAIN", "DELTA_LENGTH_BYTE_ARRAY", "DELTA_BYTE_ARRAY"),
    pa.int32(): ("PLAIN", "DELTA_BINARY_PACKED", "BYTE_STREAM_SPLIT"),
    pa.int64(): ("PLAIN", "DELTA_BINARY_PACKED", "BYTE_STREAM_SPLIT"),
    pa.float32(): ("PLAIN", "BYTE_STREAM_SPLIT", "PLAIN"),
    pa.float64(): ("PLAIN", "BYTE_STREAM_SPLIT", "PLAIN"),
    pa.bool_(): ("PLAIN", "RLE", "PLAIN"),
}
"""Encodings of each type without a dictionary; in every place as many, so that a column of them is one file."""

COUNTS = [3, 0, 1, 2]
"""Elements of the lists that are written by hand."""


def tables() -> dict[str, pa.Table]:
    """A shard's tables, cut short."""
    shard = synthetic.media_tables()["raw/shard-00000"]
    return {name: table.slice(0, 60) for name, table in shard.items()}


def written(table: pa.Table, **options: Any) -> bytes:
    sink = BytesIO()
    pq.write_table(table, sink, **options)
    return sink.getvalue()


def encodings(table: pa.Table, place: int, element: str) -> dict[str, str]:
    """Encoding of every leaf, the one at `place`."""
    paths = {}
    for field in table.schema:
        is_list = pa.types.is_list(field.type)
        kind = field.type.value_type if is_list else field.type
        paths[f"{field.name}.list.{element}" if is_list else field.name] = ENCODINGS[kind][place]
    return paths


def choices(table: pa.Table) -> Iterator[dict[str, Any]]:
    """Options of pyarrow's writer: dictionaries or each of the encodings, in every codec, page and version."""
    for codec, page, version in product(CODECS, ("1.0", "2.0"), ("1.0", "2.6")):
        about = {"compression": codec, "data_page_version": page, "version": version, "row_group_size": 25}
        yield {**about, "use_dictionary": True}
        for place, is_compliant in product(range(3), (True, False)):
            encoding = encodings(table, place, "element" if is_compliant else "item")
            yield {**about, "use_dictionary": False, "column_encoding": encoding} | {
                "use_compliant_nested_type": is_compliant, "write_statistics": is_compliant,
                "write_page_index": is_compliant, "write_page_checksum": is_compliant,
            }  # fmt: skip


def test_every_codec_encoding_page_and_version_gives_the_same_table() -> None:
    there = tables()
    assert {column.type for table in TABLES.values() for column in table.columns} <= {
        *map(str, ENCODINGS), "list<float64>", "float32", "float64"
    }, "a new type of column needs its encodings here"  # fmt: skip
    for name, table in there.items():
        for index, options in enumerate(choices(table)):
            if index % len(there) == list(there).index(name):  # the tables share the work
                decoded = decode_table(written(table, **options), name)
                assert list(type_mismatches(decoded.schema, name)) == [], (name, options)
                assert conform(decoded, name).equals(conform(table, name)), (name, options)


def test_types_of_arrow_do_not_change_a_table() -> None:
    table = tables()["rollouts"]
    views = [pa.string_view()] if pa.__version__.split(".")[0] > "20" else []  # older ones cannot write them
    for text in (pa.large_string(), pa.dictionary(pa.int8(), pa.string()), *views):
        schema = pa.schema([f.with_type(text if pa.types.is_string(f.type) else f.type) for f in table.schema])
        for encoding in ("PLAIN", "DELTA_BYTE_ARRAY"):
            names = {f.name: encoding for f in schema if not pa.types.is_list(f.type) and f.type == text}
            decoded = decode_table(written(table.cast(schema), use_dictionary=False, column_encoding=names))
            assert list(type_mismatches(decoded.schema, "rollouts")) == [], text
            assert conform(decoded, "rollouts").equals(conform(table, "rollouts")), text
    numbers = pa.table({"x": [1.0, 2.0, 1.0]})
    assert decode_table(written(pa.table({"x": numbers["x"].dictionary_encode()}))).equals(numbers)
    pairs = [[1.0, 2.0], [3.0, 4.0]]
    for kind in (pa.list_(pa.float64(), 2), pa.large_list(pa.float64()), pa.list_(pa.field("x", pa.float64(), False))):
        decoded = decode_table(written(pa.table({"x": pa.array(pairs, kind)})))
        assert decoded["x"].type == pa.list_(pa.float64()), kind
        assert decoded["x"].to_pylist() == pairs


def test_text_without_a_dictionary_keeps_its_nulls_and_becomes_one_dictionary() -> None:
    words = [None if i % 7 == 0 else f"w{i % 5}é" for i in range(5000)]
    for encoding in ("DELTA_BYTE_ARRAY", "DELTA_LENGTH_BYTE_ARRAY"):
        content = written(pa.table({"x": words}), use_dictionary=False, column_encoding={"x": encoding})
        column = decode_table(content)["x"]
        assert column.to_pylist() == words
        assert all(chunk.dictionary.equals(column.chunk(0).dictionary) for chunk in column.chunks)
    empty = pa.table({"x": pa.array([], pa.string())})
    content = written(empty, use_dictionary=False, column_encoding={"x": "DELTA_BYTE_ARRAY"})
    assert pa.types.is_dictionary(decode_table(content)["x"].type)


def test_text_that_grows_when_it_is_decoded_stops_at_the_limit() -> None:
    many = pa.table({"x": [f"{'a' * 2_000}{i:06d}" for i in range(20_000)]})
    bomb = written(many, use_dictionary=False, column_encoding={"x": "DELTA_BYTE_ARRAY"}, compression="zstd")
    del many
    assert len(bomb) < 20_000
    limit = 5_000_000
    pool = pa.default_memory_pool()
    watched = pa.proxy_memory_pool(pool)
    pa.set_memory_pool(watched)
    try:
        with pytest.raises(LimitError, match="decodes to"):
            decode_table(bomb, limits=replace(spec_limits(), max_table_decoded_bytes=limit))
    finally:
        pa.set_memory_pool(pool)
    assert watched.max_memory() < 3 * limit


def test_damage_in_a_page_of_deltas_is_refused_or_decodes() -> None:
    table = pa.table({"x": [f"word {i}" for i in range(300)]})
    content = written(table, use_dictionary=False, column_encoding={"x": "DELTA_BYTE_ARRAY"}, compression="none")
    rng, num_refused = np.random.default_rng(8), 0
    for _ in range(300):
        damaged = bytearray(content)
        damaged[int(rng.integers(4, len(content)))] ^= 1 << int(rng.integers(8))
        try:
            decode_table(bytes(damaged))
        except DecodeError:
            num_refused += 1
    assert num_refused > 30


def test_a_wrong_call_of_the_library_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    content = written(pa.table({"x": [1]}))
    monkeypatch.setattr("branchdrive.formats.untrusted_parquet._without_extensions", lambda: {"no_such_option": True})
    with pytest.raises(TypeError, match="no_such_option"):
        decode_table(content)


# --- a writer of the format, from its definition (https://github.com/apache/parquet-format)


def varint(value: int) -> bytes:
    low = value & 0x7F
    return bytes([low]) if value < 0x80 else bytes([low | 0x80]) + varint(value >> 7)


def thrift(value: Any) -> tuple[int, bytes]:
    """Type and bytes of a value in the compact protocol: int, text, list, or a struct as fields by number.

    An int of Python is an i64; an i32 is written as ``(value,)``.
    """
    match value:
        case int():
            return 6, varint((value << 1) ^ (value >> 63))
        case (int() as small,):
            return 5, varint((small << 1) ^ (small >> 31))
        case str():
            return 8, varint(len(value.encode())) + value.encode()
        case list():
            kinds = [thrift(item) for item in value]
            return 9, bytes([len(value) << 4 | kinds[0][0]]) + b"".join(content for _, content in kinds)
    content, last = b"", 0
    for number, field in sorted(value.items()):
        kind, encoded = thrift(field)
        content += bytes([(number - last) << 4 | kind]) + encoded
        last = number
    return 12, content + b"\x00"


def levels(values: Sequence[int], max_level: int) -> bytes:
    """Levels of a page as runs of equal values; nothing where there is one level only."""
    runs = b"".join(varint(len(list(run)) << 1) + bytes([level]) for level, run in groupby(values))
    return struct.pack("<I", len(runs)) + runs if max_level else b""


def by_hand(
    elements: list[dict[int, Any]], path: list[str], page: bytes, num_values: int, num_rows: int, **odd: int
) -> bytes:
    """A file with one column of doubles: `elements` below the root, one uncompressed page of version 1."""
    encoding, codec = odd.get("encoding", 0), odd.get("codec", 0)
    about = {1: (num_values,), 2: (encoding,), 3: (3,), 4: (3,)}
    chunk = thrift({1: (0,), 2: (len(page),), 3: (len(page),), 5: about})[1] + page
    column = {1: (5,), 2: [(encoding,)], 3: path, 4: (codec,), 5: num_values, 6: len(chunk), 7: len(chunk), 9: 4}
    group = {1: [{2: 4, 3: column}], 2: len(chunk), 3: num_rows}
    root = {4: "schema", 5: (1,)}
    footer = thrift({1: (1,), 2: [root, *elements], 3: num_rows, 4: [group]})[1]
    return b"PAR1" + chunk + footer + struct.pack("<I", len(footer)) + b"PAR1"


def lists(layout: str) -> bytes:
    """The lists 0.0, 1.0, .. of `COUNTS` elements in a layout of lists.

    ``x (LIST) > list > element`` and its older names, ``x (LIST) > array`` of two levels, or a repeated column.
    """
    names = layout.split(".")
    is_bare, num_levels = len(names) == 1, len(names)
    double: dict[int, Any] = {1: (5,), 4: names[-1]}
    outer = {3: (1,), 4: names[0], 5: (1,), 6: (3,)}  # optional, of one child, LIST
    elements = {
        1: [{**double, 3: (2,)}],
        2: [outer, {**double, 3: (2,)}],
        3: [outer, {3: (2,), 4: names[1 % num_levels], 5: (1,)}, {**double, 3: (1,)}],
    }[num_levels]
    base = 0 if is_bare else 1
    max_definition = base + 1 + (num_levels == 3)
    definition = [d for count in COUNTS for d in ([max_definition] * count or [base])]
    repetition = [int(i > 0) for count in COUNTS for i in range(max(count, 1))]
    values = np.arange(sum(COUNTS), dtype="<f8").tobytes()
    page = levels(repetition, 1) + levels(definition, max_definition) + values
    return by_hand(elements, names, page, len(definition), len(COUNTS))


def test_every_layout_of_lists_is_a_list() -> None:
    flat = iter(range(sum(COUNTS)))
    wanted = [[float(next(flat)) for _ in range(count)] for count in COUNTS]
    for layout in ("x.list.element", "x.list.item", "x.bag.array_element", "x.array", "x"):
        column = decode_table(lists(layout))["x"]
        assert column.type == pa.list_(pa.float64()), layout
        assert column.to_pylist() == wanted, layout


def test_what_need_not_be_read_is_refused_by_its_name() -> None:
    def of(**odd: int) -> bytes:
        page = np.arange(2.0).tobytes()
        return by_hand([{1: (5,), 3: (0,), 4: "x"}], ["x"], page, 2, 2, **odd)

    assert decode_table(of())["x"].to_pylist() == [0.0, 1.0]
    for content, named in (
        (of(codec=3), "LZO"),
        (of(encoding=4), "encoding"),
        (of(encoding=7), "DELTA_BYTE_ARRAY"),
        (of(encoding=99), "encoding"),
        (of()[:-4] + b"PARE", "encrypted"),
    ):
        with pytest.raises(DecodeError, match=f"(?i){named}"):
            decode_table(content)


def test_columns_that_are_called_like_the_key_of_the_arrow_schema_are_read() -> None:
    names = ["ARROW:schema", "aARROW:schema", "value"]
    table = pa.table({name: pa.array(["a", "b"]) for name in names})
    assert decode_table(encode_table(table)).column_names == names


def test_text_that_a_delta_encoding_repeats_is_counted_before_much_of_it_is_written_out() -> None:
    num_rows, num_characters, limit = 1_024, 1 << 18, 1 << 22
    table = pa.table({"text": pa.array(["x" * num_characters] * num_rows, pa.large_string())})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, use_dictionary=False, column_encoding="DELTA_BYTE_ARRAY", compression="zstd")
    del table
    content, before = sink.getvalue().to_pybytes(), pa.default_memory_pool()
    counted = pa.proxy_memory_pool(before)
    pa.set_memory_pool(counted)
    try:
        with pytest.raises(LimitError, match=f"the limit is {limit}"):
            decode_table(content, limits=replace(spec_limits(), max_table_decoded_bytes=limit))
    finally:
        pa.set_memory_pool(before)
    assert len(content) < 100_000
    assert counted.max_memory() < 400 * num_characters
