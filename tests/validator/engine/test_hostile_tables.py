"""Tables that lie, bomb, or hold what no column may hold: a finding each, never an error, a hang or a traceback."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests import synthetic
from tests.audits import remembering
from tests.sampling import sampled
from tests.validator.engine.datasets import (
    FOLDER,
    OTHER_FOLDER,
    edited,
    failing,
    parquet_bytes,
    status,
    with_column,
    write,
    write_with,
)
from tests.waiting import PATIENCE_S

from branchdrive.contract.limits import spec_limits
from branchdrive.engine.validate import validate

BASE = synthetic.base_tables()[FOLDER]
SMALL = OTHER_FOLDER
"""The shard of one group, for cases of many; what is said of the other shard is remembered."""

CONTROLS = BASE["controls"]
LIMITS = spec_limits()


def as_type(column: str, kind: pa.DataType, values: Any = None) -> pa.Table:
    """The controls with one column of another type."""
    array = pa.array(values, kind) if values is not None else CONTROLS[column].cast(kind)
    index = CONTROLS.schema.get_field_index(column)
    return CONTROLS.set_column(index, pa.field(column, kind), array)


def forged_rows(num_rows: int) -> bytes:
    """The controls with another number of rows in the footer."""
    content = parquet_bytes(CONTROLS, compression="none")
    honest, forged = (_zigzag(n) for n in (len(CONTROLS), num_rows))
    size = int.from_bytes(content[-8:-4], "little")
    footer = content[-8 - size : -8]
    assert len(honest) == len(forged)
    return content[: -8 - size] + footer.replace(b"\x16" + honest, b"\x16" + forged, 1) + content[-8:]


def _zigzag(value: int) -> bytes:
    coded, out = value << 1, bytearray()
    while coded > 0x7F:
        out.append(coded & 0x7F | 0x80)
        coded >>= 7
    return bytes([*out, coded])


def codes_out_of_range() -> bytes:
    """A dictionary-encoded column whose pages name words that the dictionary lacks."""
    many = pa.table({"rollout_id": pa.array([f"w{i % 200}" for i in range(1000)])})
    few = pa.table({"rollout_id": pa.array(["w0"] * 1000)})
    donor, victim = (parquet_bytes(t, compression="none", write_statistics=False) for t in (many, few))
    start = donor.index(b"w199") + 4
    page = victim.index(b"w0") + 2
    return victim[:page] + donor[start : start + 40] + victim[page + 40 :]


DUPLICATE = pa.Table.from_arrays([*CONTROLS.columns, CONTROLS["tick"]], [*CONTROLS.column_names, "tick"])
CONTENT = parquet_bytes(CONTROLS)
FULL = {"use_dictionary": False, "compression": "none"}

UNDECODABLE: dict[str, bytes] = {
    "empty": b"",
    "magic alone": b"PAR1",
    "two magics": b"PAR1PAR1",
    "truncated footer": CONTENT[:-20],
    "truncated in half": CONTENT[: len(CONTENT) // 2],
    "without its head": CONTENT[100:],
    "footer of 4 GiB": CONTENT[:-8] + b"\xff\xff\xff\xffPAR1",
    "footer of 0 bytes": CONTENT[:-8] + b"\0\0\0\0PAR1",
    "random": np.random.default_rng(1).bytes(5000),
    "random between magics": b"PAR1" + np.random.default_rng(2).bytes(5000) + b"PAR1",
    "zeros": bytes(5000),
    "text": b"rollout_id,tick\n" * 500,
    "encrypted footer": CONTENT[:-4] + b"PARE",
    "column name twice": parquet_bytes(DUPLICATE),
    "fewer rows than promised": forged_rows(len(CONTROLS) + 500),
    "more rows than promised": forged_rows(len(CONTROLS) - 500),
    "codes out of range": codes_out_of_range(),
    "text that is no UTF-8": parquet_bytes(as_type("source", pa.binary(), [b"\xff\xfe"] * len(CONTROLS)), **FULL),
}


@pytest.mark.parametrize("content", UNDECODABLE.values(), ids=UNDECODABLE)
def test_what_does_not_decode_is_a_finding(content: bytes, tmp_path: Path) -> None:
    report = validate(write_with(tmp_path / "dataset", {f"{FOLDER}/controls.parquet": content}), executor=remembering)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert failing(report) <= {"BD-TAB-001", "BD-TAB-002", "BD-LAY-007"}
    assert status(report, "BD-VAL-001") == "skipped"
    assert report.dataset.num_groups == 1


TYPES: dict[str, Callable[[], pa.Table]] = {
    "text as bytes": lambda: as_type("rollout_id", pa.binary()),
    "tick as int64": lambda: as_type("tick", pa.int64()),
    "tick as text": lambda: as_type("tick", pa.string()),
    "tick as float": lambda: as_type("tick", pa.float32()),
    "tick as decimal": lambda: as_type("tick", pa.decimal128(20, 3)),
    "tick as timestamp": lambda: as_type("tick", pa.timestamp("us"), [0] * len(CONTROLS)),
    "flag as number": lambda: as_type("active", pa.uint8()),
    "number as float64": lambda: as_type("expert_brake", pa.float64()),
    "number as half": lambda: as_type("expert_brake", pa.float16(), [np.float16(0)] * len(CONTROLS)),
    "list": lambda: as_type("tick", pa.list_(pa.int32()), [[1, 2]] * len(CONTROLS)),
    "list of lists": lambda: as_type("tick", pa.list_(pa.list_(pa.string())), [[["a"], []]] * len(CONTROLS)),
    "struct": lambda: as_type("tick", pa.struct([("tick", pa.int32())]), [{"tick": 1}] * len(CONTROLS)),
    "map": lambda: as_type("tick", pa.map_(pa.string(), pa.int32()), [[("a", 1)]] * len(CONTROLS)),
    "nothing": lambda: as_type("tick", pa.null(), [None] * len(CONTROLS)),
    "an extra column": lambda: CONTROLS.append_column("note", pa.array(["x"] * len(CONTROLS))),
    "a missing column": lambda: CONTROLS.drop_columns(["applied_brake"]),
    "no columns": lambda: CONTROLS.select([]),
    "a renamed column": lambda: CONTROLS.rename_columns(["Rollout_ID", *CONTROLS.column_names[1:]]),
}


@pytest.mark.parametrize("build", TYPES.values(), ids=TYPES)
def test_columns_of_other_types_are_a_finding(build: Callable[[], pa.Table], tmp_path: Path) -> None:
    content = parquet_bytes(build())
    report = validate(write_with(tmp_path / "dataset", {f"{FOLDER}/controls.parquet": content}), executor=remembering)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert failing(report) & {"BD-TAB-001", "BD-TAB-002"}
    assert failing(report) <= {"BD-TAB-001", "BD-TAB-002"}


@pytest.mark.parametrize("column", ["route_x_m", "route_y_m"])
@pytest.mark.parametrize(
    "kind", [pa.list_(pa.float32()), pa.large_list(pa.int64()), pa.list_(pa.float32(), 3), pa.string()], ids=str
)
def test_routes_of_other_types_are_a_finding(column: str, kind: pa.DataType, tmp_path: Path) -> None:
    values = ["1,2,3"] * len(BASE["rollouts"]) if kind == pa.string() else [[1, 2, 3]] * len(BASE["rollouts"])
    index = BASE["rollouts"].schema.get_field_index(column)
    table = BASE["rollouts"].set_column(index, pa.field(column, kind), pa.array(values, kind))
    report = validate(
        write_with(tmp_path / "dataset", {f"{FOLDER}/rollouts.parquet": parquet_bytes(table)}), executor=remembering
    )
    assert (report.verdict, report.errors, failing(report)) == ("invalid", (), {"BD-TAB-002"})


def test_text_may_be_encoded_as_a_dictionary_or_not(tmp_path: Path) -> None:
    tables = {
        folder: {
            name: pa.table(
                [c.dictionary_encode() if pa.types.is_string(c.type) else c for c in table.columns],
                schema=pa.schema(
                    [
                        f.with_type(pa.dictionary(pa.int32(), pa.string())) if pa.types.is_string(f.type) else f
                        for f in table.schema
                    ]
                ),
            )
            for name, table in shard.items()
        }
        for folder, shard in synthetic.base_tables().items()
    }
    for options in ({}, FULL, {"version": "1.0", "use_dictionary": True}):
        content = {
            f"{folder}/{name}.parquet": parquet_bytes(table, **options)
            for folder, shard in tables.items()
            for name, table in shard.items()
        }
        report = validate(write_with(tmp_path / "dataset", content))
        assert (report.verdict, failing(report)) == ("valid", frozenset())


# --- limits


@pytest.mark.parametrize(
    "bounds",
    [
        pytest.param({"max_table_columns": 15}, id="columns"),
        pytest.param({"max_table_rows": 4000}, id="rows"),
        pytest.param({"max_table_decoded_bytes": 100_000}, id="decoded bytes"),
        pytest.param({"max_table_bytes": 5_000}, id="stored bytes"),
    ],
)
def test_tables_over_a_limit_are_a_finding(
    bounds: dict[str, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("branchdrive.formats.untrusted_parquet", "branchdrive.engine.shard"):
        monkeypatch.setattr(f"{module}.spec_limits", lambda: replace(LIMITS, **bounds))
    bare = {folder: {"controls": shard["controls"]} for folder, shard in synthetic.base_tables().items()}
    report = validate(write(tmp_path / "dataset", bare))
    assert (report.verdict, report.errors) == ("invalid", ())
    assert failing(report) == {"BD-LAY-007", "BD-TAB-004"}


def test_the_limit_on_columns_is_that_of_the_specification(tmp_path: Path) -> None:
    wide = parquet_bytes(pa.table({f"column_{i}": np.zeros(10) for i in range(300)}))
    report = validate(write_with(tmp_path / "dataset", {f"{FOLDER}/controls.parquet": wide}), executor=remembering)
    assert (report.verdict, report.errors, failing(report)) == ("invalid", (), {"BD-LAY-007"})


# As bytes, since writers differ in how small they write them; both are compressed with zstd.
BOMBS = {
    # One cell of 35 million zeros in `route_x_m`: 0.7 kB on disk, 280 MB decoded.
    "one list": base64.b64decode(
        "UEFSMRUEFRAVIkwVAhUAEgAAKLUv/SAIQQAAAAAAAAAAAAAVABU0FUYsFYC7sCEVEBUGFQYcGAgAAAAAAAAAABgIAAAAAAAAAIAWACgI"
        "AAAAAAAAAAAYCAAAAAAAAACAEREAAAAotS/9IBrRAAAHAAAAA/7wurAhAQUAAACAu7AhAwGAu7AhABUEGUw1ABgGc2NoZW1hFQIANQIY"
        "CXJvdXRlX3hfbRUCFQZMPAAAADUEGARsaXN0FQIAFQolAhgHZWxlbWVudAAWAhkcGRwmABwVChk1AAYQGTgJcm91dGVfeF9tBGxpc3QH"
        "ZWxlbWVudBUMFoC7sCEW5AEWiAImRiYIHBgIAAAAAAAAAAAYCAAAAAAAAACAFgAoCAAAAAAAAAAAGAgAAAAAAAAAgBERABksFQQVABUC"
        "ABUAFRAVAgA8KSYC/rqwIRlGAAAAgLuwIQAAABbkARYCJggWiAIAGRwYDEFSUk9XOnNjaGVtYRjsAS8vLy8vNmdBQUFBUUFBQUFBQUFL"
        "QUF3QUJnQUZBQWdBQ2dBQUFBQUJCQUFNQUFBQUNBQUlBQUFBQkFBSUFBQUFCQUFBQUFFQUFBQUVBQUFBelAvLy93QUFBUXdVQUFBQUpB"
        "QUFBQVFBQUFBQkFBQUFMQUFBQUFrQUFBQnliM1YwWlY5NFgyMEFBQUFFQUFRQUJBQUFBQkFBRkFBSUFBWUFCd0FNQUFBQUVBQVFBQUFB"
        "QUFBQkF4QUFBQUFjQUFBQUJBQUFBQUFBQUFBRUFBQUFhWFJsYlFBQUJnQUlBQVlBQmdBQUFBQUFBZ0E9ABggcGFycXVldC1jcHAtYXJy"
        "b3cgdmVyc2lvbiAyNi4wLjEZHBwAAAD/AQAAUEFSMQ=="
    ),
    # 40,000 times the same megabyte in a column of bytes, `note`: 0.3 kB on disk, 40 GB decoded.
    "one word": base64.b64decode(
        "UEFSMRUEFYiJehVsTBUCFQASAAAotS/9gEhEQg8AbAAAKEBCDwB4AQD4/znQAgIAEHgCABB4AgAQeAIAEHgCABB4AgAQeCMSCngVABUa"
        "FSwsFcC4AhUQFQYVBhw2AAAAACi1L/0gDWkAAAQAAADAuAIBAcC4AgAVABUaFSwsFcC4AhUQFQYVBhw2AAAAACi1L/0gDWkAAAQAAADA"
        "uAIBAcC4AgAVBBksNQAYBnNjaGVtYRUCABUMJQIYBG5vdGUAFoDxBBkcGRwmABwVDBk1AAYQGRgEbm90ZRUMFoDxBBa4inoWwAImlAEm"
        "CBw2AAAZLBUEFQAVAgAVABUQFQQAPBaAwPyCqgIZBhkmAIDxBAAAABa4inoWgPEEJggWwAIAKCBwYXJxdWV0LWNwcC1hcnJvdyB2ZXJz"
        "aW9uIDI2LjAuMRkcHAAAAKQAAABQQVIx"
    ),
}

VALIDATE_AND_MEASURE = """
import json, re, resource, sys
from pathlib import Path
from branchdrive import validate
from branchdrive.runtime.executor import isolated

