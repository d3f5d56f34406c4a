"""`branchdrive export`: the selector of a benchmark as an ONNX model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TextIO

from branchdrive.cli.output import check_output
from branchdrive.contract.text import counted, printable
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.command.option import add_release, need_models

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "write the selector of the benchmark as an ONNX model that needs nothing else"
ORDER = 180


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_release(parser, is_read_only=True)
    parser.add_argument("--output", metavar="FILE", type=Path, required=True, help="the ONNX file, as selector.onnx")
    parser.add_argument("--model", metavar="MODEL", default="M3", help="model to export, all its seeds (default: M3)")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Export, compare with torch, write.

    Raises:
        PlatformError: An extra is not installed.
        UsageError: The release has no such model, or it cannot rank.
        DatasetError: The release or a checkpoint cannot be read.
    """
    check_output(args.output, outside=args.release)
    need_models("export")
    from branchdrive.contract.layout import LOCK_FILE
    from branchdrive.formats.durable import replace_file
    from branchdrive_reference.benchmark.document import published_protocol
    from branchdrive_reference.benchmark.onnx_export import export_locked
    from branchdrive_reference.benchmark.prediction import locked_checkpoints
    from branchdrive_reference.benchmark.release import open_release

    release = open_release(args.release)
    lock = release.document(LOCK_FILE)
    protocol = published_protocol(release)
    if protocol.model(args.model) is None:
        raise UsageError(f"no model {args.model!r}; the protocol declares {', '.join(m.id for m in protocol.models)}")
    checkpoints = [] if lock is None else locked_checkpoints(release, lock, args.model)
    if not checkpoints:
        raise UsageError(f"{args.release}: has no locked checkpoint of {args.model!r}; run `branchdrive predict` first")
    stderr.write(f"exporting {args.model}, and comparing it with torch on `val`\n")
    content, difference = export_locked(release, protocol, checkpoints)
    replace_file(args.output, content)
    stdout.write(
        f"{printable(str(args.output))}: {args.model}, {counted(len(checkpoints), 'seed')}, {len(content):,} bytes, "
        f"largest difference to torch {difference:.1e}\n"
    )
    return 0
