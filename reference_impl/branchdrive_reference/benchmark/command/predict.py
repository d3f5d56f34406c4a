"""`branchdrive predict`: predictions of the locked models, published as the benchmark layer of the release."""

from __future__ import annotations

import argparse
from typing import TextIO

from branchdrive_reference.benchmark.command.option import (
    add_device,
    add_release,
    at_work,
    bars,
    check_device,
    need_models,
)

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "predict with the locked models and publish lock, checkpoints and predictions in the release"
ORDER = 160


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_release(parser)
    add_device(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Predict and publish.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: Nothing is locked, or a checkpoint is not the one that was locked.
        DatasetError: The release or a checkpoint cannot be read.
    """
    need_models("predict")
    check_device(args.device)
    from branchdrive_reference.benchmark.step import predict_step

    with at_work(args.release) as (workspace, protocol):
        workspace = predict_step(workspace, protocol, device=args.device, progress=bars(stderr))
        num_files = len(workspace.release.benchmark_files())
    stdout.write(f"{num_files} files in the layer `benchmark`; `branchdrive evaluate` opens the test partition\n")
    return 0
