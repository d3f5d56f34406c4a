"""`branchdrive train`: models of the benchmark on the training groups of a release."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.executor import engine_of
from branchdrive_reference.benchmark.command.option import (
    add_device,
    add_jobs,
    add_protocol,
    add_release,
    at_work,
    bars,
    check_device,
    need_models,
)

if TYPE_CHECKING:
    from branchdrive_reference.benchmark.step import Trained

__all__ = ["ORDER", "SUMMARY", "add_arguments", "add_training", "run", "sentence"]

SUMMARY = "train the models of the benchmark; the same command goes on where it was interrupted"
ORDER = 140


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_release(parser)
    parser.add_argument("--models", metavar="MODEL", nargs="+", help="models to train (default: all of the protocol)")
    add_training(parser)


def add_training(parser: argparse.ArgumentParser) -> None:
    """Declare the options of training, here and in one go with the steps after it."""
    parser.add_argument(
        "--no-guard", action="store_true", help="train no folds for the guard, whose results will be missing"
    )
    add_jobs(parser)
    add_device(parser)
    add_protocol(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Train.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: No model is called so, or another command is running on the release.
        DatasetError: The release or a checkpoint cannot be read.
    """
    need_models("train")
    check_device(args.device)
    from branchdrive_reference.benchmark.document import sentences_before_training
    from branchdrive_reference.benchmark.step import train_step

    with at_work(args.release, args.protocol, keep=True) as (workspace, protocol):
        for said in sentences_before_training(workspace.release, protocol, args.models, with_guard=not args.no_guard):
            stderr.write(f"{said}\n")
        found = train_step(
            workspace, protocol, models=args.models, jobs=args.jobs, executor=engine_of(args),
            device=args.device, with_guard=not args.no_guard, progress=bars(stderr),
        )  # fmt: skip
        stdout.write(sentence(found))
        if not workspace.release.has_benchmark:
            stdout.write(
                "They wait in the working area of the release; `branchdrive lock` and `predict` publish them.\n"
            )
    return 0


def sentence(found: Trained) -> str:
    """What was trained, and what it took."""
    num_trained = found.num_models - found.num_there
    text = f"{num_trained} of {found.num_models} models and seeds trained in {found.models_s:.1f} s"
    there = ", the others were there" if found.num_there else ""
    guard = f"; {found.num_folds} folds and the risk of the guard in {found.guard_s:.1f} s" if found.num_folds else ""
    again = (
        f"; {found.num_anew} trained again, because their configuration or version was another"
        if found.num_anew
        else ""
    )
    return f"{text}{there}{guard}{again}\n"
