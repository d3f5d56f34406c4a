"""`branchdrive inspect`: what lies at a path, on one screen, in a moment."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.links import add_link_arguments
from branchdrive.cli.place import place
from branchdrive.contract.text import nearest, quote, similar
from branchdrive.errors import DatasetError, UsageError

if TYPE_CHECKING:
    from branchdrive.formats.store import Store

SUMMARY = "say what a dataset, a table, a group or a file is, what it holds, and how to load it"
ORDER = 45


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("path", metavar="PATH", type=place, help="a dataset: folder, URL or archive; or a file")
    parser.add_argument("name", metavar="TABLE|GROUP", nargs="?", help="a table or a branch group of the dataset")
    add_link_arguments(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Look and print; nothing is judged.

    Raises:
        UsageError: There is nothing at the path that can be inspected, or nothing of that name in it.
        DatasetError: It cannot be read.
    """
    from branchdrive.cli.inspect_text import print_file
    from branchdrive.formats.archive import ARCHIVE_NAME
    from branchdrive.inspection.place import dataset_at, stored_file
    from branchdrive.text.terminal import render

    is_local = not isinstance(args.path, str)
    if is_local and not args.path.exists():
        raise UsageError(f"there is nothing at {str(args.path)!r}; give a dataset's folder or a file")
    if not is_local or args.path.is_dir() or args.path.name.endswith(ARCHIVE_NAME):
        dataset = dataset_at(args.path, follow_links=args.follow_links, allow=args.allow)
        stdout.write(_of_dataset(dataset, args.name, stdout))
        return 0
    if args.name is not None:
        raise UsageError(f"{str(args.path)!r} is a file; tables and groups are named of a dataset's folder")
    stdout.write(render(partial(print_file, found=stored_file(args.path)), stdout))
    return 0


def _of_dataset(dataset: Store, name: str | None, stdout: TextIO) -> str:
    from branchdrive.cli.inspect_text import print_group, print_overview, print_table
    from branchdrive.contract.columns import LAYER_TABLES
    from branchdrive.formats.descriptor_file import read_descriptor
    from branchdrive.formats.table_file import absent_table
    from branchdrive.inspection.overview import look_over
    from branchdrive.inspection.place import table_at
    from branchdrive.raw.contexts import records_of
    from branchdrive.raw.shard import find_shards
    from branchdrive.text.terminal import render

    found = look_over(dataset, read_descriptor(dataset))
    if name is None:
        return render(partial(print_overview, found=found), stdout)
    tables = {one.table.name: one for one in found.tables}
    if name in tables:
        files = tables[name]
        if not files.files:
            raise DatasetError(f"{dataset}: table {name!r} has no file; run `branchdrive-validate`")
        rows = table_at(dataset, files.files[0].path)
        return render(partial(print_table, found=found, files=files, rows=rows), stdout)
    records = records_of(find_shards(dataset), name, found.descriptor)
    if records or name in found.contexts:
        context = found.contexts.get(name, {})
        return render(partial(print_group, group_id=name, context=context, records=records), stdout)
    if name in LAYER_TABLES and LAYER_TABLES[name].optional:
        raise absent_table(dataset, name)
    near = similar(name, [*tables, *found.contexts])  # groups may be thousands, so all are never named
    raise UsageError(f"no table or group {quote(name)}; {nearest(name, near or [*tables])}")
