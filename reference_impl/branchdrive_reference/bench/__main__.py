"""`make bench`: measure the budgets in one run and print them as a table.

Ratios compare things measured side by side in this run; nothing here is a test.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from branchdrive.errors import BranchDriveError
from branchdrive_reference.bench import highway_env, paper, simulator, startup, validation
from branchdrive_reference.bench.row import Row

NUM_VALIDATED_GROUPS = 384


def _measurements(args: argparse.Namespace, folder: Path) -> dict[str, Iterator[Row]]:
    """What is measured, by name; nothing is until its rows are asked for."""
    if args.paper:
        return {"collection of the paper's size": paper.rows(folder, num_groups=args.groups)}
    return {
        "simulator and expert": simulator.rows(),
        "highway-env beside them": highway_env.rows(),
        "validation": validation.rows(folder, num_groups=args.groups or NUM_VALIDATED_GROUPS),
        "start-up": startup.rows(),
    }


def main() -> None:
    """Run the benchmarks and print the table."""
    parser = argparse.ArgumentParser("branchdrive_reference.bench", description=__doc__)
    parser.add_argument("--paper", action="store_true", help="collect and validate the preset `paper` instead")
    parser.add_argument(
        "--groups", type=int, help=f"groups to validate (default: {NUM_VALIDATED_GROUPS}; with --paper: the preset's)"
    )
    args = parser.parse_args()
    try:
        _run(args)
    except BranchDriveError as error:
        sys.exit(f"bench: {error}")


def _run(args: argparse.Namespace) -> None:
    console = Console()
    table = Table("what", "measured", "bar", title="BranchDrive benchmarks", title_justify="left", show_lines=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, rows in _measurements(args, Path(folder)).items():
            console.print(f"{name} ...")
            for row in rows:
                what, measured = (", ".join(text.splitlines()) for text in (row.what, row.measured))
                console.print(f"  {what}: {measured}", highlight=False)
                table.add_row(*row)
    console.print(table)


if __name__ == "__main__":
    main()
