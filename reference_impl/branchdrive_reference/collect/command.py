"""`branchdrive collect`: collect a dataset in the reference world, or go on where a run was interrupted."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.build import seed
from branchdrive.cli.executor import add_executor_argument, engine_of, engine_text
from branchdrive.cli.place import folder
from branchdrive.cli.progress import Update, progress_bar
from branchdrive.cli.validate import in_range
from branchdrive.collector.part import WHOLE, Part
from branchdrive.errors import UsageError
from branchdrive.exit_code import EXIT_INTERRUPTED
from branchdrive.runtime.environment import extra
from branchdrive.runtime.interrupt import deferred_interrupt, heeded_termination
from branchdrive.runtime.progress import unwatched

if TYPE_CHECKING:
    from branchdrive.collector.report import CollectionReport
    from branchdrive.writer.shard_upload import ShardUpload
    from branchdrive_reference.collect.disk import DiskNeed
    from branchdrive_reference.rendering.dataset import RenderReport

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "collect a dataset in the reference world"
ORDER = 20

_MAX_COUNT = 1_000_000
_MAX_STRENGTH = 100.0


def bucket(text: str) -> str:
    """A prefix of a bucket; `argparse` names this function in its messages."""
    if "://" not in text:
        raise argparse.ArgumentTypeError(f"{text!r} is no URL of a bucket, such as s3://BUCKET/PREFIX")
    return text


def strength(text: str) -> float:
    """The strength of replay noise; `argparse` names this function in its messages."""
    value = float(text)
    if not (math.isfinite(value) and 0 <= value <= _MAX_STRENGTH):
        raise argparse.ArgumentTypeError(f"{value} is not in 0 .. {_MAX_STRENGTH:g}")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    from branchdrive_reference.collect.fault import FAULT_RATES
    from branchdrive_reference.collect.plan import BRANCH_PRESETS, FAULT_PRESETS, PRESETS
    from branchdrive_reference.simulation.branch_kind import BRANCH_SHARES

    presets = ", ".join(f"{name} ({preset.num_groups:,} groups)" for name, preset in PRESETS.items())
    fault_presets, branch_presets = " or ".join(FAULT_PRESETS), " or ".join(BRANCH_PRESETS)
    parser.add_argument("out", metavar="OUT", type=folder, help="folder of the dataset; an interrupted one is resumed")
    what = parser.add_argument_group("what to collect")
    what.add_argument("--groups", metavar="N", type=in_range(1, _MAX_COUNT), help="branch groups to collect")
    what.add_argument(
        "--preset",
        choices=PRESETS,
        help=f"defaults of groups, branches, scenario types, replay noise and faults: {presets}; options override it",
    )
    what.add_argument(
        "--part",
        metavar="K/N",
        type=Part.parse,
        default=WHOLE,
        help="collect part K of N of the groups, in whole shards; `branchdrive merge` makes one dataset of the N parts",
    )
    what.add_argument("--seed", metavar="S", type=seed, required=True, help="seed of the whole collection")
    what.add_argument(
        "--scenario",
        metavar="NAME",
        action="append",
        help="collect this scenario type only; can be repeated; docs/reference-world.md describes them",
    )
    what.add_argument(
        "--branches",
        metavar="SPEC",
        help=f"shares of groups that branch elsewhere than at the expert's manoeuvre: none, {branch_presets}, or "
        f"KIND=SHARE,... of {', '.join(BRANCH_SHARES.names)}; docs/reference-world.md describes them",
    )
    what.add_argument(
        "--media",
        action=argparse.BooleanOptionalAction,
        help="render cameras and bird's-eye views of the collected groups, as `branchdrive render` does by default",
    )
    wrong = parser.add_argument_group("what goes wrong on purpose")
    wrong.add_argument(
        "--replay-noise", metavar="STRENGTH", type=strength, help="declared noise of replays; 0 replays exactly"
    )
    wrong.add_argument(
        "--faults",
        metavar="SPEC",
        help=f"declared faults to inject: none, {fault_presets}, or NAME=RATE,... of {', '.join(FAULT_RATES.names)}; "
        "docs/reference-world.md describes them",
    )
    work = parser.add_argument_group("how to work")
    work.add_argument("--jobs", metavar="J", type=in_range(1, _MAX_COUNT), help="worker processes (default: 1)")
    add_executor_argument(work)
    work.add_argument(
        "--output",
        metavar="URL",
        type=bucket,
        help="put finished shards and their media below this prefix of a bucket as they come, as s3://BUCKET/PREFIX, "
        "and the manifest when all is there; OUT is where the work is done",
    )
    work.add_argument("--resume", action="store_true", help="only go on with a collection that OUT already holds")


@dataclass(frozen=True)
class _Choice:
    """Options that a preset gives defaults for."""

    num_groups: int
    replay_noise: float
    faults: dict[str, float]
    branches: dict[str, float]
    scenario_types: tuple[str, ...]


def _choose(args: argparse.Namespace) -> _Choice:
    from branchdrive_reference.collect.fault import FAULT_RATES
    from branchdrive_reference.collect.plan import BRANCH_PRESETS, FAULT_PRESETS, PRESETS
    from branchdrive_reference.simulation.branch_kind import BRANCH_SHARES

    preset = PRESETS.get(args.preset)
    num_groups = args.groups or (preset and preset.num_groups)
    if not num_groups:
        raise UsageError(f"how many groups? give --groups N or --preset {'|'.join(PRESETS)}")
    noise = args.replay_noise if args.replay_noise is not None else (preset.replay_noise if preset else 0.0)
    text = args.faults if args.faults is not None else (args.preset if args.preset in FAULT_PRESETS else "none")
    faults = FAULT_RATES.parse(text, FAULT_PRESETS)
    kinds = args.branches if args.branches is not None else (args.preset if args.preset in BRANCH_PRESETS else "none")
    scenario_types = tuple(args.scenario or (preset.scenario_types if preset else ()))
    return _Choice(num_groups, noise, faults, BRANCH_SHARES.parse(kinds, BRANCH_PRESETS), scenario_types)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Collect, finish the dataset and print a summary; 130 if interrupted, 143 if asked to terminate.

    Raises:
        UsageError: The options do not go together, the folder cannot be used, the dataset does not
            fit on its disk.
        PlatformError: The extra is not installed.
    """
    from branchdrive_reference.collect.disk import GROUPS_PER_SHARD

    chosen = _choose(args)
    num_groups = len(args.part.places(chosen.num_groups, GROUPS_PER_SHARD))
    if args.media:
        _load_renderer()
    upload = _upload(args)
    report: CollectionReport | None = None
    images: RenderReport | None = None
    finished = 0
    show: Update | None = None

    def foresee(need: DiskNeed) -> None:
        stdout.write(f"disk      {need}\n")
        stdout.flush()

    try:
        with heeded_termination(), ExitStack() as bar:
            collect = _load_collector()
            from branchdrive_reference.kernel import are_kernels_cached  # loaded by now

            if not are_kernels_cached():
                stdout.write("kernels   are compiled for this processor, once: 15 to 60 s before the first group\n")
                stdout.flush()

            def note(groups: int, ticks: int) -> None:
                nonlocal finished, show
                if show is None:  # the bar begins below the lines that come before it
                    with deferred_interrupt() as raise_if_noted:  # it has imports of its own
                        show = bar.enter_context(progress_bar(stderr, "collecting groups"))
                    raise_if_noted()
                finished = groups
                show(groups, num_groups, f"{ticks:,} ticks")
                if upload is not None:
                    upload.send_shards()

            if not (args.media and _is_being_rendered(args, chosen, num_groups)):
                report = collect(
                    args.out,
                    num_groups=chosen.num_groups,
                    seed=args.seed,
                    replay_noise=chosen.replay_noise,
                    faults=chosen.faults,
                    branches=chosen.branches,
                    scenario_types=chosen.scenario_types,
                    part=args.part,
                    jobs=args.jobs or 1,
                    executor=engine_of(args),
                    resume=args.resume,
                    foresee=foresee,
                    watch=note,
                )
            finished = num_groups
            bar.close()
            if report is not None:  # before hours of rendering: what a benchmark takes is among it
                stdout.write("".join(f"{line}\n" for line in _collected(report)))
                stdout.flush()
            if args.media:
                if upload is not None:
                    upload.send_shards()  # a refusal comes before images are drawn
                images = _render(args, upload, bar.enter_context(progress_bar(stderr, "rendering groups")))
                bar.close()
            if upload is not None:
                upload.finish(bar.enter_context(progress_bar(stderr, "uploading")))
    except KeyboardInterrupt as interrupt:
        progress = f"{finished} of {num_groups} groups are finished"
        stderr.write(f"interrupted; {progress}. To go on, run: {_command_line(args)}\n")
        return int(getattr(interrupt, "exit_code", EXIT_INTERRUPTED))
    stdout.write(_summary(args, report, images))
    return 0


