"""Runs of the team's command that several sections of the report are made of, each run once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.rerun import Command, Run

__all__ = ["NO_COMMAND", "Reruns"]

NO_COMMAND = (
    'no command was given; pass --rerun "COMMAND {out}" with the command that collects these groups, and {groups} '
    "where it takes a list of them"
)
"""Why sections that need runs examined nothing."""


class Reruns:
    """The command, and what became of its runs.

    Attributes:
        pilot: Whose groups the command collects.
        command: The command.
        folder: Where the runs put their datasets.
        limit_s: Longest that a run may take.
    """

    def __init__(
        self, pilot: Pilot, command: Command, folder: Path, *, limit_s: float, note: Callable[[str], None]
    ) -> None:
        self.pilot, self.command, self.folder, self.limit_s = pilot, command, folder, limit_s
        self._note = note

    @cached_property
    def fresh(self) -> Run:
        """All groups, in their order, in a fresh process: what other runs are compared with."""
        return self.run("fresh", "the same groups in a fresh process", self.pilot.group_ids)

    def run(
        self,
        name: str,
        what: str,
        group_ids: list[str],
        *,
        is_reversed: bool = False,
        limit_s: float | None = None,
    ) -> Run:
        """Run the command into the folder `name`; `what` says to a waiting user what for."""
        self._note(what)
        return self.command.run(self.folder / name, group_ids, limit_s=limit_s or self.limit_s, is_reversed=is_reversed)
