"""`branchdrive columns`: the tables of the format, and the columns of one, without any dataset."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING, TextIO

from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from branchdrive.text.table import Table

SUMMARY = "list the tables of the format, or the columns of one"
ORDER = 105


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("table", metavar="TABLE", nargs="?", help="a table such as observations or scalars")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Print the tables, or the columns of one.

    Raises:
        UsageError: No table is called so.
    """
    from branchdrive.contract.columns import LAYER_TABLES, TABLES
    from branchdrive.contract.text import nearest, quote
    from branchdrive.text.terminal import print_section, render

    names = [*TABLES, *LAYER_TABLES]
    if args.table is not None and args.table not in names:
        raise UsageError(f"no table is called {quote(args.table)}; {nearest(args.table, names)}")
    section = _tables() if args.table is None else _columns(args.table)
    stdout.write(render(partial(print_section, section=section), stdout))
    return 0


def _tables() -> Table:
    from branchdrive.contract.columns import LAYER_TABLES, TABLES
    from branchdrive.contract.layer import layer_of_table
    from branchdrive.contract.layout import RAW_DIR
    from branchdrive.text.table import Column, Table

    columns = [
        Column.name("layer"), Column.name("table", is_code=True), Column("columns"), Column("key", is_text=True),
        Column("holds", is_text=True),
    ]  # fmt: skip
    rows = [
        [RAW_DIR if table.name in TABLES else layer_of_table(table.name), table.name, str(len(table.columns)),
         ", ".join(table.key), table.title]
        for table in (*TABLES.values(), *LAYER_TABLES.values())
    ]  # fmt: skip
    return Table("Tables", columns, rows)


def _columns(name: str) -> Table:
    from branchdrive.contract.columns import declared_table
    from branchdrive.text.table import Column, Table

    columns = [
        Column.name("column", is_code=True), Column("type", is_text=True), Column("unit", is_text=True),
        Column("track", is_text=True), Column("nulls", is_text=True), Column("what it is", is_text=True),
    ]  # fmt: skip
    table = declared_table(name)
    rows = [
        [one.name, one.type, one.unit or "", one.track, "yes" if one.nullable else "", one.description]
        for one in table.columns
    ]
    return Table(f"{name}: {table.title}", columns, rows, [f"Key: {', '.join(table.key)}."])
