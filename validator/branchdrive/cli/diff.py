"""`branchdrive diff`: what tells two datasets apart, in their files, their claims and their data."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TextIO

from branchdrive.cli.links import add_link_arguments
from branchdrive.cli.place import place
from branchdrive.contract.text import counted, printable

if TYPE_CHECKING:
    from branchdrive.diff.difference import DatasetDifference, TableDifference

SUMMARY = "tell two datasets apart by what they say"
ORDER = 100

_SHOWN = 10
"""Lines of a list that the text names."""

_TITLES = {"quality/population.json": "population", "quality/split.json": "split"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("first", metavar="A", type=place, help="a dataset")
    parser.add_argument("second", metavar="B", type=place, help="another dataset, or the same from elsewhere")
    parser.add_argument("--format", choices=("text", "json"), default="text", help="what to print (default: text)")
    add_link_arguments(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Compare and print; 0 where all data are equal, 1 where they differ.

    Raises:
        DatasetError: One of the datasets cannot be read.
    """
    from branchdrive.diff.compare import compare_datasets
    from branchdrive.formats.place import open_store

    first, second = (
        open_store(root, follow_links=args.follow_links, allow=args.allow) for root in (args.first, args.second)
    )
    found = compare_datasets(first, second)
    if args.format == "json":
        stdout.write(json.dumps(_document(found), indent=2, sort_keys=True, allow_nan=False) + "\n")
    else:
        stdout.write("".join(f"{printable(line)}\n" for line in _lines(found)))
    return 0 if found.has_equal_data else 1


def _document(found: DatasetDifference) -> dict[str, Any]:
    differing, only_first, only_second = found.files
    return {
        **asdict(found),
        "files": {"differing": differing, "only_first": only_first, "only_second": only_second},
        "data": "equal" if found.has_equal_data else "differ",
    }


def _lines(found: DatasetDifference) -> Iterator[str]:
    files = "files differ" if any(found.files) else "files equal by their manifests"
    claims = ", descriptor differs" if found.descriptor else ""
    yield f"{files}{claims}, data {'equal' if found.has_equal_data else 'differ'}"
    differing, only_first, only_second = found.files
    if any(found.files):
        differ = "differs" if differing == 1 else "differ"
        yield f"  {counted(differing, 'file')} {differ}, {only_first} only in A, {only_second} only in B"
    elif not found.has_equal_data:
        yield "  a file is not what its manifest lists; run branchdrive-validate on both"
    for side, names in zip("AB", found.beside, strict=True):
        yield from _listed(f"beside the dataset, only in {side}", names)
    yield from _listed("descriptor (A, not B)", found.descriptor)
    yield from _listed("layers in one alone", found.layers)
    yield from _listed("attempts only in A", found.only_first)
    yield from _listed("attempts only in B", found.only_second)
    yield from _listed("attempts whose data differ", found.changed)
    yield from _listed("towns whose maps differ", found.towns)
    for path, members in found.documents.items():
        yield from _listed(f"{_TITLES.get(path, path)} (A, not B)", members)
    for name, table in found.tables.items():
        yield f"table {name}: {_counts(table)}"
        yield from _first_lines(_of_table(table))


def _counts(table: TableDifference) -> str:
    """How many rows one dataset alone has, and how many cells of how many columns differ."""
    num_rows, num_cells = table.only_first + table.only_second, sum(c.num_cells for c in table.columns.values())
    rows = f"{counted(num_rows, 'row')} in one alone" if num_rows or not num_cells else ""
    cells = f"{counted(num_cells, 'cell')} in {counted(len(table.columns), 'column')} differ" if num_cells else ""
    return ", ".join(part for part in (rows, cells) if part)


def _of_table(table: TableDifference) -> list[str]:
    lines = [f"{counted(count, 'row')} only in {side}" for side, count in
             (("A", table.only_first), ("B", table.only_second)) if count]  # fmt: skip
    for name, column in table.columns.items():
        largest = "" if column.largest is None else f", by {column.largest:.6g} at most"
        differ = "differs" if column.num_cells == 1 else "differ"
        lines.append(f"{name}: {counted(column.num_cells, 'cell')} {differ}{largest}")
        if column.first is not None:
            place = " ".join(f"{key}={value}" for key, value in column.first.location.items())
            lines.append(f"  first at {place}: {column.first.ours} in A, {column.first.theirs} in B")
    return lines


def _listed(title: str, lines: Sequence[str]) -> Iterator[str]:
    if lines:
        yield f"{title}: {len(lines)}"
        yield from _first_lines(lines)


def _first_lines(lines: Sequence[str]) -> Iterator[str]:
    yield from (f"  {line}" for line in lines[:_SHOWN])
    if len(lines) > _SHOWN:
        yield f"  and {len(lines) - _SHOWN} more"
