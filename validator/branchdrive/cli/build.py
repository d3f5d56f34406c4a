"""`branchdrive build`: derived layers beside a raw layer, or as a detached release."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from branchdrive.cli.executor import add_executor_argument, executor_of
from branchdrive.cli.place import local, place
from branchdrive.cli.progress import progress_bar
from branchdrive.cli.validate import at_least, in_range
from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from branchdrive.formats.bucket import Bucket
    from branchdrive.quality.variants import Variant
    from branchdrive.release.builder import BuildReport
    from branchdrive.statistics.split import Calibration

SUMMARY = "build the derived layers of a release from a raw layer"
ORDER = 120

_STAGES = ("canonical", "quality", "leakage", "model")

seed = in_range(0, 2**63 - 1)
"""Parser of seeds."""


def calibration(text: str) -> tuple[int, int]:
    """Least groups and clusters of a calibration partition; `argparse` names this function in its messages."""
    parts = text.split(",")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() and 0 < int(part) < 10**6 for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not GROUPS,CLUSTERS, two whole numbers above 0")
    return int(parts[0]), int(parts[1])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="dataset with a finished raw layer")
    what = parser.add_argument_group("what to build")
    what.add_argument(
        "--output",
        metavar="RELEASE",
        type=place,
        help="make a detached release there, in a folder or at s3://...; it names its raw layer by digest",
    )
    what.add_argument(
        "--stage",
        choices=_STAGES,
        action="append",
        help="carry out this stage only (repeatable; default: all, in order)",
    )
    what.add_argument(
        "--no-leakage", action="store_true", help="leave the leakage audit out, an earlier one too; the card says so"
    )
    what.add_argument(
        "--endings",
        action="store_true",
        help="add what was recorded of every candidate's drive up to its end; a benchmark then reports it",
    )
    what.add_argument(
        "--objects",
        action="store_true",
        help="add what sensors of the vehicle tell of actors up to the branch: in range and in sight, with noise",
    )
    population = parser.add_argument_group("whom it holds")
    population.add_argument(
        "--seed", metavar="S", type=seed, default=0, help="seed of split, intervals and audit (default: 0)"
    )
    population.add_argument(
        "--calibration", metavar="GROUPS,CLUSTERS", type=calibration,
        help="least groups and route clusters of a calibration partition (default: no such partition)",
    )  # fmt: skip
    population.add_argument(
        "--variants", metavar="FILE", type=Path, help="JSON list of further populations: name, title, where"
    )
    work = parser.add_argument_group("how to work")
    work.add_argument("--jobs", metavar="N", type=at_least(1), default=1, help="worker processes (default: 1)")
    add_executor_argument(work)
    work.add_argument("--format", choices=("text", "json"), default="text", help="what to print (default: text)")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Build and print the population of the release.

    Raises:
        UsageError: The options do not go together.
        DatasetError: The raw layer cannot be built from.
    """
    from branchdrive.release.builder import build_release
    from branchdrive.release.stage import BuildOptions

    stages = tuple(args.stage or _STAGES)
    if args.no_leakage:
        if args.stage and "leakage" in args.stage:
            raise UsageError("`--no-leakage` and `--stage leakage` contradict each other")
        stages = tuple(stage for stage in stages if stage != "leakage")
    tables = frozenset(name for name in ("endings", "objects") if getattr(args, name))
    options = BuildOptions(args.seed, _calibration(args.calibration), _variants(args.variants), tables)
    if args.output is None:
        local(args.dataset, "`build` without `--output`")  # before a bucket is asked
    with ExitStack() as stack:
        upload = _upload(args.output, stack)
        show = stack.enter_context(progress_bar(stderr, "building"))
        report = build_release(
            args.dataset,
            output=upload.folder if upload else args.output,
            stages=stages,
            drop_leakage=args.no_leakage,
            options=options,
            executor=executor_of(args),
            progress=lambda stage, done, total, note: show(done, total, f"{stage} {note}".strip()),
        )
        if upload:
            upload.send(lambda done, total: show(done, total, "uploading"))
            report = replace(report, target=args.output)
    stdout.write(_render(report, args.format, stdout))
    stdout.flush()
    return 0


@dataclass(frozen=True)
class _Upload:
    """A release that is built in a temporary folder and then uploaded."""

    folder: Path
    target: Bucket

    def send(self, progress: Callable[[int, int], None]) -> None:
        from branchdrive.formats.folder import Folder
        from branchdrive.formats.upload import upload_dataset

        upload_dataset(Folder(self.folder), self.target, progress)


def _upload(output: Path | str | None, stack: ExitStack) -> _Upload | None:
    """Where a release goes before it is uploaded; ``None`` where it is not. The bucket is asked before it is built."""
    if not isinstance(output, str):
        return None
    from branchdrive.formats.bucket import Bucket

    target = Bucket.for_writing(output)
    work = stack.enter_context(tempfile.TemporaryDirectory(prefix="branchdrive-build-"))
    return _Upload(Path(work).resolve() / "release", target)


def _calibration(least: tuple[int, int] | None) -> Calibration | None:
    from branchdrive.statistics.split import Calibration

    return None if least is None else Calibration(*least)


def _variants(path: Path | None) -> tuple[Variant, ...]:
    from branchdrive.contract.document import parse_json
    from branchdrive.contract.limits import spec_limits
    from branchdrive.quality.variants import declared_variants

    if path is None:
        return ()
    try:
        with path.open("rb") as stream:
            return declared_variants(parse_json(stream.read(spec_limits().max_document_bytes + 1)))
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: {error}") from error


def _render(report: BuildReport, form: str, stdout: TextIO) -> str:
    if form == "json":
        document: dict[str, Any] = {
            "path": str(report.target),
            "identity": report.identity,
            "layers": list(report.layers),
            "population": report.documents.get("quality/population.json"),
            "retention": report.documents.get("quality/retention.json"),
        }
        return json.dumps(document, indent=2, sort_keys=True, allow_nan=False) + "\n"
    from branchdrive.cli.text import render_build

    return render_build(report, stdout)
