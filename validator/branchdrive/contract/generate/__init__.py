"""Everything in the repository that is written by machine: parts of the spec and of schemas, and pages of rules.

``python -m branchdrive.contract.generate`` writes them, ``--check`` only names the stale ones. A
generated region of a chapter lies between ``<!-- generated: NAME -->`` and ``<!-- end generated -->``;
`REGIONS` has a function for every name. Clauses without a number get one, and the ledger of clauses is written, for
readers and for machines; what is wrong with it is printed, and ends with 1. Source of all of it: the files of
`schemas/v0.1/`, and of the ledger the tags of the chapters.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from branchdrive.contract.generate.clause import (
    ENTRIES,
    LEDGER,
    entries_text,
    ledger_faults,
    ledger_text,
    number_clauses,
)
from branchdrive.contract.generate.page import rule_pages
from branchdrive.contract.generate.record import metric_schemas, protocol_text, record_schemas
from branchdrive.contract.generate.region import REGIONS, render_regions
from branchdrive.contract.resources import SPEC_VERSION, schema_dir
from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

__all__ = ["REGIONS", "generated_files", "main", "record_schemas", "render_regions", "stale_files"]


def _chapters(root: Path) -> dict[str, str]:
    paths = sorted((root / "spec").glob("[0-9]*.md"))
    if not paths:
        raise UsageError(f"{root} has no spec/ folder; run this in a checkout of the repository")
    ledger = root / "spec" / LEDGER
    return number_clauses(
        {path.name: render_regions(path.read_text(encoding="utf-8")) for path in paths},
        ledger.read_text(encoding="utf-8") if ledger.is_file() else "",
    )


def generated_files(root: Path) -> dict[Path, str]:
    """Text that every file with generated content should have, for the checkout at `root`.

    Raises:
        UsageError: `root` is no checkout of this repository.
    """
    chapters = _chapters(root)
    files = {root / "spec" / name: text for name, text in chapters.items()}
    files[root / "spec" / LEDGER] = ledger_text(chapters)
    files |= rule_pages(root, chapters)
    schemas = root / "schemas" / f"v{SPEC_VERSION}"
    files[schemas / ENTRIES] = entries_text(chapters)
    for name, schema in (record_schemas() | metric_schemas()).items():
        files[schemas / name] = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    for protocol in sorted(schemas.glob("benchmark-protocol*.json")):
        files[protocol] = protocol_text(protocol.read_text(encoding="utf-8"))
    return files


def stale_files(root: Path) -> list[Path]:
    """Files of the checkout at `root` whose generated content is not up to date, relative to it."""
    return [
        path.relative_to(root)
        for path, text in generated_files(root).items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write generated content, or with ``--check`` report what is stale.

    Returns:
        0 if everything is up to date (now), 1 if ``--check`` found stale files or the ledger of clauses has faults.
    """
    parser = argparse.ArgumentParser(
        prog="python -m branchdrive.contract.generate",
        description="Write the generated parts of spec/ and schemas/, and docs/rules/.",
    )
    parser.add_argument("--check", action="store_true", help="change nothing; name stale files, exit 1 if any")
    check = parser.parse_args(arguments).check
    root = schema_dir().parents[1]
    stale = stale_files(root)
    for path in stale:
        sys.stdout.write(f"{'stale' if check else 'written'}: {path.as_posix()}\n")
    if not check:
        texts = generated_files(root)
        for path in stale:
            (root / path).write_text(texts[root / path], encoding="utf-8")
    faults = ledger_faults(_chapters(root))
    for fault in faults:
        sys.stdout.write(f"ledger: {fault}\n")
    return 1 if faults or (check and stale) else 0
