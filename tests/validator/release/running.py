"""Builds of a small release in a test: with few draws, without recurrent classifiers, and what a folder then holds."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.synthetic_release import SEED

from branchdrive.cli.main import run, validate_run
from branchdrive.contract.layer import table_file
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.validate import validate
from branchdrive.formats.folder import Folder
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import conform, read_table
from branchdrive.leakage.protocol import AuditProtocol, BatteryProtocol, GateProtocol
from branchdrive.release.builder import STAGES, BuildReport, build_release
from branchdrive.release.stage import BuildOptions

QUICK = AuditProtocol(
    GateProtocol(num_permutations=19, num_frequencies=8, num_replicates=1, offsets_sd=(0.8,)),
    BatteryProtocol(num_permutations=19, num_resamples=19),
)
"""An audit that finds nothing and takes no time."""

LAYERS = [stage for stage in STAGES if stage != "leakage"]
"""Stages that make a release without an audit."""


def build(root: Path, *, seed: int = SEED, stages: Sequence[str] = LAYERS, **options: Any) -> BuildReport:
    """Build a release; its audit, where `stages` ask for one, is quick."""
    return build_release(root, stages=stages, options=BuildOptions(seed), protocol=QUICK, **options)


def breaches(root: Path) -> set[str]:
    """Rules that a release breaks, but for the one that a quick audit must break: it makes too few draws."""
    report = validate(root)
    assert report.errors == ()
    return {tally.rule_id for tally in report.tallies if tally.num_findings and tally.info.decides} - {"BD-LKG-011"}


def contents(root: Path) -> dict[str, bytes]:
    """Bytes of every file below `root`, by path."""
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def derived(root: Path) -> dict[str, bytes]:
    """Bytes of every file of the derived layers, by path."""
    return {path: content for path, content in contents(root).items() if path.split("/")[0] in LAYERS}


def raw_state(root: Path) -> dict[str, tuple[int, int, int, bytes]]:
    """Inode, modification time, mode and bytes of every raw file, by path."""
    found = {}
    for path in (root / "raw").rglob("*"):
        if path.is_file():
            status = path.stat()
            found[path.relative_to(root).as_posix()] = (
                status.st_ino,
                status.st_mtime_ns,
                status.st_mode,
                path.read_bytes(),
            )
    return found


def manifest_lines(root: Path, part: str) -> list[str]:
    """Lines of the manifest that name `part`."""
    return [line for line in (root / MANIFEST_FILE).read_text().splitlines() if part in line]


def call(*argv: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `branchdrive`."""
    return _call(run, argv)


def call_validate(*argv: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `branchdrive-validate`."""
    return _call(validate_run, argv)


def _call(entry: Any, argv: Sequence[object]) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    code = entry([os.fspath(a) if isinstance(a, Path) else str(a) for a in argv], stdout, stderr)
    return code, stdout.getvalue(), stderr.getvalue()


SHARDS = {
    "raw/shard-00000": "raw/shard-00000",
    "raw/shard-00001": "raw/shard-00063",
    "raw/shard-00002": "raw/shard-00064",
}
"""New folders of the shards of a raw layer of two parts."""


def rewrite(root: Path, path: str, rows: Any) -> None:
    file = table_file(path)
    assert file is not None
    (root / path).write_bytes(encode_table(conform(rows, file.table)))


def read(root: Path, path: str) -> Any:
    file = table_file(path)
    assert file is not None
    return conform(read_table(Folder(root), path, file.table), file.table)
