"""Defects and limits of what files of derived layers hold: keys, values, nulls, order and places of rows."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from tests.synthetic_release import TWINS
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.layers import GROUPS, rewrite
from tests.validator.engine.rules.release import VARIANTS, ReleaseDraft

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import part_of, table_path
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import parts_of
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.testing.defect import with_cells

# BD-LYR-006


@mutant("BD-LYR-006", at={"file": GROUPS, "table": "group_quality", "group_id": "g13"})
def group_listed_in_two_partitions(d: ReleaseDraft) -> None:
    d.duplicate("group_quality", {"partition": "train"}, group_id="g13")
    d.sort("group_quality")


@mutant("BD-LYR-006", at={"table": "records", "group_id": "g2", "action_key": "brake_0.50"})
def two_records_of_an_action(d: ReleaseDraft) -> None:
    d.duplicate("records", {"rollout_id": "g2.brake_0.50.a2", "attempt": 2}, group_id="g2", action_key="brake_0.50")
    d.sort("records")


@mutant("BD-LYR-006", at={"table": "state", "group_id": "g0", "offset_ticks": -10})
def history_row_twice(d: ReleaseDraft) -> None:
    d.duplicate("state", group_id="g0", offset_ticks=-10)
    d.sort("state")


# BD-LYR-007


@mutant("BD-LYR-007", at={"table": "state", "column": "rel_x_m", "group_id": "g0", "offset_ticks": -10})
def history_that_is_no_number(d: ReleaseDraft) -> None:
    d.set("state", "rel_x_m", float("nan"), group_id="g0", offset_ticks=-10)


@mutant("BD-LYR-007", at={"table": "pairs", "column": "speed_mps", "rollout_id": "g13.brake_0.50.a1"})
def negative_discrepancy(d: ReleaseDraft) -> None:
    d.set("pairs", "speed_mps", -0.001, rollout_id="g13.brake_0.50.a1")


@mutant("BD-LYR-007", at={"table": "attempts", "column": "disposition", "rollout_id": "g8.brake_0.50.a1"})
def disposition_in_own_words(d: ReleaseDraft) -> None:
    d.set("attempts", "disposition", "lost", rollout_id="g8.brake_0.50.a1")


@mutant("BD-LYR-007", at={"table": "group_quality", "column": "lost_rules", "group_id": "g3"})
def rules_separated_by_commas(d: ReleaseDraft) -> None:
    d.set("group_quality", "lost_rules", "BD-BNK-001,BD-BNK-002", group_id="g3")


# BD-LYR-008


@mutant("BD-LYR-008", at={"table": "group_quality", "column": "partition", "group_id": "g13"})
def partition_missing_under_its_mask(d: ReleaseDraft) -> None:
    d.set("group_quality", "partition", None, group_id="g13")


@mutant("BD-LYR-008", at={"table": "attempt_quality", "column": "failed_rules", "rollout_id": "g9.brake_0.50.a1"})
def mask_off_above_a_value(d: ReleaseDraft) -> None:
    d.set("attempt_quality", "fails", False, rollout_id="g9.brake_0.50.a1")


@mutant("BD-LYR-008", at={"table": "scalars", "column": "mean_jerk_mps3", "group_id": "g0"})
def target_without_its_mask(d: ReleaseDraft) -> None:
    d.set("scalars", "mean_jerk_available", False, group_id="g0", action_key="nominal")


@mutant("BD-LYR-008", at={"table": "contexts", "column": "town", "group_id": "g0"})
def required_column_with_a_null(d: ReleaseDraft) -> None:
    d.set("contexts", "town", None, group_id="g0")


@mutant("BD-LYR-008", at={"table": "state", "column": "offset_ticks", "row": 15})
def key_with_a_null(d: ReleaseDraft) -> None:
    d.set("state", "offset_ticks", None, group_id="g0", offset_ticks=0)


@mutant("BD-LYR-008", at={"file": "model/scalars-val-00000.parquet", "column": "group_id", "row": 0})
def key_with_a_null_in_a_later_file(d: ReleaseDraft) -> None:
    """Files of one table, of which one alone declares that the column may be null."""

    def clear(content: bytes) -> bytes:
        return encode_table(with_cells(decode_table(content, "scalars"), "group_id", {0: None}))

    rewrite(d, "model/scalars-val-00000.parquet", clear)


@mutant("BD-LYR-008", at={"table": "pairs", "column": "rollout_id", "row": 0})
def key_text_with_a_null(d: ReleaseDraft) -> None:
    first = d.take("pairs", kind="intervention")["rollout_id"][0].as_py()
    d.set("pairs", "rollout_id", None, rollout_id=first)


# BD-LYR-009


@mutant("BD-LYR-009", at={"table": "contexts", "group_id": "g9"})
def contexts_in_reverse(d: ReleaseDraft) -> None:
    d.map_table("contexts", lambda rows: rows.take(list(range(len(rows)))[::-1]), folder="model")


@mutant("BD-LYR-009", at={"table": "actions", "action_key": "accelerate_0.30"})
def actions_in_alphabetical_order(d: ReleaseDraft) -> None:
    d.map_table("actions", lambda rows: rows.sort_by("action_key"), folder="model")


@mutant("BD-LYR-009", at={"table": "group_quality", "group_id": TWINS[1]})
def two_rows_exchanged(d: ReleaseDraft) -> None:
    def exchange(rows: pa.Table) -> pa.Table:
        order = list(range(len(rows)))
        first = rows["group_id"].to_pylist().index(TWINS[0])
        order[first], order[first + 1] = order[first + 1], order[first]
        return rows.take(order)

    d.map_table("group_quality", exchange, folder="quality")


# BD-LYR-010


def _swap(d: ReleaseDraft, table: str, one: str, other: str) -> None:
    """Give two partitions of a table each other's file."""

    def swap(root: Path) -> None:
        paths = [root / table_path(table, partition) for partition in (one, other)]
        contents = [path.read_bytes() for path in paths]
        for path, content in zip(paths, reversed(contents), strict=True):
            path.write_bytes(content)

    d.before_seal(swap)