def _load_collector() -> Callable[..., CollectionReport]:
    """The collector; an interrupt waits for the import, which takes seconds and does not always survive one."""
    with extra("sim", of="`collect`"), deferred_interrupt() as raise_if_noted:
        from branchdrive_reference.collect.campaign import collect
    raise_if_noted()
    return collect


def _load_renderer() -> None:
    """Make sure of the renderer before hours of collecting, not after them."""
    with extra("media", "sim", of="`collect --media`"), deferred_interrupt() as raise_if_noted:
        import branchdrive_reference.collect.media  # noqa: F401
    raise_if_noted()


def _upload(args: argparse.Namespace) -> ShardUpload | None:
    """Where finished shards go beside; the bucket is asked before anything is collected."""
    if args.output is None:
        return None
    from branchdrive.formats.folder import Folder
    from branchdrive.writer.shard_upload import ShardUpload

    dataset, media = Folder(args.out), None
    if args.media:
        from branchdrive_reference.rendering.dataset import finished_media

        media = finished_media(dataset)
    return ShardUpload.at(dataset, args.output, media)


def _is_being_rendered(args: argparse.Namespace, chosen: _Choice, num_groups: int) -> bool:
    """Whether all groups are there and some media, so that nothing is left to collect."""
    from branchdrive_reference.collect.campaign import collection_descriptor
    from branchdrive_reference.collect.media import is_being_rendered

    descriptor = collection_descriptor(
        args.seed,
        replay_noise=chosen.replay_noise,
        faults=chosen.faults,
        branches=chosen.branches,
        scenario_types=chosen.scenario_types,
    )
    return is_being_rendered(args.out, descriptor, num_groups)


