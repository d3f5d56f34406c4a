"""Options that commands of the benchmark share, and the door to the extra that they need."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.executor import add_executor_argument
from branchdrive.cli.place import folder, place
from branchdrive.cli.progress import progress_bar
from branchdrive.cli.validate import at_least
from branchdrive.runtime.environment import extra
from branchdrive_reference.plotting import load_matplotlib

if TYPE_CHECKING:
    from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
    from branchdrive_reference.benchmark.step import Progress
    from branchdrive_reference.benchmark.workspace import Workspace

__all__ = [
    "add_device", "add_jobs", "add_no_figures", "add_protocol", "add_release", "at_work", "bars", "check_device",
    "need_models", "need_plots",
]  # fmt: skip

_DEVICES = ("cpu", "cuda", "auto")


def add_release(parser: argparse.ArgumentParser, *, is_read_only: bool = False) -> None:
    """The release, in place or detached; a command that publishes nothing in it takes it from any place."""
    parser.add_argument(
        "release", metavar="RELEASE", type=place if is_read_only else folder, help="release with its model layer"
    )


def add_protocol(parser: argparse.ArgumentParser) -> None:
    """Another protocol than the default one."""
    parser.add_argument(
        "--protocol", metavar="FILE", type=Path,
        help="benchmark protocol as JSON, or `structured` or `visual` for those of this version, or `trees` for the "
        "first with boosted trees, `objects` for that with models of objects (default: the one in use in the release, "
        "else `visual` where it has images and `structured` where not)",
    )  # fmt: skip


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Processes, and where they are."""
    parser.add_argument(
        "--jobs", metavar="N", type=at_least(1), default=1, help="processes that train side by side (default: 1)"
    )
    add_executor_argument(parser)


def add_device(parser: argparse.ArgumentParser) -> None:
    """Where torch computes."""
    parser.add_argument("--device", choices=_DEVICES, default="cpu", help="where to compute (default: cpu)")


def add_no_figures(parser: argparse.ArgumentParser) -> None:
    """Tables alone."""
    parser.add_argument("--no-figures", action="store_true", help="write tables alone, which needs no matplotlib")


def need_models(command: str) -> None:
    """Make sure that torch is here.

    Raises:
        PlatformError: It is not; the message says what to install.
    """
    with extra("models", of=f"`{command}`"):
        import branchdrive_reference.learning.groups
        import branchdrive_reference.learning.tensor_file  # noqa: F401


def check_device(name: str) -> None:
    """Make sure that the device is there, before anything is begun.

    Raises:
        UsageError: It is not.
    """
    from branchdrive_reference.learning.execution import open_device

    open_device(name)


def need_plots() -> None:
    """Make sure that figures can be drawn, before anything is opened for them.

    Raises:
        PlatformError: They cannot; the message says what to install.
    """
    with extra("plots", of="a figure", otherwise="use `--no-figures`"):
        load_matplotlib()
        import branchdrive_reference.benchmark.figure.gallery  # noqa: F401


@contextmanager
def at_work(
    release: Path, protocol_file: Path | None = None, *, keep: bool = False
) -> Iterator[tuple[Workspace, BenchmarkProtocol]]:
    """The working area of a release, held while the command runs, and the protocol that is in force.

    Args:
        release: Its folder.
        protocol_file: The protocol that the user named.
        keep: Whether the protocol waits for the commands that follow.

    A request to terminate interrupts as the keyboard does, and the same command goes on later.

    Raises:
        UsageError: Another command is running there.
        DatasetError: The release cannot be read.
    """
    from branchdrive.runtime.interrupt import heeded_termination
    from branchdrive_reference.benchmark.document import choose_protocol
    from branchdrive_reference.benchmark.release import open_release
    from branchdrive_reference.benchmark.workspace import open_workspace

    with heeded_termination(), open_workspace(open_release(release)) as workspace:
        yield workspace, choose_protocol(workspace, protocol_file, keep=keep)


def bars(stderr: TextIO) -> Progress:
    """Progress bars with an ETA on a terminal."""
    return lambda title: progress_bar(stderr, title)
