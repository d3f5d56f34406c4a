"""`branchdrive draw`: pictures of branch groups, one of each scenario type or those that are named."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.progress import progress_bar
from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from branchdrive_reference.drawing.scene import Scene

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "draw branch groups: the map, the actors and the futures of every candidate"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=Path, help="the dataset folder")
    parser.add_argument("--output", metavar="DIR", type=Path, required=True, help="folder of the pictures")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--group", metavar="ID", action="append", default=[], help="draw this group (repeatable)")
    which.add_argument(
        "--scenario",
        metavar="NAME",
        action="append",
        default=[],
        help="draw the first complete group of this type only (repeatable; default: of every type)",
    )
    parser.add_argument("--format", choices=("png", "svg"), default="png", help="kind of the files (default: png)")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Draw and print a line for every picture.

    Raises:
        UsageError: A group or type cannot be drawn, the output is no folder, or the extra is not installed.
        DatasetError: The dataset cannot be read.
    """
    try:
        from branchdrive_reference.drawing.picture import save
    except ModuleNotFoundError as error:
        raise UsageError(f"`draw` needs the package {error.name!r}: pip install 'branchdrive[sim,plots]'") from error
    from branchdrive.dataset.reader import open_dataset
    from branchdrive_reference.drawing.choice import choose_groups, named_groups
    from branchdrive_reference.drawing.scene import read_scene

    if args.output.exists() and not args.output.is_dir():
        raise UsageError(f"--output: {str(args.output)!r} is no folder")
    dataset = open_dataset(args.dataset)
    names = named_groups(dataset, args.group) if args.group else choose_groups(dataset, args.scenario)
    args.output.mkdir(parents=True, exist_ok=True)
    lines = []
    with progress_bar(stderr, "drawing groups") as show:
        for number, name in enumerate(names, start=1):
            scene = read_scene(dataset.group(name), dataset.descriptor.action_bank)
            path = args.output / f"{name}.{args.format}"
            save(scene, path, args.format)
            show(number, len(names))
            lines.append(f"{path}  {_summary(scene)}\n")
    stdout.writelines(lines)
    return 0


def _summary(scene: Scene) -> str:
    record = scene.record
    touching = [candidate.policy.key for candidate in scene.candidates if len(candidate.contacts)]
    touches = f"touches in {len(touching)} ({', '.join(touching)})" if touching else "no touches"
    return (
        f"{record['scenario_type']} in {record['town']}, branch at tick {record['branch_tick']} "
        f"by {record['trigger_signal']}: {len(scene.candidates)} candidates, {touches}"
    )