def _render(args: argparse.Namespace, upload: ShardUpload | None, show: Update) -> RenderReport:
    from branchdrive_reference.collect.media import default_media
    from branchdrive_reference.rendering.dataset import render_dataset

    note_shard = unwatched if upload is None else upload.send_shards
    return render_dataset(
        args.out,
        default_media(),
        jobs=args.jobs or 1,
        executor=engine_of(args),
        watch=show,
        note_shard=note_shard,
    )


def _command_line(args: argparse.Namespace) -> str:
    """The command with every option that was given, quoted for a shell."""
    options = {
        "--groups": args.groups,
        "--preset": args.preset,
        "--part": None if args.part == WHOLE else args.part,
        "--seed": args.seed,
        "--jobs": args.jobs,
        "--executor": engine_text(args),
        "--replay-noise": args.replay_noise,
        "--faults": args.faults,
        "--branches": args.branches,
        "--output": args.output,
    }
    out = str(args.out)
    tokens = ["branchdrive", "collect", f"./{out}" if out.startswith("-") else out]
    tokens += [token for name, value in options.items() if value is not None for token in (name, str(value))]
    tokens += [token for name in args.scenario or () for token in ("--scenario", name)]
    if args.media is not None:
        tokens.append("--media" if args.media else "--no-media")
    tokens += ["--resume"] if args.resume else []
    return shlex.join(tokens)


def _summary(args: argparse.Namespace, report: CollectionReport | None, images: RenderReport | None) -> str:
    lines, identity = [], report.identity if report else ""
    if images is not None:
        identity = images.identity
        lines += [f"images    {images.num_images:,} in {images.num_bytes / 1e6:,.1f} MB"]
    lines += [
        f"dataset   {args.output or args.out}",
        f"identity  {identity}",
        f"next      {shlex.join(['branchdrive-validate', str(args.output or args.out)])}",
    ]
    return "\n".join(lines) + "\n"


def _collected(report: CollectionReport) -> list[str]:
    """What was collected, and how fast."""
    simulated = sum(group.num_simulated for group in report.groups)
    reused = sum(group.num_reused for group in report.groups)
    num_stopped = sum(bool(group.stopped_because) for group in report.groups)
    jobs = "1 job" if report.num_workers == 1 else f"{report.num_workers} jobs"
    speed = (
        f"ticks     {report.num_ticks:,} in {report.seconds:.1f} s with {jobs}, writing included: "
        f"{report.ticks_per_s:,.0f} ticks/s"
    )
    return [
        f"groups    {len(report.groups):,} collected, {report.num_found:,} found finished",
        *(f"          {remark}" for remark in report.remarks("unbranched_because", "refused_because", "note")),
        *([f"          {num_stopped:,} stopped early by injected faults"] if num_stopped else []),
        f"routes    {report.routes_text}",
        f"rollouts  {simulated:,} simulated, {reused:,} found finished",
        *([speed] if report.num_ticks else []),
    ]
