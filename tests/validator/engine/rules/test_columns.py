"""Value and null rules, column by column: every declared limit is met exactly and enforced just beyond."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests import synthetic, synthetic_map
from tests.each import Loop, each
from tests.synthetic import BRANCH_TICK, Plan

from branchdrive.contract.columns import TABLES, Column
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.rule import rules_of
from branchdrive.engine.examine import examine
from branchdrive.engine.finding import Finding
from branchdrive.raw.shard_view import ShardView

VALUE_RULES = {rule_id for rule_id in rules_of("rows") if rule_id.split("-")[1] in ("VAL", "BOX", "NUL")} - {
    "BD-VAL-007"
}
DOCUMENT = synthetic.media_descriptor()
DESCRIPTOR = Descriptor.model_validate({**DOCUMENT, "streams": [*DOCUMENT["streams"], "map"]})
TICK = BRANCH_TICK + 5
STEERED, NOMINAL = "g0.steer_left_0.10.a1", "g0.nominal.a1"


@cache
def small_shard() -> dict[str, pa.Table]:
    """Two attempts of one group, with media and a map, and decisions of drives."""
    planned = [Plan("nominal", "nominal"), Plan("intervention", "steer_left_0.10")]
    frames = synthetic.media_tables()["raw/shard-00000"]["frames"]
    frames = frames.filter(pc.equal(frames["rollout_id"].cast(pa.string()), NOMINAL)).slice(0, 6)
    elements = synthetic_map.map_tables()["raw/shard-00000"]["map"]
    decisions = synthetic.drives_tables()["raw/shard-00000"]["decisions"]
    tables = synthetic.make_group(0, planned, num_ticks=151)
    return {**tables, "map": elements, "frames": frames, "decisions": decisions}


@cache
def place(table: str) -> int:
    """Row that is edited: of the intervention inside its window, where actors and masks are on, or its lane."""
    rows = small_shard()[table].to_pylist()
    if table == "decisions":
        return 0
    if table == "map":
        return next(i for i, row in enumerate(rows) if row["element_id"] == "lane-0")
    wanted = {"rollout_id": NOMINAL if table == "frames" else STEERED}
    if table not in ("rollouts", "frames"):
        wanted["tick"] = str(TICK)
    return next(i for i, row in enumerate(rows) if all(str(row[key]) == value for key, value in wanted.items()))


def findings(table: str, column: str, value: Any, **more: Any) -> list[Finding]:
    """Value and null findings of the small shard with one cell (and `more` cells of its row) replaced.

    Rules on values read each table by itself; of the others, the attempts alone are there.
    """
    rows = small_shard()[table]
    for name, new in {column: value, **more}.items():
        index, field = rows.schema.get_field_index(name), rows.schema.field(name)
        values = rows[name].to_pylist()
        values[place(table)] = new
        if field.type == pa.float32():
            array = pa.array(
                np.array([0 if v is None else v for v in values], np.float32),
                mask=np.array([v is None for v in values]),
            )
        else:
            array = pa.array(values, field.type)
        rows = rows.set_column(index, field.with_nullable(True), array)
    tallies, _ = examine(ShardView({"rollouts": small_shard()["rollouts"], table: rows}, DESCRIPTOR), VALUE_RULES)
    assert not [message for tally in tallies.values() for message in tally.errors]
    return [finding for tally in tallies.values() for finding in tally.findings]


def assert_fails(rule: str, table: str, column: str, value: Any, *also: str, **more: Any) -> None:
    found = findings(table, column, value, **more)
    assert [f for f in found if f.rule == rule and f.location["table"] == table and f.location["column"] == column]
    assert {f.rule for f in found} <= {rule, *also}, [f.message for f in found]


def assert_accepts(table: str, column: str, value: Any) -> None:
    assert [f.message for f in findings(table, column, value)] == []


class Cell(NamedTuple):
    table: str
    column: Column

    def __str__(self) -> str:
        return f"{self.table}.{self.column.name}"


CELLS = [Cell(name, column) for name, table in TABLES.items() for column in table.columns]


def cells(accept: Any) -> Loop:
    chosen = [cell for cell in CELLS if accept(cell.column)]
    assert chosen
    return each("cell", chosen, ids=str)


def is_extent(column: Column) -> bool:
    names = ("length_m", "width_m", "height_m", "ego_length_m", "ego_width_m", "ego_height_m")
    return column.name in names and not column.type.startswith("list")


def is_ranged(column: Column) -> bool:
    return column.min is not None or column.max is not None


def wrap(cell: Cell, number: Any) -> Any:
    """A number as the column holds it; in a polyline it is that of the first of two vertices."""
    return [number, 5.0] if cell.column.type.startswith("list") else number


def beside(cell: Cell) -> dict[str, Any]:
    """Other cells of the row, such that this one may have any value at all."""
    available = cell.column.available
    if cell.column.name.startswith("route_") and cell.column.type.startswith("list"):
        return {"route_y_m" if cell.column.name == "route_x_m" else "route_x_m": [0.0, 1.0]}
    if available is None:
        return {}
    if available.mask:
        governed = [c for c in TABLES[cell.table].columns if c.available and c.available.mask == available.mask]
        return {
            available.mask: True,
            **{c.name: "red" if c.type == "string" else 1 for c in governed if c != cell.column},
        }
    return {"valued": {str(available.rule): "absolute"}, "not_complete": {"status": "partial"}}.get(
        str(available.when), {}
    )


def beyond(column: Column) -> Iterator[Any]:
    """The representable numbers next to the range, on either side."""
    for limit, side in ((column.min, -math.inf), (column.max, math.inf)):
        if limit is None:
            continue
        if "int" in column.type:
            bits = 8 * np.dtype(column.type).itemsize - 1
            step = int(limit) + (1 if side > 0 else -1)
            if -(2**bits) <= step < 2**bits:
                yield step
        else:
            kind = np.float32 if column.type == "float32" else np.float64
            outside = kind(limit)
            while -math.inf < outside < math.inf and (outside <= limit if side > 0 else outside >= limit):
                outside = np.nextafter(outside, kind(side))
            yield float(outside)


@cells(lambda c: "float" in c.type and not is_extent(c))
@each("number", [math.nan, math.inf, -math.inf], ids=str)
def test_not_finite(cell: Cell, number: float) -> None:
    assert_fails("BD-VAL-001", cell.table, cell.column.name, wrap(cell, number), **beside(cell))


@cells(is_ranged)
def test_ends_of_the_range(cell: Cell) -> None:
    column = cell.column
    for limit in (column.min, column.max):
        if limit is not None and column.name != "ttc_s":
            value = wrap(cell, limit)
            assert [f.message for f in findings(cell.table, column.name, value, **beside(cell))] == []


@cells(is_ranged)
def test_next_numbers_beyond_the_range(cell: Cell) -> None:
    for number in beyond(cell.column):
        assert_fails("BD-VAL-002", cell.table, cell.column.name, wrap(cell, number), "BD-NUL-005", **beside(cell))


@cells(lambda c: c.values)
def test_words_outside_the_vocabulary(cell: Cell) -> None:
    # A word that means nothing can also change which conditional columns must be there.
    for word in ("other", "", cell.column.values[0].upper(), f"{cell.column.values[0]} "):
        assert_fails("BD-VAL-003", cell.table, cell.column.name, word, "BD-NUL-004", **beside(cell))


@cells(lambda c: c.values)
def test_words_of_the_vocabulary(cell: Cell) -> None:
    for word in cell.column.values:
        found = findings(cell.table, cell.column.name, word, **beside(cell))
        assert {f.rule for f in found} <= {"BD-NUL-004"}


GOOD_TEXT = {
    "id": ["a", "0", "a" * 128, "a.b_c-d"],
    "name": ["A", "0", "a" * 128, "Town 12/x:y+z"],
    "label": ["A", ":J0_0_0", "-E12_0", "123#1_0", "('>', '>>', 0)", "Town04_Route12", "a" * 128, "~ !"],
    "file": ["_", "A.jpg", "a" * 128],
    "checksum": ["0123456789abcdef"],
    "text": [" ", "ü", "x" * 1000, "a, b; c."],
}
BAD_TEXT = {
    "id": ["", "A", ".a", "a b", "a\n", "a" * 129, "ü", "a/b"],
    "name": ["", " a", "a\n", "a" * 129, "a\x00", "ü", "a;b"],
    "label": ["", " a", "a ", "a\n", "\na", "a" * 129, "a\x00b", "\x1b[31m", "a\x7f", "ü", "\u202eab", "a\tb"],
    "file": ["", ".hidden", "../a", "a/b", "a\n", "a" * 129],
    "checksum": ["", "0123456789ABCDEF", "0123456789abcde", "0123456789abcdef\n"],
    "text": ["", "a\nb", "a\n", "\x1b[31m", "a\x7f", "a\x9f", "x" * 1001],
}


@cells(lambda c: c.pattern)
def test_text_like_its_pattern(cell: Cell) -> None:
    for text in GOOD_TEXT[str(cell.column.pattern)]:
        assert findings(cell.table, cell.column.name, text, **beside(cell)) == [], text


@cells(lambda c: c.pattern)
def test_text_unlike_its_pattern(cell: Cell) -> None:
    for text in BAD_TEXT[str(cell.column.pattern)]:
        assert_fails("BD-VAL-004", cell.table, cell.column.name, text, **beside(cell))


@cells(lambda c: not c.nullable)
def test_null_where_a_value_must_be(cell: Cell) -> None:
    # What depends on the missing value fails with it: a mask, a condition, a route, a box.
    also = {"BD-NUL-002", "BD-NUL-003", "BD-NUL-004"}
    also |= {"BD-VAL-005"} if cell.column.name.startswith("route_") else set()
    also |= {"BD-BOX-001"} if is_extent(cell.column) else set()
    assert_fails("BD-NUL-001", cell.table, cell.column.name, None, *also)


@cells(lambda c: c.available and c.available.when == "recorded")
def test_null_where_the_world_offers_a_value(cell: Cell) -> None:
    assert_fails("BD-NUL-006", cell.table, cell.column.name, None)


@cells(lambda c: c.available and c.available.mask)
def test_value_against_its_mask(cell: Cell) -> None:
    mask = str(cell.column.available.mask) if cell.column.available else ""
    row = small_shard()[cell.table].to_pylist()[place(cell.table)]
    governed = {c.name: None for c in TABLES[cell.table].columns if c.available and c.available.mask == mask}
    value = "red" if cell.column.type == "string" else 1
    assert_fails(
        "BD-NUL-002", cell.table, cell.column.name, value, **{**governed, mask: False, cell.column.name: value}
    )
    if row[mask]:
        assert_fails("BD-NUL-002", cell.table, cell.column.name, None)


@cells(lambda c: c.available and c.available.when == "active")
def test_policy_value_against_the_window(cell: Cell) -> None:
    assert_fails("BD-NUL-003", cell.table, cell.column.name, None)
    off = {c.name: None for c in TABLES["controls"].columns if c.available}
    value = small_shard()["controls"][cell.column.name][place("controls")].as_py()
    assert_fails("BD-NUL-003", cell.table, cell.column.name, value, **{**off, "active": False, cell.column.name: value})


@cells(lambda c: c.available and c.available.when == "branched" and c.name != "branch_tick")
def test_branch_column_against_the_branch(cell: Cell) -> None:
    assert_fails("BD-NUL-004", cell.table, cell.column.name, None)
    off = {c.name: None for c in TABLES["rollouts"].columns if c.available and c.available.when == "branched"}
    value = small_shard()["rollouts"][cell.column.name][place("rollouts")].as_py()
    assert_fails("BD-NUL-004", cell.table, cell.column.name, value, **{**off, cell.column.name: value})
    assert findings("rollouts", "branch_tick", None, **off) == []


@cells(lambda c: c.available and c.available.when == "valued")
def test_rule_value_against_its_rule(cell: Cell) -> None:
    rule = str(cell.column.available.rule) if cell.column.available else ""
    for word in TABLES["rollouts"][rule].values:
        carries = word in ("absolute", "floor")
        assert findings("rollouts", rule, word, **{cell.column.name: 0.5 if carries else None}) == []
        assert_fails("BD-NUL-004", "rollouts", cell.column.name, None if carries else 0.5, **{rule: word})


def test_nominal_reference_against_the_role() -> None:
    assert_fails("BD-NUL-004", "rollouts", "nominal_rollout_id", None)
    assert findings("rollouts", "role", "nominal", nominal_rollout_id=None) == []
    assert_fails("BD-NUL-004", "rollouts", "nominal_rollout_id", NOMINAL, role="nominal")


def test_reason_against_the_status() -> None:
    for status in ("partial", "quarantined"):
        assert findings("rollouts", "status", status, status_reason="stuck") == []
        assert_fails("BD-NUL-004", "rollouts", "status_reason", None, status=status)
    assert_fails("BD-NUL-004", "rollouts", "status_reason", "well")


@cells(lambda c: c.available and c.available.when == "optional")
def test_optional_column_may_be_null_or_not(cell: Cell) -> None:
    assert_accepts(cell.table, cell.column.name, None)
    word = next(iter(cell.column.values), "road1:-1")
    value = word if cell.column.type == "string" else wrap(cell, cell.column.min or 0)
    assert_accepts(cell.table, cell.column.name, value)


@cells(is_extent)
def test_box_extents(cell: Cell) -> None:
    for extent in (
        0.0,
        -0.0,
        -1.0,
        math.nan,
        math.inf,
        -math.inf,
        float(np.nextafter(np.float32(100), np.float32(101))),
    ):
        assert_fails("BD-BOX-001", cell.table, cell.column.name, extent)
    for extent in (100.0, 1e-45, 1.0):
        assert_accepts(cell.table, cell.column.name, extent)


@pytest.mark.parametrize("ttc_s", [0.0, 1e-300, 499.9, 500.0])
def test_possible_times_to_collision(ttc_s: float) -> None:
    assert_accepts("evidence", "ttc_s", ttc_s)


@pytest.mark.parametrize("ttc_s", [float(np.nextafter(500.0, 501.0)), 999.0, 1e9, 1e308])
def test_impossible_times_to_collision(ttc_s: float) -> None:
    assert_fails("BD-NUL-005", "evidence", "ttc_s", ttc_s)


def test_every_column_with_a_condition_has_a_test() -> None:
    conditions = {c.available.when for _, c in CELLS if c.available and c.available.when}
    assert conditions == {"active", "branched", "valued", "not_nominal", "not_complete", "recorded", "optional"}


@pytest.mark.parametrize(
    ("xs", "ys"),
    [
        ([0.0], [0.0]),
        ([], []),
        ([0.0, 1.0], [0.0]),
        ([0.0], [0.0, 1.0]),
        ([0.0, 0.0], [1.0, 1.0]),
        ([0.0, 1.0, 1.0], [0.0] * 3),
    ],
)
def test_routes_that_are_no_polyline(xs: list[float], ys: list[float]) -> None:
    assert_fails("BD-VAL-005", "rollouts", "route_x_m", xs, route_y_m=ys)


@pytest.mark.parametrize(("xs", "ys"), [([0.0, 0.0], [0.0, 1e-300]), ([0.0, 1.0, 0.0], [0.0] * 3)])
def test_routes_that_are_just_polylines(xs: list[float], ys: list[float]) -> None:
    assert findings("rollouts", "route_x_m", xs, route_y_m=ys) == []