if __name__ == "__main__":
    report = validate(sys.argv[1], executor=isolated(1))
    rules = sorted({finding.rule for finding in report.findings})
    worker_kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    own_kib = int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
    print(json.dumps([report.verdict, list(report.errors), rules, worker_kib, own_kib]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="measures memory as Linux reports it")
@pytest.mark.parametrize("content", BOMBS.values(), ids=BOMBS)
def test_decompression_bombs_are_a_finding_in_bounded_memory(content: bytes, tmp_path: Path) -> None:
    assert len(content) < 1000
    root = write_with(tmp_path / "dataset", {f"{FOLDER}/rollouts.parquet": content})
    script = tmp_path / "measure.py"
    script.write_text(VALIDATE_AND_MEASURE)
    done = subprocess.run(
        [sys.executable, script, root], capture_output=True, text=True, check=True, timeout=PATIENCE_S, cwd=tmp_path
    )
    verdict, errors, rules, worker_kib, own_kib = json.loads(done.stdout)
    assert (verdict, errors, done.stderr) == ("invalid", [], "")
    assert set(rules) <= {"BD-LAY-007", "BD-TAB-001", "BD-TAB-002"}
    assert worker_kib < 2 * (1 << 20)
    assert own_kib < 0.25 * (1 << 20)


# --- values


def _extremes(kind: pa.DataType) -> list[Any]:
    if pa.types.is_floating(kind):
        info = np.finfo(kind.to_pandas_dtype())
        return [np.nan, np.inf, -np.inf, float(info.max), float(info.min), float(info.smallest_subnormal), 0.0, -0.0]
    if pa.types.is_integer(kind):
        bounds = np.iinfo(kind.to_pandas_dtype())
        return [bounds.min, bounds.max, -1, 0]
    if pa.types.is_boolean(kind):
        return [True, False]
    if pa.types.is_list(kind):
        return [[], [1.0], [1.0, 1.0], [np.nan, np.inf, 0.0], [None, 1.0], [1e300, -1e300, 1e300]]
    return ["", "\x1b[31m\n\u202e[red]", "A" * 10_000, "g0.nominal.a1", "nominal"]


COLUMNS = [(name, field.name) for name, table in BASE.items() for field in table.schema]


@pytest.mark.parametrize(
    ("name", "column"), sampled(COLUMNS, every=6), ids=[f"{name}.{column}" for name, column in COLUMNS]
)
def test_extreme_values_are_no_error(name: str, column: str, tmp_path: Path) -> None:
    table = synthetic.base_tables()[SMALL][name]
    kind = table.schema.field(column).type
    extremes = [*_extremes(kind), None]
    array = pa.array(extremes, kind).take(pa.array(np.arange(len(table)) % len(extremes)))
    tables = edited(name, lambda t: with_column(t, column, array), SMALL)
    report = validate(write(tmp_path / "dataset", tables), executor=remembering)
    assert report.errors == ()
    assert report.verdict == "invalid"


@pytest.mark.parametrize("num_rows", [0, 1])
@pytest.mark.parametrize("name", BASE)
def test_tables_of_hardly_any_rows_are_no_error(name: str, num_rows: int, tmp_path: Path) -> None:
    report = validate(write(tmp_path / "dataset", edited(name, lambda t: t.slice(0, num_rows))), executor=remembering)
    assert report.errors == ()
    assert report.verdict == ("valid" if name in ("actors", "evidence") else "invalid")


def test_a_dataset_without_any_row_judges_nothing(tmp_path: Path) -> None:
    tables = {
        folder: {name: table.slice(0, 0) for name, table in shard.items()}
        for folder, shard in synthetic.base_tables().items()
    }
    report = validate(write(tmp_path / "dataset", tables))
    assert (report.errors, failing(report)) == ((), frozenset({"BD-TAB-006"}))
    claimed = [tally for tally in report.tallies if tally.is_claimed]
    assert {t.status for t in claimed if t.rule_id.startswith(("BD-VAL", "BD-CTL", "BD-GRP"))} == {"skipped"}
    assert {t.reason for t in claimed if t.rule_id.startswith("BD-CTL")} == {"no subject"}


@settings(max_examples=12)  # a third of a second each
@given(data=st.data())
def test_any_cells_may_be_anything(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    tables = {folder: dict(shard) for folder, shard in synthetic.base_tables().items()}
    for _ in range(data.draw(st.integers(1, 6))):
        name, column = data.draw(st.sampled_from(COLUMNS))
        table = tables[SMALL][name]
        kind = table.schema.field(column).type
        rows = data.draw(st.lists(st.integers(0, len(table) - 1), min_size=1, max_size=5))
        replacement = pa.array([data.draw(st.sampled_from([*_extremes(kind), None]))], kind)
        places = np.full(len(table), -1)
        places[rows] = 0
        pool = pa.concat_arrays([table[column].combine_chunks(), replacement])
        indices = np.where(places == 0, len(table), np.arange(len(table)))
        tables[SMALL][name] = with_column(table, column, pool.take(pa.array(indices)))
    report = validate(write(tmp_path_factory.mktemp("cells") / "dataset", tables), executor=remembering)
    assert report.errors == ()
    assert report.verdict in ("valid", "invalid")
