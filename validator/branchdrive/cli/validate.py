"""`branchdrive validate`, also installed as `branchdrive-validate`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from branchdrive.cli.executor import add_executor_argument, executor_of
from branchdrive.cli.formats.table import FORMATS, outputs, renderer
from branchdrive.cli.links import add_link_arguments
from branchdrive.cli.output import check_output
from branchdrive.cli.place import local, place
from branchdrive.cli.progress import progress_bar
from branchdrive.contract.media import MEDIA_MODES
from branchdrive.errors import UsageError

SUMMARY = "check a dataset against the specification"
ORDER = 80

_CACHE_GIB = 16


def at_least(low: int) -> Callable[[str], int]:
    """Parser of whole numbers of at least `low`, and below a thousand million."""
    return _whole_number(low, 10**9 - 1, f"of at least {low}")


def in_range(low: int, high: int) -> Callable[[str], int]:
    """Parser of whole numbers from `low` to `high`."""
    return _whole_number(low, high, f"from {low} to {high}")


def _whole_number(low: int, high: int, which: str) -> Callable[[str], int]:
    def parse(text: str) -> int:
        value = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else -1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number {which}")
        return value

    return parse


def share(text: str) -> float:
    """A share from 0 to 1; `argparse` names this function in its messages."""
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 0 to 1")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset: folder, URL or archive")
    parser.add_argument(
        "--raw", metavar="PATH", type=place, help="dataset with the raw layer that a detached release names by digest"
    )
    report = parser.add_argument_group("what to report")
    report.add_argument(
        "--format", metavar="FORMAT", choices=[*FORMATS],
        default="text", help=f"what to print: {', '.join(FORMATS)} (default: text)",
    )  # fmt: skip
    report.add_argument(
        "--output", metavar="[FORMAT=]FILE", action="append", default=[],
        help="write a report to a file, in --format or in a FORMAT of its own, and print the text (repeatable)",
    )  # fmt: skip
    rules = parser.add_argument_group("what to judge")
    rules.add_argument("--select", metavar="RULE", action="append", help="run only these rules or areas (repeatable)")
    rules.add_argument("--ignore", metavar="RULE", action="append", default=[], help="leave these out (repeatable)")
    rules.add_argument("--no-hash", action="store_true", help="skip digests; the verdict is at best partial")
    rules.add_argument(
        "--media", choices=[*MEDIA_MODES], default="full",
        help="which images to decode: "
        + "; ".join(f"{mode}: {meaning}" for mode, meaning in MEDIA_MODES.items())
        + "; their bytes are compared with the index in any case, and unless all are decoded the verdict on a dataset "
        "with media is at best partial (default: full)",
    )  # fmt: skip
    verdict = parser.add_argument_group("what to accept")
    verdict.add_argument("--waivers", metavar="FILE", type=Path, help="accepted failures, see spec/07-rules.md")
    verdict.add_argument("--require-groups", metavar="N", type=at_least(0), help="exit 1 unless N groups qualify")
    verdict.add_argument("--strict", action="store_true", help="exit 1 where a diagnostic or a recommendation fails")
    reading = parser.add_argument_group("how to read")
    reading.add_argument("--jobs", metavar="N", type=at_least(1), default=1, help="worker processes (default: 1)")
    add_executor_argument(reading)
    reading.add_argument(
        "--dataset-memory", metavar="GIB", type=at_least(1),
        help="memory of a process that judges the whole dataset, in GiB, where the specification's limit is too little "
        "for a large one or too much for the machine",
    )  # fmt: skip
    reading.add_argument(
        "--staging",
        action="store_true",
        help="look into a collection that runs or was cut off: validate what it has finished so far",
    )
    add_link_arguments(reading)
    cache = parser.add_argument_group("what to take from earlier runs")
    cache.add_argument(
        "--cache", metavar="FOLDER|URL", type=place,
        help="take what an earlier run judged of equal files with this code, these libraries and options, and keep "
        "what this one does; a folder is yours alone, a prefix of a bucket is for those that the bucket lets write "
        "there (s3://BUCKET/PREFIX, extra `cloud`); the report says how much was taken",
    )  # fmt: skip
    cache.add_argument(
        "--recheck", metavar="SHARE", type=share, default=0.0,
        help="judge this share of what could be taken again, another one every day, and fail with exit code 4 where it "
        "differs (default: 0)",
    )  # fmt: skip
    cache.add_argument(
        "--trust-versions", action="store_true",
        help="of a dataset in a bucket: let the ETag and time that are listed for an object stand for the bytes that "
        "an earlier run read of it, and read no shard whose result is taken; the report says for how many",
    )  # fmt: skip
    cache.add_argument(
        "--cache-size", metavar="GIB", type=at_least(1),
        help="size of a cache in a folder after the run, in GiB; what was not used for longest goes first (default: "
        f"{_CACHE_GIB}); a bucket has rules of its own for what is old",
    )  # fmt: skip


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Validate and print the report; the exit code is the verdict's."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers: each has one core
    executor = executor_of(args)  # before what this process loads, which takes as long
    from branchdrive.cli.text import render_report
    from branchdrive.engine.cache import Cache, is_url
    from branchdrive.engine.validate import validate
    from branchdrive.engine.waiver import load_waivers
    from branchdrive.formats.durable import replace_file
    from branchdrive.writer.staging import snapshot

    if args.recheck and args.cache is None:
        raise UsageError("`--recheck` judges again what is taken from a cache; name one with `--cache`")
    if args.trust_versions and args.cache is None:
        raise UsageError("`--trust-versions` is about what is taken from a cache; name one with `--cache`")
    written = outputs(args.output)
    for output in written:
        for root in (args.dataset, args.raw):
            check_output(output.path, outside=root)
    waivers = load_waivers(args.waivers) if args.waivers else ()
    cache = None
    if args.cache is not None:
        if is_url(args.cache) and args.cache_size is not None:
            raise UsageError("`--cache-size` bounds a folder; let a rule of the bucket remove what is old")
        max_bytes = (args.cache_size or _CACHE_GIB) << 30
        cache = Cache(args.cache, recheck=args.recheck, max_bytes=max_bytes, trust_versions=args.trust_versions)
    with ExitStack() as stack:
        root = stack.enter_context(snapshot(local(args.dataset, "--staging"))) if args.staging else args.dataset
        progress = stack.enter_context(progress_bar(stderr, "validating shards"))
        report = validate(
            root,
            raw=args.raw,
            select=args.select,
            ignore=args.ignore,
            hash_files=not args.no_hash,
            media=args.media,
            waivers=waivers,
            require_groups=args.require_groups,
            strict=args.strict,
            follow_links=args.follow_links,
            allow=args.allow,
            executor=executor,
            dataset_memory_bytes=None if args.dataset_memory is None else args.dataset_memory << 30,
            cache=cache,
            progress=progress,
        )
    if args.staging:
        report = replace(report, dataset=replace(report.dataset, path=f"{args.dataset} (staging)"))
    for output in written:
        replace_file(output.path, renderer(output.form or args.format)(report).encode())
    is_kept = any(output.form is None for output in written)  # a file has what `--format` asks for
    stdout.write(render_report(report, stdout) if is_kept or args.format == "text" else renderer(args.format)(report))
    stdout.flush()
    return report.exit_code
