"""`make fuzz`: damage valid datasets of all layers in many ways and see that each ends in a verdict.

A run can be interrupted and goes on where it stopped; cases depend on the seed and their number alone.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.fuzz.base import write_bases
from tests.fuzz.case import MAX_CPU_S, Fuzz
from tests.fuzz.pool import Lost, run_cases
from tests.fuzz.report import render, summary

from branchdrive.cli.validate import at_least
from branchdrive.runtime.executor import isolated

DEFAULT_CASES = 10_000
LIMIT_S = 120.0
"""Time after which a case counts as a hang."""


def main(argv: list[str] | None = None) -> int:
    """Run the fuzz; exit code 0 where the validator never misbehaved, 1 where it did, 130 when interrupted."""
    parser = argparse.ArgumentParser("fuzz", description=__doc__)
    parser.add_argument("--cases", type=at_least(1), default=DEFAULT_CASES, help="damaged datasets (default: 10,000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of all cases (default: 0)")
    parser.add_argument("--jobs", type=at_least(1), default=2, help="processes (default: 2)")
    parser.add_argument(
        "--output", type=Path, default=Path("build/fuzz"), help="folder of results (default: build/fuzz)"
    )
    parser.add_argument(
        "--limit-s", type=float, default=LIMIT_S, help=f"time after which a case is a hang (default: {LIMIT_S:g})"
    )
    parser.add_argument(
        "--max-cpu-s", type=float, default=MAX_CPU_S, help=f"processor time of a case at most (default: {MAX_CPU_S:g})"
    )
    parser.add_argument("--case", type=int, help="run one case, keep its dataset and print what came of it")
    args = parser.parse_args(argv)
    bases = write_bases(args.output / "bases")
    if args.case is not None:
        return _one(args, bases)
    return _all(args, bases)


def _one(args: argparse.Namespace, bases: dict[str, Path]) -> int:
    """One case as users run the validator: shards in a process with a limit on memory."""
    work = args.output / f"case-{args.case}"
    result = Fuzz(args.seed, bases, work, max_cpu_s=args.max_cpu_s).run(args.case, executor=isolated(1), is_kept=True)
    sys.stdout.write(f"{json.dumps(result.to_json(), indent=2)}\n")
    sys.stderr.write(f"the dataset is {work / 'case/dataset'}\n")
    return int(bool(result.failure))


def _all(args: argparse.Namespace, bases: dict[str, Path]) -> int:
    path = args.output / f"results-{args.seed}.jsonl"
    rows = {row["index"]: row for row in _known(path)}
    rest = [index for index in range(args.cases) if index not in rows]
    start, shown, is_interrupted = time.monotonic(), 0.0, False
    num_failures = sum(bool(row["failure"]) for row in rows.values())
    try:
        with path.open("a") as file:
            work = args.output / "work"
            found = run_cases(
                rest, args.seed, bases, work, jobs=args.jobs, limit_s=args.limit_s, max_cpu_s=args.max_cpu_s
            )
            for count, (index, result) in enumerate(found, 1):
                row = _again(args, index, result) if isinstance(result, Lost) else result.to_json()
                rows[index] = row
                num_failures += bool(row["failure"])
                file.write(json.dumps(row) + "\n")
                file.flush()
                passed = time.monotonic() - start
                if passed - shown >= 5 or count == len(rest):
                    shown = passed
                    left_min = passed / count * (len(rest) - count) / 60
                    sys.stderr.write(
                        f"fuzz: {len(rows):,} of {args.cases:,}, {count / passed:.1f}/s, {left_min:.0f} min left, "
                        f"{num_failures} failures\n"
                    )
    except KeyboardInterrupt:
        is_interrupted = True
    tried = [row for index, row in rows.items() if index < args.cases]
    figures = summary(tried, args.cases)
    (args.output / "report.json").write_text(json.dumps(figures, indent=2) + "\n")
    (args.output / "report.txt").write_text(render(figures))
    sys.stdout.write(render(figures, is_full=False))
    sys.stdout.write(f"\nall columns: {args.output / 'report.txt'}, {args.output / 'report.json'}\n")
    return 130 if is_interrupted else int(bool(figures["failures"]))


def _known(path: Path) -> Iterator[dict[str, Any]]:
    """Results of an earlier run; a line that was cut off is not there."""
    for line in path.read_text().splitlines(keepends=True) if path.exists() else ():
        if line.endswith("\n"):
            yield json.loads(line)


def _again(args: argparse.Namespace, index: int, reason: Lost) -> dict[str, Any]:
    """A case without a result once more, as users run the validator: a worker that dies is a finding there.

    What takes too long, and what has no result then either, is a failure.
    """
    output = ("--output", str(args.output), "--seed", str(args.seed))
    command = [sys.executable, "-m", "tests.fuzz", "--case", str(index), *output, "--max-cpu-s", str(args.max_cpu_s)]
    if reason.is_death:
        with suppress(subprocess.TimeoutExpired, json.JSONDecodeError):
            done = subprocess.run(command, stdout=subprocess.PIPE, timeout=10 * args.limit_s, check=False)
            row: dict[str, Any] = json.loads(done.stdout)
            return row
    return {
        "index": index, "base": "?", "damage": "?", "what": f"see `python -m tests.fuzz --case {index}`", "column": "",
        "kind": "", "is_sealed": False, "is_changed": True, "verdict": "", "rules": [], "cpu_s": 0.0, "memory_bytes": 0,
        "failure": reason.reason,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
