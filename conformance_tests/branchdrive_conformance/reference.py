"""This project's validator as a command that takes cases: ``python -m branchdrive_conformance.reference CASE ...``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.engine.waiver import load_waivers
from branchdrive_conformance.materialize import CASE_FILE, DATASET_DIR, RAW_DIR, WAIVERS_FILE

__all__ = ["judge_case", "main"]


def judge_case(folder: Path) -> Report:
    """Report on the dataset of a materialised case.

    Raises:
        BranchDriveError: The case cannot be read.
    """
    options = json.loads((folder / CASE_FILE).read_bytes()).get("options", {})
    raw = folder / RAW_DIR
    return validate(
        folder / DATASET_DIR,
        raw=raw if raw.is_dir() else None,
        waivers=load_waivers(folder / WAIVERS_FILE) if "waivers" in options else (),
        hash_files=options.get("hash", True),
    )


def main(folders: Sequence[str]) -> None:
    """Print a report on a line for each folder."""
    for folder in folders:
        sys.stdout.write(json.dumps(judge_case(Path(folder)).to_json(), allow_nan=False) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
