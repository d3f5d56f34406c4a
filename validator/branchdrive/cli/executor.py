"""Where a command's tasks run: `--jobs` processes of this machine, or the workers of an engine."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from branchdrive.runtime.executor import Executor

__all__ = ["add_executor_argument", "engine_of", "engine_text", "executor_of"]

_LOCAL, _RAY = "local", "ray"


def engine(text: str) -> tuple[str, str | None]:
    """An engine and its address; `argparse` names this function in its messages."""
    name, _, address = text.partition(":")
    if name not in (_LOCAL, _RAY) or (name == _LOCAL and address):
        raise argparse.ArgumentTypeError(f"{text!r} is not `local`, `ray` or `ray:ADDRESS`")
    return name, address or None


def add_executor_argument(parser: argparse._ActionsContainer) -> None:
    """Declare `--executor`."""
    parser.add_argument(
        "--executor", metavar="local|ray[:ADDRESS]", type=engine, default=(_LOCAL, None),
        help="where to work: in processes of this machine, or on Ray (extra `ray`), which is started here unless "
        "ADDRESS names a cluster, all of whose nodes have the same folders and packages (default: local)",
    )  # fmt: skip


def engine_text(args: argparse.Namespace) -> str | None:
    """What `--executor` was given; ``None`` for processes of this machine."""
    return None if args.executor[0] == _LOCAL else ":".join(filter(None, args.executor))


def engine_of(args: argparse.Namespace) -> Executor | None:
    """The engine that `--executor` names; ``None`` for processes of this machine."""
    name, address = args.executor
    if name != _RAY:
        return None
    from branchdrive.runtime.ray_executor import ray_executor

    return ray_executor(address, jobs=args.jobs or 1)


def executor_of(args: argparse.Namespace) -> Executor:
    """What `--executor` and `--jobs` name; processes of this machine begin to load what reads datasets."""
    from branchdrive.runtime.executor import isolated, load_soon

    return load_soon(engine_of(args) or isolated(args.jobs), "branchdrive.engine.reading")
