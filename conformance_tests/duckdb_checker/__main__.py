"""`python conformance_tests/duckdb_checker DATASET` prints a report as JSON, with `--batch` one for each line."""

import argparse
import json
import sys
from pathlib import Path

import checker


def main() -> int:
    """Judges the named datasets; gives the exit code of the verdict, or 0 for a batch."""
    parser = argparse.ArgumentParser(prog="duckdb_checker", description=__doc__)
    parser.add_argument("datasets", nargs="*", type=Path, metavar="DATASET")
    parser.add_argument("--batch", action="store_true", help="one line for each dataset: its path and its report")
    parser.add_argument("--claims", action="store_true", help="print the rules that this checker judges")
    arguments = parser.parse_args()
    if arguments.claims:
        print("\n".join(checker.claims()))
        return 0
    if not arguments.datasets or not all(path.is_dir() for path in arguments.datasets):
        parser.error("name the folder of a dataset")
    if not arguments.batch and len(arguments.datasets) > 1:
        parser.error("several datasets need --batch")
    connection = checker.connect()
    for path in arguments.datasets:
        report = checker.judge(path, connection)
        if not arguments.batch:
            print(json.dumps(report, indent=2))
            return int(report["exit_code"])
        print(json.dumps({"dataset": str(path), **report}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
