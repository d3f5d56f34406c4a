"""What a collection takes: bytes as the pilot has them, time as runs of the command measured it."""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import NONE, counted, size_text
from branchdrive.files.survey import take_survey
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.reruns import NO_COMMAND, Reruns
from branchdrive.pilot.section import Section
from branchdrive.text.table import Column, Table

__all__ = ["cost"]

_TITLE = "Storage and time"


def cost(pilot: Pilot, reruns: Reruns | None) -> Section:
    """Bytes of every table, and time of collecting and validating, per 1,000 groups and of the collection wanted."""
    if not pilot.parts or not pilot.num_groups:
        return Section("cost", _TITLE, not_examined=[pilot.unread or "the dataset holds no group"])
    sizes: dict[str, int] = {}
    for entry in take_survey(pilot.dataset, hash_files=False).files:
        name = entry.path.rsplit("/", 1)[-1] if entry.path.endswith(".parquet") else _kind(entry.path)
        sizes[name] = sizes.get(name, 0) + entry.size
    total = sum(sizes.values())
    rows = [
        [name, size_text(size), size_text(round(size / pilot.num_groups * 1000)), f"{100 * size / total:.0f} %"]
        for name, size in [*sorted(sizes.items(), key=lambda item: -item[1]), ("all", total)]
    ]
    heads = [Column.name("Files"), Column("Pilot"), Column("1,000 groups"), Column("Share")]
    note = "What is there once for all groups, such as a map, is counted for every group: an upper bound."
    wanted = round(total / pilot.num_groups * pilot.num_wanted)
    facts = [f"{counted(pilot.num_wanted, 'group')} take about {size_text(wanted)} on disk.", _shard_fact(pilot)]
    figures: dict[str, float | int | None] = {
        "bytes_per_group": total / pilot.num_groups,
        "validation_s_per_group": pilot.validation_s / pilot.num_groups,
        "collection_s_per_group": None,
    }
    facts.append(
        f"Validation took {pilot.validation_s:.1f} s, {_long(pilot.validation_s / pilot.num_groups * 1000)} for 1,000 "
        "groups in one process."
    )
    not_examined = []
    if reruns is None:
        not_examined.append(f"time of the collection: {NO_COMMAND}")
    elif reruns.fresh.failure is not None:
        not_examined.append(f"time of the collection: the command {reruns.fresh.failure}")
    else:
        each_s = reruns.fresh.seconds / pilot.num_groups
        figures["collection_s_per_group"] = each_s
        facts.append(
            f"The command took {reruns.fresh.seconds:.1f} s for {counted(pilot.num_groups, 'group')}, its start "
            f"included: {_long(1000 * each_s)} for 1,000 groups, {_long(pilot.num_wanted * each_s)} for "
            f"{pilot.num_wanted:,}, on this machine as it is loaded now."
        )
    return Section(
        "cost", _TITLE, facts, tables=[Table("Storage", heads, rows, [note], has_total=True)],
        not_examined=not_examined, figures=figures,
    )  # fmt: skip


def _kind(path: str) -> str:
    return "media" if path.startswith("raw/") else "documents"


def _shard_fact(pilot: Pilot) -> str:
    """How many groups a shard may hold before a limit of the specification is met."""
    limits, most = spec_limits(), list[tuple[int, str]]()
    for name, rows, decoded in _table_sizes(pilot):
        if rows and decoded:
            most.append((int(limits.max_table_rows * pilot.num_groups / rows), f"rows of {name}"))
            most.append((int(limits.max_table_decoded_bytes * pilot.num_groups / decoded), f"decoded bytes of {name}"))
    groups, what = min(most, default=(0, NONE))
    return f"A shard may hold about {groups:,} groups like these; the limit on {what} is met first."


def _table_sizes(pilot: Pilot) -> Iterator[tuple[str, int, int]]:
    for name in pilot.descriptor.tables:
        tables = [part.view[name].arrow for part in pilot.parts]
        yield name, sum(table.num_rows for table in tables), sum(table.nbytes for table in tables)


def _long(seconds: float) -> str:
    """A time of any length in its own unit."""
    for unit, length_s in (("days", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * length_s:
            return f"{seconds / length_s:.1f} {unit}"
    return f"{seconds:.0f} s"
