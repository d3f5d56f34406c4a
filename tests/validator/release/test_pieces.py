"""Rules on a release as a whole merge pieces of its parts, and say what all rows say."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic import seal_dataset
from tests.validator.release.running import derived, read, rewrite

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import parse_json
from branchdrive.contract.layer import table_path, table_paths
from branchdrive.engine.cache import Cache
from branchdrive.engine.derived_rules import judge_part
from branchdrive.engine.spool import SpooledFrames
from branchdrive.engine.validate import validate
from branchdrive.formats.table_file import join_parts
from branchdrive.tables.arrow import StoredFrame


def told(root: Path, **options: Any) -> Any:
    """What a report says but for how long it took."""
    report = validate(root, **options)
    rules = [(t.rule_id, t.status, t.reason, t.examined, t.total, t.num_findings, t.findings) for t in report.tallies]
    return report.verdict, rules


def on_all_rows(root: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What a report says where parts give no pieces."""
    with monkeypatch.context() as patched:
        patched.setattr("branchdrive.engine.derived._are_in_place", lambda _: False)
        return told(root)


def drop_first_pair(root: Path) -> None:
    path = table_path("pairs", part=1)
    rewrite(root, path, read(root, path).slice(1))


def change_bank_of_part(root: Path) -> None:
    path = table_path("pairs", part=1)
    rows = read(root, path)
    import pyarrow.compute as pc

    rewrite(root, path, rows.filter(pc.not_equal(rows["action_key"], rows["action_key"][0])))


def spoil_history(root: Path) -> None:
    path = next(path for path in table_paths("state", derived(root)) if path.endswith("-00001.parquet"))
    rewrite(root, path, read(root, path).slice(1))


def repeat_context(root: Path) -> None:
    paths = table_paths("contexts", derived(root))
    first, other = (next(path for path in paths if path.endswith(f"-0000{part}.parquet")) for part in (0, 1))
    rewrite(root, first, join_parts([read(root, first), read(root, other)]))


def misstate_documents(root: Path) -> None:
    for path, name in (("quality/thresholds.json", "num_groups"), ("canonical/source.json", "num_attempts")):
        document = parse_json((root / path).read_bytes())
        (root / path).write_text(json.dumps({**document, name: document[name] + 1}))


@pytest.mark.parametrize(
    "change", [None, drop_first_pair, change_bank_of_part, spoil_history, repeat_context, misstate_documents]
)
def test_pieces_of_parts_say_what_all_rows_say(
    change: Callable[[Path], None] | None, copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if change is not None:
        change(copied)
        seal_dataset(copied)
    found = told(copied)
    assert found[0] == ("valid" if change is None else "invalid")
    assert found == on_all_rows(copied, monkeypatch)


LARGE = {"pairs", "state", "past_controls", "expert", "surroundings", "scalars", "trajectories", "candidates"}
"""Tables of which no task on the whole reads a sound release."""


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Parts that are judged, and the tables and rows of several shards that tasks on the whole take."""
    found: dict[str, list[Any]] = {"parts": [], "tables": [], "rows": []}
    column_of, rows_of = StoredFrame.__getitem__, SpooledFrames.__getitem__
    names = {frozenset(column.name for column in LAYER_TABLES[name].columns): name for name in LAYER_TABLES}

    def judged(task: Any) -> Any:
        found["parts"].append(task.part)
        return judge_part(task)

    def column(frame: StoredFrame, name: str) -> Any:
        found["tables"] += [names[frozenset(frame)]] if found["parts"][-1:] == [None] else []
        return column_of(frame, name)

    def rows(frames: SpooledFrames, name: str) -> Any:
        found["rows"] += [name] if found["parts"][-1:] == [None] and len(frames._shards) > 1 else []
        return rows_of(frames, name)

    monkeypatch.setattr(StoredFrame, "__getitem__", column)
    monkeypatch.setattr(SpooledFrames, "__getitem__", rows)
    monkeypatch.setattr("branchdrive.engine.derived.judge_part", judged)
    return found


def test_tasks_on_the_whole_take_no_large_table(two_parts: Path, taken: dict[str, list[Any]]) -> None:
    assert validate(two_parts).verdict == "valid"
    assert taken["parts"][:2] == [0, 1]
    assert not {*taken["tables"]} & LARGE
    assert {*taken["rows"]} == {"routes"}


def test_pieces_of_a_part_that_an_earlier_run_judged_are_taken_from_the_cache(
    copied: Path, tmp_path: Path, taken: dict[str, list[Any]]
) -> None:
    cache = Cache(tmp_path / "cache")
    validate(copied, cache=cache)
    path = table_path("attempts", part=1)
    rows = read(copied, path)
    column = rows.schema.get_field_index("disposition")
    kept = [*rows["disposition"].to_pylist()[::-1]]
    import pyarrow as pa

    rewrite(copied, path, rows.set_column(column, rows.schema.field(column), pa.array(kept, rows.schema.types[column])))
    seal_dataset(copied)
    taken["parts"].clear()
    found = told(copied, cache=cache)
    assert {*taken["parts"]} == {1, None}
    assert not {*taken["tables"]} & LARGE
    assert found == told(copied)
    assert found[0] == "invalid"
