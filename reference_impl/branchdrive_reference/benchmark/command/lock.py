"""`branchdrive lock`: fix protocol, code, configurations and checkpoints by their digests."""

from __future__ import annotations

import argparse
from typing import TextIO

from branchdrive_reference.benchmark.command.option import add_protocol, add_release, at_work, need_models

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "lock the trained models of the benchmark before outcomes of the test partition are looked at"
ORDER = 150


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_release(parser)
    add_protocol(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Lock, and print the digest of the lock.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: A checkpoint is missing or was trained otherwise.
        DatasetError: The release or a checkpoint cannot be read.
    """
    need_models("lock")
    from branchdrive.benchmark.lock import lock_digest
    from branchdrive_reference.benchmark.step import lock_step

    with at_work(args.release, args.protocol, keep=True) as (workspace, protocol):
        document = lock_step(workspace, protocol)
    stdout.write(f"prediction lock {lock_digest(document)}, {len(document['checkpoints'])} checkpoints\n")
    return 0