@mutant("BD-LYR-010", at={"file": table_path("scalars", "test"), "column": "partition", "row": 0}, findings=2)
def files_of_two_partitions_exchanged(d: ReleaseDraft) -> None:
    _swap(d, "scalars", "test", "val")


@mutant("BD-LYR-010", at={"file": table_path("state", "calibration"), "column": "partition", "row": 0})
def rows_in_the_file_of_a_partition_without_groups(d: ReleaseDraft) -> None:
    def move(root: Path) -> None:
        full, empty = (root / table_path("state", partition) for partition in ("val", "calibration"))
        content = full.read_bytes()
        full.write_bytes(empty.read_bytes())
        empty.write_bytes(content)

    d.before_seal(move)


_PARTS = {"raw/shard-00001": "raw/shard-00063", "raw/shard-00002": "raw/shard-00064"}
"""Folders of shards by their former names: neighbours, the second of which is of another part."""


def _renumber(root: Path) -> None:
    """Give shards other numbers, which the rows that name them have too."""
    for old, new in reversed(_PARTS.items()):
        (root / old).rename(root / new)
    for name in ("records", "media_index"):
        for partition in LAYER_TABLES[name].partitions or (None,):
            path = root / table_path(name, partition)
            rows = pq.read_table(path)
            place = rows.schema.get_field_index("shard")
            folders = [_PARTS.get(shard, shard) for shard in rows["shard"].to_pylist()]
            named = pa.array(folders, pa.string())
            path.write_bytes(encode_table(rows.set_column(place, rows.schema.field(place), named)))


def _divide(root: Path) -> None:
    """Give shards other numbers, and put the rows of their groups into the parts of these."""
    _renumber(root)
    records = pq.read_table(root / table_path("records")).to_pylist()
    parts = {row["group_id"]: part_of(row["shard"]) for row in records if row["shard"] is not None}
    for name, table in LAYER_TABLES.items():
        for partition in table.partitions or (None,):
            path = root / table_path(name, partition)
            if table.is_of_groups and path.exists():
                rows = pq.read_table(path)
                path.unlink()
                for file, part in parts_of(name, rows, parts).items():
                    if len(part) or file == table_path(name, partition):
                        (root / file).write_bytes(encode_table(part))


@boundary(
    "BD-LYR-010", "BD-LYR-001", "BD-LYR-009", "BD-CAN-001", "BD-QUA-003", "BD-FID-001", "BD-MOD-003", "BD-MOD-015"
)
def release_of_two_parts(d: ReleaseDraft) -> None:
    d.before_seal(_divide)


@mutant("BD-LYR-010", at={"file": table_path("records"), "column": "shard"})
def records_in_the_part_of_another_shard(d: ReleaseDraft) -> None:
    d.before_seal(_renumber)


@mutant("BD-LYR-010", at={"file": table_path("attempt_quality", part=1), "column": "group_id", "row": 0})
def rows_of_another_part(d: ReleaseDraft) -> None:
    def move(root: Path) -> None:
        _divide(root)
        first, second = (root / table_path("attempt_quality", part=part) for part in (0, 1))
        rows, others = pq.read_table(first), pq.read_table(second)
        second.write_bytes(encode_table(pa.concat_tables([rows.slice(0, 1), others]).sort_by("rollout_id")))
        first.write_bytes(encode_table(rows.slice(1)))

    d.before_seal(move)


@mutant("BD-LYR-010", at={"file": table_path("scalars", "train", 3)})
def part_without_rows(d: ReleaseDraft) -> None:
    def add(root: Path) -> None:
        rows = pq.read_table(root / table_path("scalars", "train"))
        (root / table_path("scalars", "train", 3)).write_bytes(encode_table(rows.slice(0, 0)))

    d.before_seal(add)


@mutant("BD-LYR-001", at={"file": table_path("pairs")})
def table_without_a_part(d: ReleaseDraft) -> None:
    d.before_seal(lambda root: (root / table_path("pairs")).unlink())


# BD-LYR-011


def _declare(d: ReleaseDraft, title: str) -> None:
    """Declare a further variant."""
    d.documents[VARIANTS]["variants"].append({"name": "screened", "title": title, "where": {"core_valid": True}})
    d.reseal("variants")


@mutant("BD-LYR-011", at={"table": "records", "column": "provenance", "group_id": "g2"}, base="alone")
def provenance_of_a_record_with_a_path(d: ReleaseDraft) -> None:
    text = "replayed from /srv/ada/runs/17"
    d.set("records", "provenance", text, group_id="g2", action_key="brake_0.50")


@mutant("BD-LYR-011", at={"file": VARIANTS, "pointer": "/variants/1/title"})
def title_of_a_variant_with_a_host_and_a_time(d: ReleaseDraft) -> None:
    _declare(d, "declared by ada@node7, 2026-03-01T12:30")


@boundary("BD-LYR-011", base="alone")
def texts_of_a_release_that_look_like_paths_and_times(d: ReleaseDraft) -> None:
    text = "maps/Town10/route 3, 5 km/h at 12:30, built 2026-03-01, see https://a.b/c/d"
    d.set("records", "provenance", text, group_id="g2", action_key="brake_0.50")
    _declare(d, text)
