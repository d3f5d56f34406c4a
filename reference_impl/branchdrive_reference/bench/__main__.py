"""`make bench`: measure the budgets in one run and print them as a table.

Ratios compare things measured side by side in this run; nothing here is a test.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

from branchdrive_reference.bench.corpus import repeat_dataset
from branchdrive_reference.bench.simulator import measure_ticks_per_s
from branchdrive_reference.bench.startup import time_startup
from branchdrive_reference.bench.validation import time_validation
from branchdrive_reference.collect.campaign import collect

SEED = 7
COLLECTED_GROUPS = 32
GROUPS_PER_SHARD = 32


def main() -> None:
    """Run every benchmark and print the table."""
    parser = argparse.ArgumentParser("branchdrive_reference.bench", description=__doc__)
    parser.add_argument("--groups", type=int, default=384, help="groups of the validated dataset (paper scale: 2467)")
    args = parser.parse_args()
    console = Console()
    table = Table("what", "measured", "bar", title="BranchDrive benchmarks", title_justify="left")

    console.print("simulator and expert ...")
    table.add_row("simulator + expert, one core", f"{measure_ticks_per_s():,.0f} ticks/s", ">= 5,000 ticks/s")

    with tempfile.TemporaryDirectory() as folder:
        console.print(f"collecting {COLLECTED_GROUPS} groups, repeating them to {args.groups} ...")
        source, target = Path(folder, "source"), Path(folder, "dataset")
        collect(source, num_groups=COLLECTED_GROUPS, seed=SEED)  # no workers: their memory is not to be measured
        num_groups = repeat_dataset(source, target, num_groups=args.groups, groups_per_shard=GROUPS_PER_SHARD)
        for jobs in (1, 2):
            console.print(f"validating {num_groups} groups with {jobs} worker(s) ...")
            timing = time_validation(target, jobs=jobs)
            rows = f"{num_groups:,} groups, {timing.num_control_rows / 1e6:.1f} M control rows, {jobs} worker(s)"
            measured = f"{timing.validation_s:.2f} s / {timing.floor_s:.2f} s = {timing.ratio:.2f}x"
            table.add_row(f"validation / (read + hash + decode)\n{rows}", measured, "<= 2.5x")
        table.add_row("peak memory of a worker", f"{timing.peak_bytes / 2**20:.0f} MiB", "<= 512 MiB")

    python = time_startup(["-c", "pass"])
    table.add_row(
        "import branchdrive (and all of validate)",
        f"{time_startup(['-c', 'import branchdrive']) - python:.2f} s "
        f"({time_startup(['-c', 'from branchdrive import validate']) - python:.2f} s)",
        "<= 0.4 s",
    )
    table.add_row("branchdrive --help", f"{time_startup(['-m', 'branchdrive.cli', '--help']):.2f} s", "<= 0.3 s")
    console.print(table)


if __name__ == "__main__":
    main()
