"""What was looked at, as text for people: one screen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from branchdrive.contract.columns import Table as Declared
from branchdrive.contract.text import NONE, counted, printable, size_text
from branchdrive.contract.timing import TICK_S
from branchdrive.inspection.columns import stored_columns
from branchdrive.inspection.loading import Lines, loading, loading_files
from branchdrive.inspection.overview import Overview
from branchdrive.inspection.place import StoredFile
from branchdrive.inspection.table_files import MOST_SHARDS, TableFiles
from branchdrive.text.table import Column, Table
from branchdrive.text.terminal import print_facts, print_section

__all__ = ["print_file", "print_group", "print_overview", "print_table"]

_NAMED = 40
"""Scenario types, towns and the like that are named with their counts."""

_LIBRARY_WIDTH = 12

_SEVERAL = {"actor_id": "actor", "camera": "camera", "element_id": "element"}
"""What a tick, an observation or a town has several of, by its column of the key."""


def print_overview(console: Console, found: Overview) -> None:
    """A dataset: what it is, its groups, its tables, and how to load them."""
    _print_title(console, f"{found.descriptor.dataset_id} {found.descriptor.dataset_version}", found.kind)
    print_facts(console, [fact for fact in _facts(found) if fact[1]])
    console.print()
    print_section(console, _table_of_tables(found))
    _print_faults(console, found.faults)
    _print_loading(console, loading(found))
    root = printable(str(found.dataset))
    _print_next(console, f"branchdrive inspect {root} TABLE", f"branchdrive inspect {root} GROUP", found)


def print_table(console: Console, found: Overview, files: TableFiles, rows: Any) -> None:
    """A table of a dataset: its columns, and what the rows of its first file hold."""
    _print_title(console, f"table {files.table.name}", files.table.title)
    size = f"{_rows(files)} rows in {counted(len(files.files), 'file')}, {size_text(files.num_bytes)}"
    first = files.files[0].path
    print_facts(console, [
        ("layer", files.layer), ("one row per", _rate(files.table)), ("key", ", ".join(files.table.key)),
        ("holds", size),
    ])  # fmt: skip
    console.print()
    print_section(console, _columns(f"Values of the {counted(len(rows), 'row')} of {first}", rows, files.table))
    _print_loading(console, loading(found, files.table.name))


def print_file(console: Console, found: StoredFile) -> None:
    """A file: what it is, and the columns of a table."""
    _print_title(console, str(found.path), found.what)
    facts = [("size", size_text(found.num_bytes)), ("dataset", str(found.root or "in none"))]
    if found.rows is None:
        print_facts(console, facts)
        return
    print_facts(console, [*facts, ("rows", f"{len(found.rows):,}")])
    console.print()
    print_section(console, _columns("Columns", found.rows, found.declared))
    _print_loading(console, loading_files(str(found.path)))


def print_group(console: Console, group_id: str, context: Mapping[str, Any], records: Sequence[dict[str, Any]]) -> None:
    """A branch group: what it is, and how each attempt ended."""
    _print_title(console, f"group {group_id}", f"{_kind(records)} with {counted(len(records), 'attempt')}")
    names = ("scenario_type", "town", "route_id", "environment", "seed", "repetition", "partition", "lost_rules")
    facts = [(name.replace("_", " "), _text(context.get(name))) for name in names]
    tick = context.get("branch_tick")
    facts.append(("branch", NONE if tick is None else f"tick {tick}, {tick * TICK_S:.2f} s after the start"))
    print_facts(console, [(name, text) for name, text in facts if text not in ("", NONE)])
    if records:
        console.print()
        print_section(console, _attempts(records))


def _kind(records: Sequence[Mapping[str, Any]]) -> str:
    return "group of drives" if any(record["role"] == "drive" for record in records) else "branch group"


def _print_title(console: Console, title: str, what: str) -> None:
    console.print(Text(printable(title), style="bold"), Text(printable(what), style="dim"))


def _facts(found: Overview) -> Iterator[tuple[str, str]]:
    about = found.descriptor
    tools = (f"{software.name} {software.version}" for software in (about.collector, about.simulator))
    first = "" if found.is_all else f"the first {MOST_SHARDS} of "
    shards = f" in {first}{counted(found.num_shards, 'shard')}" if found.num_shards else ""
    yield "at", str(found.dataset)
    yield "title", about.title
    yield "licence", about.licence
    yield "made by", " in ".join(tools)
    yield "layers", ", ".join(about.layers)
    yield "streams", ", ".join(about.streams)
    yield "identity", found.manifest.identity if found.manifest else ""
    kind = "group" if about.is_of_drives else "branch group"
    of_drives = " of drives" if about.is_of_drives else ""
    yield "groups", counted(len(found.contexts), kind) + of_drives + shards
    yield "partitions", _counts(found.partitions)
    for column, title in (("scenario_type", "scenario types"), ("town", "towns")):
        counts = found.count(column)
        yield title if len(counts) < 2 else f"{len(counts)} {title}", _counts(counts)


def _counts(counts: Mapping[str, int]) -> str:
    """Names with their counts; one count for all that have the same."""
    is_even = len(counts) > 1 and len({*counts.values()}) == 1
    named = [name if is_even else f"{name} ({count:,})" for name, count in [*counts.items()][:_NAMED]]
    more = [f"and {len(counts) - _NAMED} more"] if len(counts) > _NAMED else []
    each = f"{counted(next(iter(counts.values())), 'group')} each of " if is_even else ""
    return each + ", ".join(named + more)


def _table_of_tables(found: Overview) -> Table:
    columns = [
        Column.name("layer"), Column.name("table", is_code=True), Column("rows"), Column("files"), Column("size"),
        Column("one row per", is_text=True),
    ]  # fmt: skip
    rows = [
        [one.layer, one.table.name, _rows(one), str(len(one.files)), size_text(one.num_bytes), _rate(one.table)]
        for one in found.tables
    ]  # fmt: skip
    if found.media:
        size = size_text(sum(entry.size for entry in found.media))
        rows.append(["raw", "(images)", "", str(len(found.media)), size, ""])
    notes = () if found.is_all else (f"Files of the first {MOST_SHARDS} of {found.num_shards:,} shards.",)
    return Table("Tables", columns, rows, notes)


def _rate(table: Declared) -> str:
    """What has a row: a tick or an observation of an attempt, where a rate is declared, and several of each."""
    of = {"20 Hz": "tick", "4 Hz": "observation"}.get(table.rate, table.rate.removeprefix("per "))
    return " and ".join([of, *(_SEVERAL[name] for name in table.key if name in _SEVERAL)])


def _rows(files: TableFiles) -> str:
    return NONE if files.num_rows is None else f"{files.num_rows:,}" + ("" if files.is_all else "+")


def _columns(title: str, rows: Any, declared: Declared | None) -> Table:
    columns = [
        Column.name("column", is_code=True), Column("type", is_text=True), Column("unit", is_text=True),
        Column("track", is_text=True), Column("null"), Column("values", is_text=True),
    ]  # fmt: skip
    found = stored_columns(rows, declared)
    return Table(title, columns, [[one.name, one.type, one.unit, one.track, one.nulls, one.values] for one in found])


_EVENTS = {
    "vehicles hit": "result_num_vehicle_collisions", "pedestrians hit": "result_num_pedestrian_collisions",
    "objects hit": "result_num_static_collisions", "times off road": "result_num_off_road_infractions",
    "red lights": "result_num_red_light_infractions", "stop signs": "result_num_stop_sign_infractions",
}  # fmt: skip
"""What may happen on a route, by the column that counts it."""


_NOTES = {"nominal_replay": " (replay)", "drive": " (drive)"}
"""What tells attempts of a policy apart, by their role."""


def _attempts(records: Iterable[Mapping[str, Any]]) -> Table:
    columns = [
        Column.name("policy", is_code=True), Column("attempt"), Column("status", is_text=True),
        Column("end", is_text=True), Column("route"), Column("on its way", is_text=True),
    ]  # fmt: skip
    rows = [
        [str(record["action_key"]) + _NOTES.get(record["role"], ""),
         str(record["attempt"]), str(record["status"]), str(record["result_completion"]),
         _text(record["result_route_fraction"]), _events(record)]
        for record in records
    ]  # fmt: skip
    return Table("Attempts, and how their whole drive went", columns, rows)


def _events(record: Mapping[str, Any]) -> str:
    return ", ".join(f"{record[column]} {what}" for what, column in _EVENTS.items() if record[column])


def _text(value: object) -> str:
    return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


def _print_faults(console: Console, faults: Sequence[str]) -> None:
    shown = 3
    for fault in faults[:shown]:
        console.print(Text(f"Not read: {printable(fault)}", style="yellow"))
    if len(faults) > shown:
        console.print(Text(f"and {len(faults) - shown} more; `branchdrive-validate` finds all", style="yellow"))


def _print_loading(console: Console, found: Iterable[Lines]) -> None:
    lines = [fact for one in found for fact in zip((one.library, ""), one.lines, strict=True)]
    if lines:
        console.print()
        console.print(Text("Load it", style="bold"))
    for library, line in lines:  # never folded: they are there to be copied
        console.print(Text(f"{library:<{_LIBRARY_WIDTH}}", style="dim") + Text(printable(line)), soft_wrap=True)


def _print_next(console: Console, table: str, group: str, found: Overview) -> None:
    console.print()
    facts = [("a table", table), ("a group", group)] if found.contexts else [("a table", table)]
    if found.manifest is None and found.is_staged:
        facts.append(("go on", f"branchdrive staging {printable(str(found.dataset))}"))
    print_facts(console, facts)
