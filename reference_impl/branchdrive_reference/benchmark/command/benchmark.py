"""`branchdrive benchmark`: train, lock, predict and evaluate in one command."""

from __future__ import annotations

import argparse
from typing import TextIO

from branchdrive.cli.executor import engine_of
from branchdrive.contract.layout import BENCHMARK
from branchdrive.contract.text import printable
from branchdrive_reference.benchmark.command.evaluate import add_format, format_evaluation
from branchdrive_reference.benchmark.command.option import (
    add_no_figures,
    add_release,
    at_work,
    bars,
    check_device,
    need_models,
    need_plots,
)
from branchdrive_reference.benchmark.command.train import add_training, sentence

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "train, lock, predict and evaluate: from a release to all tables and figures"
ORDER = 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_release(parser)
    add_training(parser)
    add_no_figures(parser)
    add_format(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Carry out every step that is not done, and print the tables.

    Raises:
        UsageError: As the single commands.
        DatasetError: As the single commands.
    """
    need_models("benchmark")
    check_device(args.device)
    if not args.no_figures:
        need_plots()
    from branchdrive_reference.benchmark.document import sentences_before_training
    from branchdrive_reference.benchmark.evaluation import evaluate_published
    from branchdrive_reference.benchmark.step import lock_step, predict_step, train_step

    progress = bars(stderr)
    with at_work(args.release, args.protocol, keep=True) as (workspace, protocol):
        for said in sentences_before_training(workspace.release, protocol, with_guard=not args.no_guard):
            stderr.write(f"{said}\n")
        trained = train_step(
            workspace, protocol, models=None, jobs=args.jobs, executor=engine_of(args),
            device=args.device, with_guard=not args.no_guard, progress=progress,
        )  # fmt: skip
        stderr.write(sentence(trained))
        lock_step(workspace, protocol)
        workspace = predict_step(workspace, protocol, device=args.device, progress=progress)
        with progress("evaluating") as show:
            found = evaluate_published(workspace, protocol, show=show, with_figures=not args.no_figures)
    stdout.write(format_evaluation(found, args.format, stdout, args.release / BENCHMARK))
    stderr.write(f"tables and figures are in {printable(str(args.release / BENCHMARK))}\n")
    return 0
