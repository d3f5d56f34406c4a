"""`branchdrive draw`: pictures of branch groups, one of each scenario type, all of them or those that are named."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import place
from branchdrive.cli.progress import progress_bar
from branchdrive.contract.text import printable
from branchdrive.errors import DatasetError, UsageError
from branchdrive.runtime.environment import extra
from branchdrive_reference.plotting import load_matplotlib

if TYPE_CHECKING:
    from branchdrive_reference.drawing.scene import DrawnScene

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "draw branch groups: the map, the actors and the futures of every candidate"
ORDER = 60


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset: folder, URL or archive")
    parser.add_argument("--output", metavar="DIR", type=Path, required=True, help="folder of the pictures")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--group",
        metavar="ID",
        action="append",
        default=[],
        help="draw this group; repeatable, not with --scenario",
    )
    which.add_argument(
        "--scenario",
        metavar="NAME",
        action="append",
        default=[],
        help="draw the first drawable group of this type only (default: of every type); repeatable, not with --group",
    )
    which.add_argument("--all", action="store_true", help="draw every group with a complete attempt of every policy")
    parser.add_argument("--format", choices=("png", "svg"), default="png", help="kind of the files (default: png)")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Draw and print a line for every picture.

    A group that was not named and that cannot be drawn is left out and named on `stderr`.

    Raises:
        UsageError: The dataset is not finished or cannot be read, a named group, a wanted type or no group at all
            can be drawn, or the output is not a folder outside the dataset.
        PlatformError: The extra is not installed.
    """
    with extra("sim", "plots", of="`draw`"):
        load_matplotlib()
        from branchdrive_reference.drawing.picture import save
    from branchdrive_reference.drawing.choice import named_groups, wanted_groups
    from branchdrive_reference.drawing.gallery import Gallery, named_pictures
    from branchdrive_reference.drawing.scene import require_actors
    from branchdrive_reference.plotting import quiet
    from branchdrive_reference.study.label import sentence
    from branchdrive_reference.study.survey import open_finished

    check_output(args.output, outside=args.dataset, is_folder=True)
    lines: list[str] = []
    try:
        dataset = open_finished(args.dataset)
        require_actors(dataset.descriptor)
        gallery = Gallery(dataset, {} if args.group else wanted_groups(dataset, args.scenario), every=args.all)
        if args.group:
            names = named_groups(dataset, args.group)
            pictures, num_pictures = named_pictures(dataset, names, args.output, args.format), len(names)
        else:
            pictures, num_pictures = gallery.pictures(args.output, args.format), len(gallery)
        with quiet(), progress_bar(stderr, "drawing groups") as show:
            for path, scene in pictures:
                args.output.mkdir(parents=True, exist_ok=True)
                save(scene, path, args.format)
                lines.append(f"{path.name}  {_touches(scene)}\n")
                show(len(lines), num_pictures)
    except DatasetError as error:
        raise UsageError(sentence(error)) from error
    stderr.writelines(f"branchdrive: {line}\n" for line in gallery.left_out())
    if not lines:
        raise UsageError(f"{str(args.dataset)!r} has no group that can be drawn")
    stdout.writelines(lines)
    stdout.write(f"{len(lines)} {'picture' if len(lines) == 1 else 'pictures'} in {printable(str(args.output))}\n")
    return 0


def _touches(scene: DrawnScene) -> str:
    """How many candidates touch something in the picture, and how many end before it does."""
    from branchdrive_reference.drawing.scene import HORIZON_S

    num_touching = sum(bool(len(candidate.contacts)) for candidate in scene.candidates)
    num_early = sum(candidate.ends_early for candidate in scene.candidates)
    early = f", {num_early} {'ends' if num_early == 1 else 'end'} earlier" if num_early else ""
    return f"touches in {num_touching} of {len(scene.candidates)} to +{HORIZON_S:.1f} s{early}"
