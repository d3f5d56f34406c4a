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

from benchmarks import (
    benchmark,
    camera_ranking,
    growth,
    highway_env,
    paper,
    places,
    ranking,
    release,
    rendering,
    simulator,
    startup,
    validation,
)
from benchmarks.release import ReleaseBench
from benchmarks.row import Row
from branchdrive.cli.build import calibration
from branchdrive.cli.validate import at_least
from branchdrive.errors import BranchDriveError
from branchdrive_reference.collect.campaign import collect

NUM_VALIDATED_GROUPS = 384

GROWN_GROUPS = 24
"""Groups of the shard that is repeated where growth alone is measured."""


def _measurements(args: argparse.Namespace, folder: Path) -> dict[str, Iterator[Row]]:
    """What is measured, by name; nothing is until its rows are asked for."""
    if args.paper:
        return {"collection of the paper's size": paper.rows(folder, num_groups=args.groups)}
    if args.release:
        bench = ReleaseBench(args.dataset, args.groups, args.calibration, num_seeds=args.seeds)
        root = folder / release.FOLDER
        return {
            "a release": release.rows(folder, bench),
            "its benchmark": benchmark.rows(root, jobs=bench.jobs),
            "both": release.validated_rows(
                root, bench, what="release with its benchmark", bar="<= 15 s for 1,000 groups"
            ),
        }
    if args.growth:
        collect(folder / "source", num_groups=GROWN_GROUPS, seed=1)
        return {"growth": growth.rows(folder, sizes=growth.LARGE_SIZES, stages=growth.ALL_STAGES)}
    made = folder / "release"
    return {
        "simulator and expert": simulator.rows(),
        "highway-env beside them": highway_env.rows(),
        "rendering": rendering.rows(),
        "ranking": ranking.rows(folder),
        "ranking from cameras": camera_ranking.rows(folder, release=made),
        "validation": validation.rows(folder, num_groups=args.groups or NUM_VALIDATED_GROUPS, release=made),
        "growth": growth.rows(folder),
        "places, cache and Ray": places.rows(folder),
        "start-up": startup.rows(),
    }


def main() -> None:
    """Run the benchmarks and print the table."""
    parser = argparse.ArgumentParser("benchmarks", description=__doc__)
    subject = parser.add_mutually_exclusive_group()
    subject.add_argument("--paper", action="store_true", help="collect and validate the preset `paper` instead")
    subject.add_argument(
        "--release", action="store_true", help="build and validate a release of the preset `benchmark` instead"
    )
    subject.add_argument(
        "--growth", action="store_true", help="measure the growth of stages up to 16,000 repeated groups instead"
    )
    parser.add_argument(
        "--groups",
        type=at_least(1),
        help=f"groups to validate (default: {NUM_VALIDATED_GROUPS}; with --paper and --release: the preset's)",
    )
    parser.add_argument("--dataset", metavar="PATH", type=Path, help="with --release: copy this dataset, collect none")
    parser.add_argument(
        "--calibration",
        metavar="GROUPS,CLUSTERS",
        type=calibration,
        default=ReleaseBench.calibration,
        help="with --release: as of `branchdrive build` (default: 88,48)",
    )
    parser.add_argument(
        "--seeds",
        metavar="S",
        type=at_least(1),
        default=ReleaseBench.num_seeds,
        help=f"with --release: seeds of the check of the leakage gate (default: {ReleaseBench.num_seeds})",
    )
    args = parser.parse_args()
    if args.dataset and (args.groups or not args.release):
        parser.error("--dataset goes with --release, and without --groups")
    try:
        _run(args)
    except BranchDriveError as error:
        sys.exit(f"bench: {error}")


def _run(args: argparse.Namespace) -> None:
    console = Console(markup=False, emoji=False)
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
